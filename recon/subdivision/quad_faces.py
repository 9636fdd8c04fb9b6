"""The Catmull-Clark surface as faces for a solid: rectangles of exact bicubics, and caps around irregular vertices.

    rectangle of m x n quads   one bicubic B-spline surface with unit spans: exact
    cap                        one bi-quintic Bezier patch a quad (`caps`)

Both are laid over the same quads, so what two of them share is a row of the quads' edges: the row becomes one edge, cut
where a third surface begins.

Where a cap is too far from the limit surface the mesh is refined once more: the caps shrink, and the rectangles lose
the knots that refinement put into them (`uniform_splines`).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.patches import PatchMosaic
from recon.subdivision import catmull_clark
from recon.subdivision.caps import Caps, cap_nets
from recon.subdivision.layout import Layout, Rectangle, isolated, rectangles
from recon.subdivision.limit_surface import patch_arrays
from recon.subdivision.limit_tables import CATMULL_CLARK
from recon.subdivision.mosaic import Tile, joined
from recon.subdivision.sheets import Sheets
from recon.subdivision.uniform_splines import clamped_cubic

__all__ = ["LimitFaces", "catmull_clark_faces"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ACCURACY = 2e-3
MAX_STEPS, MAX_QUADS = 3, 250_000


class LimitFaces(NamedTuple):
    """Faces of a limit surface, and how true they are.

    mosaic      the faces with the edges that they share
    n_exact     how many of them are the limit surface itself; the others come after them
    off         the largest distance found between the others and the limit surface
    n_quads     quads (or triangles) that the faces were laid over
    """

    mosaic: PatchMosaic
    n_exact: int
    off: float
    n_quads: int


def catmull_clark_faces(mesh: ControlMesh, *, grouped: bool = True, accuracy: float = ACCURACY) -> LimitFaces:
    """Faces of the Catmull-Clark surface of a quadrilateral control mesh.

    grouped   whether regular quads become rectangles; else each is a face of its own
    accuracy  how far caps may stay from the limit surface, in mean edge lengths of the control mesh; reached as far as
              three refinements and a quarter of a million quads go
    Promises  tangent planes agree along every edge that is no crease, but at corners where the surface has none;
              regular quads are exact.
    Raises    BadGeometry when a face is no quadrilateral or a vertex has too many faces; NotManifold.
    """
    faces = mesh.faces_of(4)
    edge = np.linalg.norm(mesh.vertices[faces] - mesh.vertices[np.roll(faces, -1, axis=1)], axis=2).mean()
    for steps in range(MAX_STEPS + 1):
        layout = isolated(mesh, steps)
        whole = catmull_clark.extended(layout.sheets)
        points = whole.matrix @ (layout.points @ mesh.vertices)
        caps = _caps(layout, whole.sheets, points)
        off = float(caps.off.max(initial=0.0))
        if off <= accuracy * edge or 4 * len(layout.faces) > MAX_QUADS:
            break
    regular = np.flatnonzero(layout.regular)
    rings = np.zeros((len(layout.regular), 16), dtype=np.int64)
    rings[regular] = catmull_clark.regular_rings(whole.sheets, regular)
    if grouped:
        boxes = rectangles(layout.sheets.across, layout.regular)
    else:
        boxes = [Rectangle(np.array([[f]]), np.zeros((1, 1), dtype=np.int64)) for f in regular.tolist()]
    tiles = [_bicubic(box, rings, points) for box in boxes] + _cap_tiles(caps)
    mosaic = joined(layout.faces, layout.across, layout.sheets.across >= 0, tiles)
    return LimitFaces(mosaic, len(boxes), off, len(layout.faces))


def _caps(layout: Layout, whole: Sheets, points: Floats) -> Caps:
    irregular = np.flatnonzero(~layout.regular)
    if not len(irregular):
        return Caps(irregular, np.empty((0, 6, 6, 3)), np.empty(0))
    arrays = patch_arrays(CATMULL_CLARK, layout.sheets, whole)
    around = catmull_clark.regular_rings(whole, irregular)
    return cap_nets(layout.sheets, arrays, around, points, irregular)


def _cap_tiles(caps: Caps) -> list[Tile]:
    turns, knots = np.zeros((1, 1), dtype=np.int64), np.repeat([0.0, 1.0], 6)
    tiles = []
    for face, net in zip(caps.faces, caps.nets):
        surface = BSplineSurface(5, 5, knots, knots, net)
        curves = (net[:, 0], net[5], net[:, 5], net[0])
        tiles.append(Tile(np.array([[face]]), turns, surface, tuple(curves), _whole_side))
    return tiles


def _whole_side(points: Floats, start: int, end: int) -> BSplineCurve:
    return BSplineCurve(len(points) - 1, np.repeat([0.0, float(end - start)], len(points)), points)


_i, _j = np.meshgrid(np.arange(4), np.arange(4))  # place (i, j) in a ring; entry 4 j + i
TURNED = np.stack(  # the entries of a ring whose bottom is side 0, 1, 2, 3, row by row
    [4 * j + i for i, j in ((_i, _j), (3 - _j, _i), (3 - _i, 3 - _j), (_j, 3 - _i))]
)


def _bicubic(box: Rectangle, rings: Ints, points: Floats) -> Tile:
    n, m = box.faces.shape
    net = np.zeros((n + 3, m + 3), dtype=np.int64)
    own = rings[box.faces][np.arange(n)[:, None, None, None], np.arange(m)[:, None, None], TURNED[box.turns]]
    for j in range(n):
        for i in range(m):
            net[j : j + 4, i : i + 4] = own[j, i]
    uniform = points[net].transpose(1, 0, 2)  # [along u, along v]
    knots_u, along_u = clamped_cubic(uniform)
    knots_v, along_v = clamped_cubic(along_u.transpose(1, 0, 2))
    surface = BSplineSurface(3, 3, knots_u, knots_v, along_v.transpose(1, 0, 2))
    edge = np.array([1.0, 4.0, 1.0]) / 6.0
    curves = (
        np.einsum("j,ijx->ix", edge, uniform[:, :3]),
        np.einsum("i,ijx->jx", edge, uniform[-3:]),
        np.einsum("j,ijx->ix", edge, uniform[:, -3:]),
        np.einsum("i,ijx->jx", edge, uniform[:3]),
    )
    return Tile(box.faces, box.turns, surface, curves, _part_of_side)


def _part_of_side(points: Floats, start: int, end: int) -> BSplineCurve:
    """The spans from start to end of a uniform cubic B-spline."""
    return BSplineCurve(3, *clamped_cubic(points[start : end + 3]))
