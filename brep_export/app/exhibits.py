"""Where the workshop leaves what a page shows beside figures, and how the front desk gathers it. Light on purpose."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from brep_export.app.report import Exhibits

__all__ = ["GALLERY", "SCENE", "gathered", "length_unit", "picture_name"]

SCENE, GALLERY = "scene.json", "gallery.html"


def picture_name(number: int) -> str:
    """Name of a picture for the page, in the order of numbers."""
    return f"picture-{number:03d}.png"


def length_unit(request: Mapping[str, Any]) -> str:
    """Unit of lengths of the shapes of a command."""
    return str(request.get("header_unit", "MM")).lower()


def gathered(folder: Path, unit: str) -> Exhibits:
    """All that was left in a folder."""
    return Exhibits(
        pictures=tuple(path.read_bytes() for path in sorted(folder.glob("picture-*.png"))),
        scene=_text(folder / SCENE) or None,
        gallery=_text(folder / GALLERY),
        unit=unit,
    )


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""
