"""Three-view drawings: straight segments in three views, each drawn through or dashed.

        top  x,y                each view is a right-handed frame (u, v, toward the viewer):
         +---+                     front  (x, z), seen from -y
         |   |                     top    (x, y), seen from +z
         +---+                     side   (y, z), seen from +x
front    +---+  +--+  side
 x,z     |   |  |  |  y,z
         +---+  +--+
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry
from recon.geometry.arrays import frozen_bools, frozen_floats

__all__ = ["PROJECTIONS", "DrawnView", "Projection", "ThreeViews"]


@dataclass(frozen=True)
class Projection:
    """One of the three directions of sight.

    name    what the view is called
    axes    coordinate axes that run to the right and upward in the view
    depth   coordinate axis along the line of sight
    toward  +1 when the viewer stands on the positive side of that axis, -1 otherwise
    """

    name: str
    axes: tuple[int, int]
    depth: int
    toward: int


PROJECTIONS = (
    Projection("front", (0, 2), 1, -1),
    Projection("top", (0, 1), 2, +1),
    Projection("side", (1, 2), 0, +1),
)


@dataclass(frozen=True, eq=False)
class DrawnView:
    """The segments of one view.

    segments  (n, 2, 2) both ends of every segment, in the view's own (u, v)
    hidden    (n,) whether a segment is dashed
    Raises    BadGeometry when the shapes differ or a coordinate is not finite.
    """

    segments: NDArray[np.float64]
    hidden: NDArray[np.bool_]

    def __post_init__(self) -> None:
        object.__setattr__(self, "segments", frozen_floats(self.segments, (None, 2, 2), "view: segments"))
        object.__setattr__(self, "hidden", frozen_bools(self.hidden, (len(self.segments),), "view: hidden"))

    @property
    def n_segments(self) -> int:
        return len(self.segments)


@dataclass(frozen=True, eq=False)
class ThreeViews:
    """A drawing: front (x, z), top (x, y) and side (y, z), in one unit and with one origin.

    Raises  BadGeometry when a view is empty.
    """

    front: DrawnView
    top: DrawnView
    side: DrawnView

    def __post_init__(self) -> None:
        for projection, view in self:
            if not view.n_segments:
                raise BadGeometry("drawing", f"the {projection.name} view holds no segments")

    def __iter__(self) -> Iterator[tuple[Projection, DrawnView]]:
        return zip(PROJECTIONS, (self.front, self.top, self.side))

    def extent(self) -> float:
        """Longest side of the box that the views describe."""
        corners = [view.segments.reshape(-1, 2) for _, view in self]
        return max(float(np.ptp(points, axis=0).max()) for points in corners)
