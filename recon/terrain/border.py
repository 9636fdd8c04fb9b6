"""What a map tile shares with the tiles beside it: the vertices on their common border, and the jets there.

    tile A    |    tile B          o  where a contour crosses: place, height, tangent and curvature of the contour
   ------o----o----o------         +  free vertices between
              |
              +                    an edge of the border is straight in plan; its height and the slope across it follow
              |                    from the jets at its ends (`recon.terrain.curve_mesh`), so they are one for A and B
   ------o----o----o------
              |

Where a contour crosses with tangent T, curvature k and slope m to its left, the jets agree with it from both sides:
the gradient is m N, and T . H T = -m k.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import BadGeometry
from recon.geometry.contour_map import ContourMap
from recon.terrain.second_derivatives import VertexJets
from recon.terrain.tiling import Tiling

__all__ = ["Border", "BorderVertices"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SAME = 1e-6  # of the spacing of points: two places that are one
ASIDE = 2.0  # times the way that the end of a contour is moved: points nearer to it are left out


@dataclass(frozen=True, eq=False)
class BorderVertices:
    """Vertices on borders of map tiles, in coordinates from the map's origin.

    points     (n, 2)
    jets       of n vertices; the height of a crossing is that of its contour
    crossing   (n,) whether a contour crosses there
    met        (n, 2) place at which the grid's own contour meets the border, which the fitted one may miss by a little
    tangent    (n, 2) unit tangent of the contour, the higher ground on its left
    curvature  (n,) signed
    low, high  (n,) heights of the contours between which a free vertex lies
    """

    points: Floats
    jets: VertexJets
    crossing: NDArray[np.bool_]
    met: Floats
    tangent: Floats
    curvature: Floats
    low: Floats
    high: Floats

    @classmethod
    def joined(cls, parts: Sequence["BorderVertices"]) -> "BorderVertices":
        """All vertices of several parts, in their order."""
        rows = {
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in ("points", "crossing", "met", "tangent", "curvature", "low", "high")
        }
        return cls(jets=VertexJets.joined([part.jets for part in parts]), **rows)

    @classmethod
    def none(cls) -> "BorderVertices":
        """No vertices."""
        row, pair = np.empty(0), np.empty((0, 2))
        jets = VertexJets(row, pair, np.empty((0, 2, 2)))
        return cls(pair, jets, np.empty(0, dtype=bool), pair, pair, row, row, row)


@dataclass(frozen=True, eq=False)
class Border:
    """The border of one map: what its contours and vertices there are bound to.

    origin    (2,) place of the map at which coordinates are zero
    spacing   metres between neighbouring points of the contours, on the whole map
    interval  metres of height between neighbouring contours
    vertices  all those on the border; none where the map has no neighbours
    """

    origin: Floats
    spacing: float
    interval: float
    vertices: BorderVertices

    @property
    def free_points(self) -> Floats:
        """(n, 2) the free vertices on the border that are told."""
        return self.vertices.points[~self.vertices.crossing]

    def joined(self, contours: ContourMap) -> ContourMap:
        """The contours with their ends at the crossings; those that end on the map's own border stay.

        Raises  BadGeometry where a crossing has no contour, or two.
        """
        told = self.vertices
        if not len(told.points):
            return contours
        lines, used = [], np.zeros(len(told.points), dtype=np.int64)
        for line, height in zip(contours.lines, contours.heights.tolist()):
            if (line[0] != line[-1]).any():
                rows = self._rows_met(line[[0, -1]], height)
                used[rows[rows >= 0]] += 1
                line = _between(line, np.where(rows[:, None] >= 0, told.points[rows], line[[0, -1]]))
            lines.append(line)
        if (used[told.crossing] != 1).any():
            x, y = told.met[told.crossing][np.argmax(used[told.crossing] != 1)] + self.origin
            raise BadGeometry("tile", f"its border tells of a contour near ({x:.1f}, {y:.1f}) that it does not have")
        return contours.with_lines(lines, contours.heights)

    def _rows_met(self, ends: Floats, height: float) -> Ints:
        """(2,) the crossings at both ends of a contour, -1 for none."""
        told = self.vertices
        level = np.flatnonzero(told.crossing & (told.jets.height == height))
        if not len(level):
            return np.array([-1, -1])
        way, row = cKDTree(told.met[level]).query(ends)
        return np.where(way <= SAME * self.spacing, level[row], -1)

    def line_ends(self, contours: ContourMap) -> Floats:
        """(C, 2, 2, 2) tangent and curvature vector at the first and the last point of every contour, NaN in rings."""
        told = self.vertices
        out = np.full((len(contours.lines), 2, 2, 2), np.nan)
        place = {point.tobytes(): row for row, point in enumerate(told.points)}
        normal = np.column_stack([-told.tangent[:, 1], told.tangent[:, 0]])
        bend = told.curvature[:, None] * normal
        for c, line in enumerate(contours.lines):
            for end in (0, 1):
                row = place.get(line[-end].tobytes(), -1)
                if row >= 0 and (line[0] != line[-1]).any():
                    out[c, end] = told.tangent[row], bend[row]
        return out

    def rows(self, tiling: Tiling) -> Ints:
        """(n,) the vertices of a tiling that those of the border are."""
        if not len(self.vertices.points):
            return np.empty(0, dtype=np.int64)
        way, row = cKDTree(tiling.points).query(self.vertices.points)
        if way.max() > 0.0:
            raise BadGeometry("tile", f"lacks {int((way > 0).sum())} vertices of its border")
        return np.asarray(row, dtype=np.int64)

    def bands(self, rows: Ints) -> tuple[Ints, Floats, Floats]:
        """Free vertices among the `rows` of a tiling, and the heights of the contours between which they lie."""
        free = ~self.vertices.crossing
        return rows[free], self.vertices.low[free], self.vertices.high[free]


def _between(line: Floats, ends: Floats) -> Floats:
    """The line (n, 2) with other ends (2, 2), without its points beside them: within twice the way that they moved."""
    aside = ASIDE * np.linalg.norm(line[[0, -1]] - ends, axis=1)
    step = np.linalg.norm(np.diff(line, axis=0), axis=1)
    at = np.r_[0.0, np.cumsum(step)]
    inner = (at > aside[0]) & (at < at[-1] - aside[1])
    inner[[0, -1]] = False
    return np.vstack([ends[0], line[inner], ends[1]])
