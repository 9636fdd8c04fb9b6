"""The missing piece beside programs that fill holes: on the same vessels, against the same truth.

python benchmarks/hole_patch_peers.py [FOLDER]     FOLDER: scanned vessels, default ../shared/data/vessels

What the fillers are given. They ask for one mesh with a hole; sherds are many, with cracks between. So all get the
outer wall of the closed sherds as this package settles and labels it, stitched into one mesh round the same edge of the
hole (`vessels/stitched_wall.py`): once as scanned, and once with the relief filtered off as one sheet and the hole
grown by what the filter could not reach. Of the two results the better one counts. Stitching and filtering cost them
nothing; our seconds run from the sherds to the solid.

What is measured, in millimetres. `edge`: the scanned edge of the hole from the surface. `inside`: the surface, within
the edge, from the vessel before its relief was pressed, whose inner wall counts too: a surface that sinks by more than
half the wall's thickness looks better than it is. `x ours`: mean inside over ours. Every program runs in a process of
its own, for a minute at most; `MB` is what its memory grew by at most.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from brep_export.app.workshop import run
from recon.errors import ReconError
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.settling import settle
from recon.hole_patch.sherds import surroundings
from recon.numerics.distance import closest_points
from tables import Table, machine
from vessels.cases import SCANNED, Case, deviation, made_cases, scanned_cases
from vessels.fillers import FILLERS
from vessels.stitched_wall import StitchedWall, stitched_wall, without_relief

LIMIT = 60.0  # seconds
OURS = "recon-brep"


@dataclass(frozen=True)
class Result:
    """What a program made of a hole, from what; mean and largest distances at the edge and inside."""

    given: str
    yields: str
    seconds: float
    mb: float
    edge: tuple[float, float]
    inside: tuple[float, float]


def ours(case: Case) -> Result | str:
    """The piece of this package, or why there is none."""
    request = {"sherds": [(sherd.vertices, sherd.face_vertices) for sherd in case.closed]}
    answer = run("vessels.fillers:patch", request, timeout=LIMIT)
    if answer.result is None:
        return "; ".join(answer.reasons)
    ((given, (vertices, faces, meter)),) = answer.result["filled"].items()
    inside = _inside(TriangleMesh(vertices, faces), case)
    return Result(given, answer.result["yields"], meter["seconds"], meter["mb"], answer.result["edge"], inside)


def filled(name: str, walls: dict[str, StitchedWall], case: Case) -> Result | str:
    """The better of a program's results, or why there is none."""
    given = {key: (wall.mesh.vertices, wall.mesh.face_vertices, wall.hole) for key, wall in walls.items()}
    answer = run("vessels.fillers:fill", {"filler": name, "walls": given}, timeout=LIMIT)
    if answer.result is None:
        return "; ".join(answer.reasons)
    found: list[Result] = []
    for key, (vertices, faces, meter) in answer.result["filled"].items():
        surface = walls[key].in_hole(TriangleMesh(vertices, faces))
        if surface.n_faces:
            away = closest_points(walls[key].edge, surface.vertices, surface.face_vertices).distances
            edge = (float(away.mean()), float(away.max()))
            inside = _inside(surface, case)
            found.append(Result(key, FILLERS[name].yields, meter["seconds"], meter["mb"], edge, inside))
    return min(found, key=lambda result: result.inside[0]) if found else "nothing was filled"


def _inside(surface: TriangleMesh, case: Case) -> tuple[float, float]:
    deep = deviation(surface, case.plain)
    return deep.mean, deep.maximum


def results(case: Case) -> Iterator[tuple[str, Result | str]]:
    """Every program's name and result, ours first."""
    yield OURS, ours(case)
    try:
        wall = stitched_wall(surroundings(settle(case.closed).sherds).outer)
    except ReconError as refusal:
        yield "fillers", f"no closed hole in one wall to give them: {refusal}"
        return
    walls = {"scanned": wall, "filtered": without_relief(wall)}
    for name, filler in FILLERS.items():
        yield name, filled(name, walls, case) if filler.is_installed() else "not installed"


def cells(result: Result | str, our_mean: float) -> tuple[object, ...]:
    if isinstance(result, str):
        return (result,)
    ratio = result.inside[0] / our_mean
    return result.given, result.yields, result.seconds, result.mb, *result.edge, *result.inside, ratio


def compared(case: Case, table: Table) -> float:
    """Print the rows of a vessel; our mean over that of the best mesh filler, nan where one of them is missing."""
    our_mean, best = np.nan, np.nan
    for name, result in results(case):
        if isinstance(result, Result) and name == OURS:
            our_mean = result.inside[0]
        elif isinstance(result, Result) and result.yields == "mesh":
            best = np.fmin(best, result.inside[0])
        table.row(case.name, name, *cells(result, our_mean))
    return our_mean / best


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else SCANNED
    distances = dict.fromkeys(("edge mean", "edge max", "inside mean", "inside max"), "8.3f")
    print(f"{machine()}\n")
    table = Table(
        {"vessel": "16", "method": "22", "given": "9", "yields": "6", "seconds": "7.2f", "MB": "7.0f"}
        | distances
        | {"times ours": "8.1f"}
    )
    ratios = {case.name: compared(case, table) for case in chain(made_cases(), scanned_cases(folder))}
    shares = ", ".join(f"{name} {ratio:.2f}" for name, ratio in ratios.items())
    print(f"\nOur mean inside over that of the best mesh filler: {shares}")
    if missing := sorted({filler.package for filler in FILLERS.values() if not filler.is_installed()}):
        print(f"Not installed: {', '.join(missing)}; all of them come with: pip install 'recon-brep[peers]'")


if __name__ == "__main__":
    main()
