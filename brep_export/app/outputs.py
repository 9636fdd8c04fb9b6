"""Which files a command may write, checked before any work is done. Light on purpose: the front desk imports it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from recon.errors import BadOption, UnsupportedFormat

__all__ = ["CAD_ENDINGS", "ENDINGS", "MESH_ENDINGS", "check_destinations"]

CAD_ENDINGS = (".step", ".stp", ".iges", ".igs", ".brep")
MESH_ENDINGS = (".stl", ".3mf", ".glb")
ENDINGS = CAD_ENDINGS + MESH_ENDINGS
PAGES = (".html", ".htm")


def check_destinations(request: Mapping[str, Any], *, make: bool = True) -> None:
    """Every output has a known ending, a folder that exists, and a name of its own; the folder of a demo is made.

    `more_endings` of the request are those that its command alone can write, `endings` all others.
    make  False: nothing is made, and the folder of a demo counts as if it were
    Raises  UnsupportedFormat, BadOption.
    """
    outputs = [Path(path) for path in request["outputs"]]
    endings = tuple(request.get("endings", ENDINGS)) + tuple(request.get("more_endings", ()))
    for path in outputs:
        if path.suffix.lower() not in endings:
            raise UnsupportedFormat(str(path), endings)
    picture = request.get("picture")
    if picture is not None and Path(picture).suffix.lower() != ".png":
        raise UnsupportedFormat(str(picture), (".png",))
    page = request.get("report")
    if page is not None and Path(page).suffix.lower() not in PAGES:
        raise UnsupportedFormat(str(page), PAGES)
    targets = outputs + [Path(path) for path in (picture, page) if path is not None]
    folder = request.get("make_directory")
    if make:
        _make(folder)
    inputs = {Path(path).resolve() for path in request["inputs"]}
    seen: set[Path] = set()
    for path in targets:
        if make or folder is None or path.parent != Path(folder):
            _check_place(path)
        if path.resolve() in seen:
            raise BadOption("--output", f"{path} is named twice")
        if path.resolve() in inputs:
            raise BadOption("--output", f"{path} is also an input; inputs are never written to")
        seen.add(path.resolve())


def _make(directory: str | None) -> None:
    if directory is None:
        return
    try:
        Path(directory).mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise BadOption("--directory", f"{directory} cannot be made ({problem.strerror})") from problem


def _check_place(path: Path) -> None:
    if path.is_dir():
        raise BadOption("--output", f"{path} is a folder; name a file in it")
    if not path.parent.is_dir():
        raise BadOption("--output", f"the folder {path.parent} does not exist; make it first")
