"""The command `recon`: reads the options, sends the work to the workshop, prints what comes back.

Nothing heavy is imported here: `recon --help` has to answer at once.
"""

import json
import sys
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from brep_export.app.outputs import ENDINGS, check_destinations
from brep_export.app.result import refusal, summary
from brep_export.app.workshop import Exit, Outcome, run
from recon.errors import InputError
from recon.version import __version__

__all__ = ["app", "main"]

JOBS = {
    "patch": "brep_export.app.patch_job:patch",
    "terrain": "brep_export.app.terrain_job:terrain",
    "fit": "brep_export.app.fit_job:fit",
    "check": "brep_export.app.check_job:check_file",
    "demo": "brep_export.app.demo_job:demo",
    "views": "brep_export.app.views_job:views",
}

app = typer.Typer(
    name="recon",
    help="Measurements into CAD solids: closed, checked B-reps as STEP, IGES, BREP, and meshes to print.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Output = Annotated[
    list[Path] | None,
    typer.Option(
        "-o", "--output", help=f"File to write; its ending picks the format ({' '.join(ENDINGS)}). Repeatable."
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else on stdout.")]
Picture = Annotated[Path | None, typer.Option(help="Write a rendered picture (.png).")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, notes or warnings on stderr.")]
Timeout = Annotated[float | None, typer.Option(help="Stop after this many seconds.", min=0.1)]
AllowOpen = Annotated[bool, typer.Option(help="Accept a result that is not a closed solid.")]
Force = Annotated[bool, typer.Option(help="Write even what the gate refuses; the exit status stays 1.")]


class Method(StrEnum):
    """How the surface over a hole is found."""

    WHEEL = "wheel"
    BOX = "box"


class Relief(StrEnum):
    """What becomes of the pattern on the outer wall."""

    NONE = "none"
    CONTINUE = "continue"


class Surface(StrEnum):
    """Scheme of a fitted surface."""

    LOOP = "loop"


class Update(StrEnum):
    """Rule by which control points move."""

    TANGENT = "tangent"
    LEAST_SQUARES = "least-squares"
    PATENT = "patent"
    BASIS = "basis"
    NESTEROV = "nesterov"
    ANDERSON = "anderson"


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


Debug = Annotated[bool, typer.Option(hidden=True, help="Show where a fault of the program itself was raised.")]


def main() -> None:
    """Entry point of the console script."""
    app()


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"recon-brep {__version__}")
        raise typer.Exit


@app.callback()
def _top(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    del version


@app.command()
def patch(
    sherds: Annotated[
        list[Path], typer.Argument(help="Scans in pose: closed sherds, open outer walls, or one mesh with a hole.")
    ],
    output: Output = None,
    thickness: Annotated[
        str | None,
        typer.Option(
            help="Thickness of the wall in mm, where only the outer wall was scanned; auto takes it from where the"
            " scans show both sides.",
            metavar="MM|auto",
        ),
    ] = None,
    clearance: Annotated[
        float, typer.Option(help="How far in mm the piece keeps from its neighbours: room for glue.", min=0.0)
    ] = 0.0,
    min_wall: Annotated[float, typer.Option(help="Say where the piece is thinner than this, in mm.", min=0.0)] = 1.0,
    method: Annotated[
        Method, typer.Option(help="wheel: profile about the vessel's axis; box: the published route.")
    ] = Method.WHEEL,
    picks: Annotated[
        Path | None, typer.Option(help="JSON file with three points around the hole, for --method box.")
    ] = None,
    settle: Annotated[
        bool,
        typer.Option(
            "--settle/--no-settle", help="First settle the sherds against each other, by at most 0.5 mm and 0.5°."
        ),
    ] = True,
    relief: Annotated[
        Relief, typer.Option(help="continue: the pattern of the rest of the vessel goes on over the piece.")
    ] = Relief.NONE,
    hole: Annotated[
        int | None, typer.Option(help="Number of the hole, as --list gives it. Default: the longest.", min=0)
    ] = None,
    list_holes: Annotated[bool, typer.Option("--list", help="List the holes and make nothing.")] = False,
    pass_band: Annotated[
        float, typer.Option(help="Pass band k_PB of the filter that removes the relief.", min=0.001, max=0.5)
    ] = 0.01,
    unit: Annotated[Unit | None, typer.Option(help="Unit of the scans; if not given the file's own, else mm.")] = None,
    schema: Annotated[Schema, typer.Option(help="STEP application protocol.")] = Schema.AP214,
    name: Annotated[str | None, typer.Option(help="Name of the part in the file's header.")] = None,
    picture: Picture = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    timeout: Timeout = None,
    allow_open: AllowOpen = False,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Missing piece of a broken vessel, from the sherds around it."""
    request = {
        "inputs": [str(path) for path in sherds],
        "outputs": [str(path) for path in output or []],
        "thickness": thickness,
        "clearance": clearance,
        "min_wall": min_wall,
        "method": method.value,
        "picks": None if picks is None else str(picks),
        "pass_band": pass_band,
        "hole": hole,
        "relief": relief.value,
        "settle": settle,
        "list_holes": list_holes,
        "unit": None if unit is None else unit.value,
        "schema": schema.value,
        "name": name,
        "picture": None if picture is None else str(picture),
        "allow_open": allow_open,
        "force": force,
        "debug": debug,
    }
    _answer("patch", request, as_json=as_json, quiet=quiet, timeout=timeout)


@app.command()
def fit(
    scan: Annotated[Path, typer.Argument(help="Scan as a triangle mesh, open or closed.")],
    output: Annotated[
        list[Path] | None,
        typer.Option("-o", "--output", help=f"File to write: .obj control mesh, or {' '.join(ENDINGS)}. Repeatable."),
    ] = None,
    surface: Annotated[Surface, typer.Option(help="Scheme of the surface.")] = Surface.LOOP,
    control_points: Annotated[int | None, typer.Option(help="At most so many control points.", min=4)] = None,
    tolerance: Annotated[
        str | None, typer.Option(help="Largest error: a length, or a share of the diagonal as 0.1%.")
    ] = None,
    update: Annotated[Update, typer.Option(help="Rule by which control points move.")] = Update.TANGENT,
    plain: Annotated[bool, typer.Option(help="All control points at once, six rounds, no refinement.")] = False,
    unit: Annotated[Unit | None, typer.Option(help="Unit of the scan; if not given the file's own, else mm.")] = None,
    schema: Annotated[Schema, typer.Option(help="STEP application protocol.")] = Schema.AP214,
    name: Annotated[str | None, typer.Option(help="Name of the part in the file's header.")] = None,
    picture: Picture = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    timeout: Timeout = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Subdivision surface of a scan: its control mesh, and its limit surface as a B-rep."""
    request = {
        "inputs": [str(scan)],
        "outputs": [str(path) for path in output or []],
        "more_endings": [".obj"],
        "surface": surface.value,
        "control_points": control_points,
        "tolerance": tolerance,
        "update": update.value,
        "plain": plain,
        "unit": None if unit is None else unit.value,
        "schema": schema.value,
        "name": name,
        "picture": None if picture is None else str(picture),
        "force": force,
        "debug": debug,
    }
    _answer("fit", request, as_json=as_json, quiet=quiet, timeout=timeout)


@app.command()
def check(
    cad_file: Annotated[Path, typer.Argument(help="STEP, IGES or BREP file.")],
    tolerance: Annotated[float, typer.Option(help="Largest tolerance and gap allowed, in the file's unit.")] = 0.05,
    picture: Picture = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    timeout: Timeout = None,
    allow_open: AllowOpen = False,
    debug: Debug = False,
) -> None:
    """The gate alone: is this file one or more closed, valid solids?"""
    request = {
        "inputs": [str(cad_file)],
        "outputs": [],
        "tolerance": tolerance,
        "picture": None if picture is None else str(picture),
        "allow_open": allow_open,
        "debug": debug,
    }
    _answer("check", request, as_json=as_json, quiet=quiet, timeout=timeout)


@app.command()
def demo(
    directory: Annotated[Path, typer.Option("--directory", "-d", help="Where the files go.")] = Path("demo"),
    seed: Annotated[int, typer.Option(help="Another seed breaks another vessel.")] = 1,
    as_json: AsJson = False,
    quiet: Quiet = False,
    timeout: Timeout = None,
    debug: Debug = False,
) -> None:
    """Make a vessel, break it, lose a sherd, rebuild it, and compare the two."""
    outputs = [str(directory / f"piece{ending}") for ending in (".step", ".stl")]
    request = {
        "inputs": [],
        "outputs": outputs,
        "picture": str(directory / "piece.png"),
        "seed": seed,
        "make_directory": str(directory),
        "debug": debug,
    }
    _answer("demo", request, as_json=as_json, quiet=quiet, timeout=timeout)


@app.command()
def terrain(
    contours: Annotated[
        Path, typer.Argument(help="Contour lines (.geojson .csv), or a height grid (.asc .json .tif) with --interval.")
    ],
    output: Output = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Metres that contours may be smoothed by. Default: a fifth of their points' spacing.", min=1e-6
        ),
    ] = None,
    interval: Annotated[float | None, typer.Option(help="Contour a grid at multiples of so many metres.")] = None,
    attribute: Annotated[str | None, typer.Option(help="Property of the lines that holds their height.")] = None,
    base_depth: Annotated[
        float | None, typer.Option(help="Close to a solid, its base so many metres below the ground.", min=1e-3)
    ] = None,
    base_level: Annotated[
        float | None, typer.Option(help="Close to a solid, its base at this height in metres.")
    ] = None,
    against: Annotated[Path | None, typer.Option(help="Height grid to measure the ground against.")] = None,
    schema: Annotated[Schema, typer.Option(help="STEP application protocol.")] = Schema.AP214,
    name: Annotated[str | None, typer.Option(help="Name of the part in the file's header.")] = None,
    picture: Picture = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    timeout: Timeout = None,
    allow_open: AllowOpen = False,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Smooth mountain of G1 faces, or a solid, from contour lines."""
    request = {
        "inputs": [str(contours)],
        "outputs": [str(path) for path in output or []],
        "tolerance": tolerance,
        "interval": interval,
        "attribute": attribute,
        "base_depth": base_depth,
        "base_level": base_level,
        "against": None if against is None else str(against),
        "schema": schema.value,
        "name": name,
        "header_unit": "M",
        "picture": None if picture is None else str(picture),
        "allow_open": allow_open,
        "force": force,
        "debug": debug,
    }
    _answer("terrain", request, as_json=as_json, quiet=quiet, timeout=timeout)


@app.command()
def views(
    drawing: Annotated[Path, typer.Argument(help="Three-view drawing: DXF or JSON.")],
    output: Annotated[
        list[Path] | None,
        typer.Option("-o", "--output", help=f"File to write ({' '.join(ENDINGS)} .obj .json). Repeatable."),
    ] = None,
    solution: Annotated[int, typer.Option(help="Number of the solid, the most plausible first.", min=1)] = 1,
    all_solutions: Annotated[bool, typer.Option("--all", help="Write every solid, its number in the name.")] = False,
    limit: Annotated[int, typer.Option(help="Solids written with --all, at most.", min=1)] = 100,
    snap: Annotated[
        float | None, typer.Option(help="Ends of lines that lie closer than this are one. Default: by the size.")
    ] = None,
    no_hidden: Annotated[
        bool, typer.Option("--no-hidden", help="The drawing does not tell hidden lines from visible ones.")
    ] = False,
    repair: Annotated[
        bool, typer.Option("--repair", help="Where no solid is drawn like this, change the one line that mends it.")
    ] = False,
    schema: Annotated[Schema, typer.Option(help="STEP application protocol.")] = Schema.AP214,
    name: Annotated[str | None, typer.Option(help="Name of the part in the file's header.")] = None,
    picture: Picture = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    timeout: Timeout = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Every solid with planar faces that a three-view drawing can mean."""
    request = {
        "inputs": [str(drawing)],
        "outputs": [str(path) for path in output or []],
        "more_endings": (".obj", ".json"),
        "solution": solution,
        "all": all_solutions,
        "limit": limit,
        "snap": snap,
        "no_hidden": no_hidden,
        "repair": repair,
        "schema": schema.value,
        "name": name,
        "picture": None if picture is None else str(picture),
        "force": force,
        "debug": debug,
    }
    _answer("views", request, as_json=as_json, quiet=quiet, timeout=timeout)


def _answer(command: str, request: dict[str, Any], *, as_json: bool, quiet: bool, timeout: float | None) -> None:
    """Run the job, print its result on stdout and everything else on stderr, and leave with its status."""
    try:
        check_destinations(request)
        outcome = _watched(command, request, quiet=quiet or not sys.stderr.isatty(), timeout=timeout)
    except InputError as problem:
        outcome = Outcome(Exit.BAD_INPUT, reasons=(str(problem),))
    except KeyboardInterrupt:
        outcome = Outcome(Exit.INTERRUPTED, reasons=("interrupted; nothing was written.",))
    answer = outcome.result or refusal(command, request["inputs"], outcome.reasons)
    if outcome.result is None:
        _complain(command, outcome, request["debug"])
    if as_json:
        typer.echo(json.dumps(answer))
    elif outcome.result is not None:
        typer.echo(summary(answer))
    raise typer.Exit(outcome.status)


def _complain(command: str, outcome: Outcome, debug: bool) -> None:
    for reason in outcome.reasons:
        typer.echo(f"recon {command}: {reason}", err=True)
    if outcome.trace and debug:
        typer.echo(outcome.trace, err=True)
    elif outcome.trace:
        typer.echo("Run it again with --debug and send what it prints to the authors.", err=True)


def _watched(command: str, request: dict[str, Any], *, quiet: bool, timeout: float | None) -> Outcome:
    if quiet:
        return run(JOBS[command], request, timeout=timeout)
    from rich.console import Console

    console = Console(stderr=True)
    with console.status("starting") as status:
        return run(JOBS[command], request, timeout=timeout, doing=_shown(status.update), note=_shown(console.print))


def _shown(show: Callable[[str], object]) -> Callable[[str], None]:
    from rich.markup import escape

    return lambda text: (show(escape(text)), None)[1]
