"""Three-view drawings from files: DXF, SVG, JSON."""

from pathlib import Path

from recon.errors import UnsupportedFormat
from recon.readers.view_dxf import read_dxf_views
from recon.readers.view_json import read_json_views
from recon.readers.view_sheet import ViewSheet
from recon.readers.view_svg import read_svg_views

__all__ = ["VIEW_ENDINGS", "read_views"]

VIEW_ENDINGS = (".dxf", ".svg", ".json")


def read_views(path: str | Path) -> ViewSheet:
    """A drawing from a file whose ending names its format.

    Raises  UnsupportedFormat, and what the format's own reader raises.
    """
    ending = Path(path).suffix.lower()
    if ending == ".dxf":
        return read_dxf_views(path)
    if ending == ".svg":
        return read_svg_views(path)
    if ending == ".json":
        return ViewSheet(read_json_views(path))
    raise UnsupportedFormat(str(path), VIEW_ENDINGS)
