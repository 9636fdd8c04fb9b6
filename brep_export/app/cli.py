"""The command `recon`. Nothing heavy is imported here or by the commands: `recon --help` has to answer at once."""

import sys
from typing import Annotated

import typer

from brep_export.app.commands.batch import batch
from brep_export.app.commands.check import check
from brep_export.app.commands.curve import curve
from brep_export.app.commands.demo import demo
from brep_export.app.commands.fit import fit
from brep_export.app.commands.formats import formats
from brep_export.app.commands.patch import patch
from brep_export.app.commands.terrain import terrain
from brep_export.app.commands.views import views
from brep_export.app.commands.voxels import voxels
from brep_export.app.versions import kernel_version
from recon.version import __version__

__all__ = ["app", "main"]

COMMANDS = (patch, fit, curve, terrain, voxels, views, check, batch, demo, formats)

app = typer.Typer(
    name="recon",
    help="Measurements into CAD solids: closed, checked B-reps as STEP, IGES, BREP, and meshes to print.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in COMMANDS:
    app.command()(command)


def main() -> None:
    """Entry point of the console script."""
    app()


def _version(wanted: bool) -> None:
    if wanted:
        python = ".".join(map(str, sys.version_info[:3]))
        typer.echo(f"recon-brep {__version__} (OpenCascade {kernel_version()}, Python {python})")
        raise typer.Exit


@app.callback()
def _top(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_version,
            is_eager=True,
            help="Print the versions of this, of the kernel and of Python, and stop.",
        ),
    ] = False,
) -> None:
    del version
