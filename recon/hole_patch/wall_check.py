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

__all__ = [
    "MOST_OFF",
    "WallFigures",
    "WallsStandOff",
    "check_fracture_met",
    "check_fracture_unfolded",
    "check_walls_go_on",
    "wall_figures",
]

Floats = NDArray[np.float64]

MOST_OFF = 0.05  # of a wall's edge; right pieces have a hundredth at most
FOOT = 0.1  # of the vessel's height, from below
ALONG = 200  # places along a quarter of the fracture
FINELY = 8  # places between two knots of the fracture's wall, where folds are looked for
DOWN = np.array([0.0, 0.02, 0.1, 0.25, 0.5, 0.75, 0.9, 0.98, 1.0])  # its rungs
FOLDED = -0.5  # cosine between normals of places beside each other


class WallsStandOff(NoSurface):
    """The walls around a piece do not go on in its own."""


@dataclass(frozen=True, eq=False)
class WallFigures:
    """How the walls around a piece go on in its own.

    outer, inner  share of each wall's measured edge from which the piece's stands off
    place         (3,) in the middle of that, on the wall of which it is more
    at_foot       whether that lies in the lowest tenth of the vessel
    """

    outer: float
    inner: float
    place: Floats
    at_foot: bool = False

    def problem(self, most: float = MOST_OFF) -> str:
        """What is wrong with the walls of the piece, or nothing where no larger share stands off."""
        share, name = max((self.outer, "outer"), (self.inner, "inner"))
        if share <= most:
            return ""
        x, y, z = self.place
        reason = (
            "It lies at the vessel's foot, which is too narrow or too deep there for the profile to follow"
            if self.at_foot
            else "A handle, a spout or a swelling sat there, which no wheel tells"
        )
        return (
            f"over {share:.0%} of its edge, near ({x:.3g}, {y:.3g}, {z:.3g}), the {name} wall around does not go on in"
            f" it ({most:.0%} allowed). {reason}, or fracture was taken for wall"
        )


def check_walls_go_on(
    outer: TrimmedSurface, inner: TrimmedSurface, around: Surroundings, most: float = MOST_OFF
) -> None:
    """Raises  WallsStandOff, with the reason, when the walls between which a piece is to be made cannot be right: where
    they stand off from more than a share of their edges.
    """
    problem = wall_figures(outer, inner, around).problem(most)
    if problem:
        raise WallsStandOff(f"The piece cannot be right: {problem}.")


def wall_figures(outer: TrimmedSurface, inner: TrimmedSurface, around: Surroundings) -> WallFigures:
    """Measure the walls of a piece against its neighbours'; those not measured cannot be off."""
    edges = [around.outer.edge] if around.inner is None else [around.outer.edge, around.inner.edge]
    near = NEAR * float(np.median(cKDTree(_loop(inner)).query(_loop(outer))[0]))
    off = [_off(sheet, edge, near) for sheet, edge in zip((outer, inner), edges)]
    shares = [share for share, _ in off]
    place = off[int(np.argmax(shares))][1]
    return WallFigures(shares[0], shares[1] if len(shares) > 1 else 0.0, place, _at_foot(place, around))


def check_fracture_met(piece: ThickPiece, around: Surroundings, *, clearance: float = 0.0) -> None:
    """Raises  NoSurface when the piece does not lie against its neighbours' fracture, but for the clearance."""
    rungs = np.concatenate(
        [wall.grid(np.linspace(*wall.domain[0], ALONG), np.linspace(*wall.domain[1], 9)) for wall in piece.wall]
    )
    thick = float(np.median(np.linalg.norm(rungs[:, 0] - rungs[:, -1], axis=1)))
    met = fracture_met(rungs.reshape(-1, 3), around, NEAR * thick + clearance, thick)
    if met < LEAST_FRACTURE:
        raise NoSurface(
            f"The piece cannot be right: it meets {met:.0%} of its neighbours' fracture only ({LEAST_FRACTURE:.0%}"
            " needed). The hole's edge, or what is wall and what is fracture, was misread there."
        )


def check_fracture_unfolded(piece: ThickPiece) -> None:
    """Raises  NoSurface, with the place, when the fracture of a piece folds back on itself: on the side of a deep and
    slanted foot ring its rungs run along its edge.
    """
    for wall in piece.wall:
        knots = np.unique(wall.knots_u)
        along = np.interp(np.arange(FINELY * (len(knots) - 1) + 1) / FINELY, np.arange(len(knots)), knots)
        places = np.stack(np.meshgrid(along, DOWN, indexing="ij"), axis=-1).reshape(-1, 2)
        normals = wall.normal(places).reshape(len(along), len(DOWN), 3)
        turned = np.einsum("ijk,ijk->ij", normals[1:], normals[:-1])
        if turned.min() < FOLDED:
            i, j = np.unravel_index(int(turned.argmin()), turned.shape)
            x, y, z = wall.point(places.reshape(len(along), len(DOWN), 2)[i, j][None])[0]
            raise NoSurface(
                f"The piece cannot be made: its fracture folds back on itself near ({x:.3g}, {y:.3g}, {z:.3g}), where"
                " the edge of the hole turns too sharply for it, as it does along a deep and slanted foot ring."
            )


def _loop(sheet: TrimmedSurface) -> Floats:
    return sheet.surface.point(sheet.loops[0].polygon(256))


def _off(sheet: TrimmedSurface, edge: HoleEdge, near: float) -> tuple[float, Floats]:
    """Share of the measured points of an edge farther than a length from the sheet's loop, and the middle of them."""
    measured = edge.points[edge.sherds >= 0]
    off = cKDTree(_loop(sheet)).query(measured)[0] > near
    return float(off.mean()), np.asarray(np.median(measured[off] if off.any() else measured, axis=0))


def _at_foot(place: Floats, around: Surroundings) -> bool:
    if around.axis is None:
        return False
    height = around.axis.cylindrical(around.outer.measured.vertices)[:, 2]
    low, high = np.quantile(height, [0.001, 0.999])
    return bool(around.axis.cylindrical(place[None])[0, 2] < low + FOOT * (high - low))
