"""The Catmull-Clark surface as faces for a solid: rectangles of exact bicubics, and caps around irregular vertices.

    rectangle of m x n quads   one bicubic B-spline surface with unit spans: exact
    cap                        one bi-quintic Bezier patch a quad (`caps`)

Both are laid over the same quads, so what two of them share is a row of the quads' edges: the row becomes one edge, cut
where a third surface begins.

A rectangle's points are the control points of a uniform B-spline. Its knots are clamped by the polar form f of the
curve: f(0, 0, 0) = (p0 + 4 p1 + p2) / 6 and f(0, 0, 1) = (2 p1 + p2) / 3 at the start, the rest as it was.
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

__all__ = ["LimitFaces", "catmull_clark_faces"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


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


def catmull_clark_faces(mesh: ControlMesh, *, grouped: bool = True) -> LimitFaces:
    """Faces of the Catmull-Clark surface of a quadrilateral control mesh.

    grouped   whether regular quads become rectangles; else each is a face of its own
    Promises  tangent planes agree along every edge that is no crease, but at corners where the surface has none;
              regular quads are exact.
    Raises    BadGeometry when a face is no quadrilateral or a vertex has too many faces; NotManifold.
    """
    layout = isolated(mesh)
    points = layout.points @ mesh.vertices
    whole = catmull_clark.extended(layout.sheets)
    all_points = whole.matrix @ points
    regular, irregular = np.flatnonzero(layout.regular), np.flatnonzero(~layout.regular)
    rings = np.zeros((len(layout.regular), 16), dtype=np.int64)
    rings[regular] = catmull_clark.regular_rings(whole.sheets, regular)
    if grouped:
        boxes = rectangles(layout.sheets.across, layout.regular)
    else:
        boxes = [Rectangle(np.array([[f]]), np.zeros((1, 1), dtype=np.int64)) for f in regular.tolist()]
    tiles = [_bicubic(box, rings, all_points) for box in boxes]
    off = 0.0
    if len(irregular):
        arrays = patch_arrays(CATMULL_CLARK, layout.sheets, whole.sheets)
        around = catmull_clark.regular_rings(whole.sheets, irregular)
        caps = cap_nets(layout.sheets, arrays, around, all_points, irregular)
        tiles += _cap_tiles(caps)
        off = float(caps.off.max())
    mosaic = joined(layout.faces, layout.across, layout.sheets.across >= 0, tiles)
    return LimitFaces(mosaic, len(boxes), off, len(layout.faces))


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
    clamped = _clamped(_clamped(uniform).transpose(1, 0, 2)).transpose(1, 0, 2)
    surface = BSplineSurface(3, 3, _knots(m), _knots(n), clamped)
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
    return BSplineCurve(3, _knots(end - start), _clamped(points[start : end + 3]))


def _knots(n_spans: int) -> Floats:
    return np.concatenate([np.zeros(3), np.arange(n_spans + 1.0), np.full(3, float(n_spans))])


def _clamped(points: Floats) -> Floats:
    """(n, ...) control points of a uniform cubic B-spline on knots that are clamped at both ends."""
    out = points.copy()
    if len(points) == 4:  # one span: both ends at once, a Bezier segment
        p0, p1, p2, p3 = points
        out[0], out[1], out[2], out[3] = p0 + 4 * p1 + p2, 4 * p1 + 2 * p2, 2 * p1 + 4 * p2, p1 + 4 * p2 + p3
        return out / 6.0
    out[0], out[1] = (points[0] + 4 * points[1] + points[2]) / 6.0, (2 * points[1] + points[2]) / 3.0
    out[-1], out[-2] = (points[-1] + 4 * points[-2] + points[-3]) / 6.0, (2 * points[-2] + points[-3]) / 3.0
    return out
