"""Options that several commands take, said once.

The parameter of a command is the key under which its job finds the value: `inputs`, `outputs`, `picture` ...
"""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from brep_export.app.note_names import NOTES
from brep_export.app.outputs import ENDINGS

__all__ = [
    "AllowOpen",
    "AsJson",
    "Debug",
    "DryRun",
    "Force",
    "Name",
    "Outputs",
    "Picture",
    "ProtocolSchema",
    "Quiet",
    "Report",
    "Schema",
    "Silence",
    "Timeout",
    "Unit",
    "UnitOfScans",
]


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
