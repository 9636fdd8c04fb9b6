"""What a command would do, said without doing it. Light: the front desk answers so."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from recon.errors import UnreadableFile
from recon.version import __version__

__all__ = ["options_chosen", "plan", "plan_summary"]

FORMATS = {
    ".step": "STEP",
    ".stp": "STEP",
    ".iges": "IGES",
    ".igs": "IGES",
    ".brep": "OpenCascade BREP",
    ".stl": "triangles",
    ".3mf": "triangles to print",
    ".glb": "triangles with colours",
    ".png": "picture",
    ".html": "report",
    ".htm": "report",
    ".obj": "polygons",
    ".json": "numbers",
    ".geojson": "contour lines",
}
SAID_ELSEWHERE = ("inputs", "outputs", "picture", "report", "page", "endings", "more_endings", "debug", "header_unit")


def plan(command: str, request: Mapping[str, Any]) -> dict[str, Any]:
    """What would be read and written, and what was chosen, as an object.

    request  after its destinations were checked
    Raises   UnreadableFile for a file that is missing.
    """
    for path in request["inputs"]:
        if not Path(path).exists():
            raise UnreadableFile(path, "there is no such file", "Check the name and the folder")
    extra = [request.get(key) for key in ("picture", "report")]
    return {
        "command": command,
        "version": __version__,
        "dry_run": True,
        "inputs": list(request["inputs"]),
        "outputs": [*request["outputs"], *(path for path in extra if path is not None)],
        "options": options_chosen(request),
    }


def options_chosen(request: Mapping[str, Any]) -> dict[str, Any]:
    """The options that say how a thing is done, without files, and without those left as they are."""
    return {k: v for k, v in request.items() if k not in SAID_ELSEWHERE and v not in (None, False, [])}


def plan_summary(planned: Mapping[str, Any]) -> str:
    """The plan for a person: a line a file, and one for what was chosen."""
    lines = [f"{planned['command']}: nothing is done, as asked"]
    lines += [f"  would read   {path}" for path in planned["inputs"]]
    lines += [f"  would write  {path} ({_format(path)}{_replaces(path)})" for path in planned["outputs"]]
    if not planned["outputs"]:
        lines.append("  would write  nothing; name a file with -o")
    lines += [f"  {key:<12} {_value(value)}" for key, value in planned["options"].items()]
    return "\n".join(lines)


def _format(path: str) -> str:
    return FORMATS.get(Path(path).suffix.lower(), "file")


def _replaces(path: str) -> str:
    return ", in place of the one there" if Path(path).exists() else ""


def _value(value: Any) -> str:
    return " ".join(map(str, value)) if isinstance(value, Sequence) and not isinstance(value, str) else str(value)
