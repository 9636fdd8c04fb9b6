"""Options that several commands take, said once.

The parameter of a command is the key under which its job finds the value: `inputs`, `outputs`, `picture` ...

    @takes(WRITING, RUNNING)
    def voxels(inputs: ..., outputs: Outputs = None, ..., **usual: Any) -> None:

gives the command the options of both groups after its own, and their values in `usual`.
"""

from collections.abc import Callable, Mapping
from enum import StrEnum
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any

import typer

from brep_export.app.note_names import NOTES
from brep_export.app.outputs import ENDINGS

__all__ = [
    "RUNNING",
    "WRITING",
    "AllowOpen",
    "AsJson",
    "DryRun",
    "Outputs",
    "Picture",
    "Quiet",
    "Report",
    "UnitOfScans",
    "takes",
]

Options = Mapping[str, tuple[Any, Any]]  # kind and default by name


class Schema(StrEnum):
    """STEP application protocol."""

    AP214 = "AP214"
    AP242 = "AP242"


class Unit(StrEnum):
    """Unit of length of the input."""

    MM = "mm"
    CM = "cm"
    M = "m"
    INCH = "inch"


Outputs = Annotated[
    list[Path] | None,
    typer.Option(
        "-o", "--output", help=f"File to write; its ending picks the format ({' '.join(ENDINGS)}). Repeatable."
    ),
]
Picture = Annotated[Path | None, typer.Option(help="Write a rendered picture (.png).")]
Report = Annotated[Path | None, typer.Option(help="Write a page with the verdict, the figures and pictures (.html).")]
ProtocolSchema = Annotated[Schema, typer.Option(help="STEP application protocol.")]
Name = Annotated[str | None, typer.Option(help="Name of the part in the file's header.")]
UnitOfScans = Annotated[Unit | None, typer.Option(help="Unit of the scans; if not given the file's own, else mm.")]
AllowOpen = Annotated[bool, typer.Option(help="Accept a result that is not a closed solid.")]
Force = Annotated[bool, typer.Option(help="Write even what the gate refuses; the exit status stays 1.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else on stdout.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, notes or warnings on stderr.")]
Silence = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME", help=f"Do not show notes of this name ({' '.join(NOTES)}). Repeatable."),
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Say what would be read and written, and do nothing.")]
Timeout = Annotated[float | None, typer.Option(help="Stop after this many seconds.", min=0.1)]
Debug = Annotated[bool, typer.Option(hidden=True, help="Show where a fault of the program itself was raised.")]

WRITING: Options = {
    "schema": (ProtocolSchema, Schema.AP214),
    "name": (Name, None),
    "picture": (Picture, None),
    "report": (Report, None),
    "force": (Force, False),
}
RUNNING: Options = {
    "as_json": (AsJson, False),
    "quiet": (Quiet, False),
    "timeout": (Timeout, None),
    "silence": (Silence, None),
    "dry_run": (DryRun, False),
    "debug": (Debug, False),
}


def takes(*groups: Options) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A decorator of commands, for the parser: their own parameters, then the options of the groups they lack."""

    def taking(command: Callable[..., None]) -> Callable[..., None]:
        known = signature(command, eval_str=True).parameters
        parameters = [p for p in known.values() if p.kind is not Parameter.VAR_KEYWORD]
        for group in groups:
            for name, (kind, default) in group.items():
                if name not in known:
                    parameters.append(Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind))

        @wraps(command)
        def whole(**options: Any) -> None:
            command(**options)

        whole.__signature__ = signature(command).replace(parameters=parameters)  # type: ignore[attr-defined]
        whole.__annotations__ = {p.name: p.annotation for p in parameters}
        return whole

    return taking
