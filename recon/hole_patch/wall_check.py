"""Whether a piece between two walls can be the lost one: what its neighbours say, beside the kernel's gate.

A wheel tells what a wall held; it knows nothing of a handle, or of a swelling that a thumb left. Where one sat in the
hole, its root still shows on the neighbours: along a stretch of the edge their wall does not go on in the piece's.

    neighbour | piece | neighbour
    __________|_______|__________    outer wall: goes on
    ___       |_______|__________    inner wall: the neighbour's swelling ends at the piece, which knows none
       `------'
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import NoSurface
from recon.geometry.trimmed import ThickPiece, TrimmedSurface
from recon.hole_patch.rim_check import LEAST_FRACTURE, NEAR, fracture_met
from recon.hole_patch.surroundings import HoleEdge, Surroundings

__all__ = ["WallFigures", "check_wall_piece", "wall_figures"]

Floats = NDArray[np.float64]

MOST_OFF = 0.05  # of a wall's edge; right pieces have a hundredth at most
ALONG = 200  # places along a quarter of the fracture


@dataclass(frozen=True, eq=False)
class WallFigures:
    """What was measured on a piece between two walls.

    outer, inner  share of each wall's measured edge from which the piece's stands off
    place         (3,) in the middle of that, on the wall of which it is more
    fracture      share of the neighbours' fracture, by area, that the piece meets; 1 where none was scanned
    """

    outer: float
    inner: float
    place: Floats
    fracture: float

    def problem(self) -> str:
        """What is wrong with the piece, or nothing."""
        share, name = max((self.outer, "outer"), (self.inner, "inner"))
        if share > MOST_OFF:
            x, y, z = self.place
            return (
                f"over {share:.0%} of its edge, near ({x:.3g}, {y:.3g}, {z:.3g}), the {name} wall around does not go"
                f" on in it ({MOST_OFF:.0%} allowed)"
            )
        if self.fracture < LEAST_FRACTURE:
            return f"it meets {self.fracture:.0%} of its neighbours' fracture only ({LEAST_FRACTURE:.0%} needed)"
        return ""


def check_wall_piece(piece: ThickPiece, around: Surroundings, *, clearance: float = 0.0) -> None:
    """Raises  NoSurface, with the reason, when the piece cannot be the lost one; clearance as of `wall_figures`."""
    problem = wall_figures(piece, around, clearance=clearance).problem()
    if problem:
        raise NoSurface(
            f"The piece cannot be right: {problem}. A handle, a spout or a swelling sat there, which no wheel tells, or"
            " fracture was taken for wall."
        )


def wall_figures(piece: ThickPiece, around: Surroundings, *, clearance: float = 0.0) -> WallFigures:
    """Measure a piece between two walls against its neighbours.

    clearance  in millimetres, that it keeps from them
    """
    rungs = np.concatenate(
        [wall.grid(np.linspace(*wall.domain[0], ALONG), np.linspace(*wall.domain[1], 9)) for wall in piece.wall]
    )
    thick = float(np.median(np.linalg.norm(rungs[:, 0] - rungs[:, -1], axis=1)))
    near = NEAR * thick + clearance
    edges = [around.outer.edge] if around.inner is None else [around.outer.edge, around.inner.edge]
    off = [_off(sheet, edge, near) for sheet, edge in zip((piece.outer, piece.inner), edges)]
    shares = [share for share, _ in off]
    return WallFigures(
        outer=shares[0],
        inner=shares[1] if len(shares) > 1 else 0.0,
        place=off[int(np.argmax(shares))][1],
        fracture=fracture_met(rungs.reshape(-1, 3), around, near),
    )


def _off(sheet: TrimmedSurface, edge: HoleEdge, near: float) -> tuple[float, Floats]:
    """Share of the measured points of an edge farther than a length from the sheet's loop, and the middle of them."""
    measured = edge.points[edge.sherds >= 0]
    loop = sheet.surface.point(sheet.loops[0].polygon(256))
    off = cKDTree(loop).query(measured)[0] > near
    return float(off.mean()), np.asarray(np.median(measured[off] if off.any() else measured, axis=0))
