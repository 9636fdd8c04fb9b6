"""Three points picked by hand: set on the wall, and looked at before a box is set up on them.

Paper  [kinoshita], section 3.2 step 1, where they are picked with the mouse.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import BadOption
from recon.hole_patch.box import surrounds
from recon.hole_patch.surroundings import Wall
from recon.numerics.planes import circle_through

__all__ = ["snapped_picks"]

Floats = NDArray[np.float64]
FARTHEST = 2.0
LEAST_ANGLE = np.radians(5.0)


def snapped_picks(picks: Floats, wall: Wall) -> Floats:
    """(3, 3) wall vertices nearest to three picks (3, 3).

    Raises  BadOption when a pick lies more than 2 mm from the wall, when the three lie on a line or when the circle
            through them does not surround the hole.
    """
    away, nearest = cKDTree(wall.plain.vertices).query(picks)
    if away.max() > FARTHEST:
        far = int(np.argmax(away))
        raise BadOption(
            "picks", f"point {far + 1} lies {away[far]:.1f} mm from the wall, where at most {FARTHEST:g} mm are allowed"
        )
    points = wall.plain.vertices[nearest]
    if _least_angle(points) < LEAST_ANGLE:
        raise BadOption(
            "picks", "the three points lie on a line, or two of them on one vertex; spread them around the hole"
        )
    centres, radii, normals = circle_through(*(points[i : i + 1] for i in range(3)))
    if not surrounds(centres[0], normals[0], float(radii[0]), wall.edge.points):
        raise BadOption("picks", "the circle through the three points does not surround the hole; move them outward")
    return np.asarray(points)


def _least_angle(points: Floats) -> float:
    """Smallest angle of a triangle, in radians; 0 when two corners are one."""
    legs = np.roll(points, -1, axis=0) - points
    lengths = np.linalg.norm(legs, axis=1)
    if lengths.min() == 0:
        return 0.0
    cosines = -np.einsum("ij,ij->i", legs, np.roll(legs, 1, axis=0)) / (lengths * np.roll(lengths, 1))
    return float(np.arccos(np.clip(cosines, -1.0, 1.0)).min())
