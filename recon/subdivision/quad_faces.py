"""Surfaces of quadrilaterals as faces for a solid: rectangles of exact splines, with caps around irregular vertices.

    regular quad   bicubic in Catmull-Clark's scheme and bi-quadratic in Doo-Sabin's: exact
    cap            one bi-quintic Bezier patch a quad at an irregular vertex (`quad_caps`)
    rectangle      m x n quads between tracks (`tracks`), with caps at its corners alone; one B-spline surface with unit
                   spans, of the scheme's own degree without caps, bi-quintic with them: a cap shares position and
                   tangents with the quads beyond its outer sides

What two rectangles share is a row of the quads' edges: it becomes one edge, cut where a third rectangle begins.

Where a cap is too far from the limit surface the mesh is refined once more: the caps shrink, and the rectangles lose
the knots that refinement put into them (`uniform_splines`).

Doo-Sabin's patches lie around the points of the mesh once refined. Their corners form a mesh of quadrilaterals, too,
and its irregular vertices are the middles of the faces that have not four corners.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.patches import PatchMosaic
from recon.subdivision import catmull_clark
from recon.subdivision.caps import Caps
from recon.subdivision.doo_sabin import doo_sabin_patches
from recon.subdivision.layout import Layout, isolated
from recon.subdivision.limit_surface import TooCoarse, patch_arrays
from recon.subdivision.limit_tables import CATMULL_CLARK
from recon.subdivision.mosaic import Strip, Tile, joined
from recon.subdivision.polygons import MAX_FACES
from recon.subdivision.quad_caps import QUINTIC, cap_nets
from recon.subdivision.quintic_splines import DEGREE, quintic_spline
from recon.subdivision.rectangles import Rectangle, rectangles
from recon.subdivision.sheets import Sheets, fan_corners
from recon.subdivision.tracks import tracks
from recon.subdivision.uniform_splines import clamped

__all__ = ["LimitFaces", "catmull_clark_faces", "doo_sabin_faces"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MAX_STEPS = 3


class LimitFaces(NamedTuple):
    """Faces of a limit surface, and how true they are.

    mosaic      the faces with the edges that they share
    n_exact     how many of them are the limit surface itself
    off         the largest distance found between the others and the limit surface
    """

    mosaic: PatchMosaic
    n_exact: int
    off: float


def catmull_clark_faces(mesh: ControlMesh, *, grouped: bool = True, allowed: float = np.inf) -> LimitFaces:
    """Faces of the Catmull-Clark surface of a quadrilateral control mesh without semi-sharp creases.

    grouped   whether quads become rectangles; else each is a face of its own
    allowed   how far caps may stay from the limit surface; reached as far as three refinements and a quarter of a
              million quads go
    Promises  tangent planes agree along every edge that is no crease, but at corners where the surface has none;
              regular quads are exact.
    Raises    BadGeometry when a face is no quadrilateral or a vertex has too many faces; NotManifold.
    """
    for steps in range(MAX_STEPS + 1):
        layout = isolated(mesh, steps)
        whole = catmull_clark.extended(layout.sheets)
        points = whole.matrix @ (layout.points @ mesh.vertices)
        try:
            caps = _caps(layout, whole.sheets, points)
        except TooCoarse:
            continue
        if caps.are_good(allowed) or 4 * len(layout.faces) > MAX_FACES:
            break
    rings = catmull_clark.regular_rings(whole.sheets, np.arange(len(layout.regular)))
    return _laid(layout.sheets, (layout.faces, layout.across), (rings, points), caps, grouped=grouped)


def doo_sabin_faces(mesh: ControlMesh, *, grouped: bool = True) -> LimitFaces:
    """Faces of the Doo-Sabin surface of a control mesh; as `catmull_clark_faces`, but for `allowed`.

    Raises    BadGeometry when a vertex has too many faces, or a crease is semi-sharp; NotManifold.
    """
    dual = doo_sabin_patches(mesh)
    irregular = np.flatnonzero(dual.arrays.tables >= 0)
    points = dual.points @ mesh.vertices
    caps = cap_nets(dual.sheets, dual.arrays, dual.rings[irregular], points, irregular)
    whole = fan_corners(dual.joined).reshape(dual.joined.shape), dual.joined
    return _laid(dual.sheets, whole, (dual.rings, points), caps, grouped=grouped)


def _laid(
    sheets: Sheets, whole: tuple[Ints, Ints], surface: tuple[Ints, Floats], caps: Caps, *, grouped: bool
) -> LimitFaces:
    """Faces over the quads of `sheets`.

    whole    the same quads and their sides across where creases part nothing
    surface  rings (F, 16) bicubic, (F, 9) bi-quadratic, of the points
    """
    regular = np.ones(len(sheets.faces), dtype=bool)
    regular[caps.faces] = False
    place = np.where(regular, -1, np.cumsum(~regular) - 1)
    boxes = _boxes(sheets, whole[0], regular) if grouped else _single(len(sheets.faces))
    exact = [box for box in boxes if regular[box.faces].all()]
    other = [box for box in boxes if not regular[box.faces].all()]
    tiles = [_spline(box, *surface) for box in exact] + [_capped(box, surface, caps.nets, place) for box in other]
    mosaic = joined(*whole, sheets.across >= 0, tiles)
    return LimitFaces(mosaic, len(exact), float(caps.off.max(initial=0.0)))


def _boxes(sheets: Sheets, faces: Ints, regular: NDArray[np.bool_]) -> list[Rectangle]:
    parted = tracks(sheets.faces, sheets.across, regular)
    return rectangles(faces, np.where(parted, -1, sheets.across))


def _single(n: int) -> list[Rectangle]:
    return [Rectangle(np.array([[f]]), np.zeros((1, 1), dtype=np.int64)) for f in range(n)]


def _caps(layout: Layout, whole: Sheets, points: Floats) -> Caps:
    irregular = np.flatnonzero(~layout.regular)
    if not len(irregular):
        return Caps(irregular, np.empty((0, 6, 6, 3)), np.empty(0), np.empty(0, dtype=bool))
    arrays = patch_arrays(CATMULL_CLARK, layout.sheets, whole)
    around = catmull_clark.regular_rings(whole, irregular)
    return cap_nets(layout.sheets, arrays, around, points, irregular)


def _turned(n: int) -> Ints:
    """(4, n, n) the entries of a ring of n x n points whose bottom is side 0, 1, 2, 3, row by row."""
    i, j = np.meshgrid(np.arange(n), np.arange(n))  # place (i, j) in a ring; entry n j + i
    last = n - 1
    return np.stack([n * q + p for p, q in ((i, j), (last - j, i), (last - i, last - j), (j, last - i))])


TURNED = {3: _turned(3), 4: _turned(4)}
AT_END = {2: np.array([0.5, 0.5]), 3: np.array([1.0, 4.0, 1.0]) / 6.0}  # value of a uniform B-spline at a knot


def _net(box: Rectangle, rings: Ints, points: Floats) -> Floats:
    """(along u, along v, 3) control points of uniform B-splines over a rectangle."""
    n, m = box.faces.shape
    size = round(rings.shape[1] ** 0.5)
    net = np.zeros((n + size - 1, m + size - 1), dtype=np.int64)
    own = rings[box.faces][np.arange(n)[:, None, None, None], np.arange(m)[:, None, None], TURNED[size][box.turns]]
    for j in range(n):
        for i in range(m):
            net[j : j + size, i : i + size] = own[j, i]
    return points[net].transpose(1, 0, 2)


def _spline(box: Rectangle, rings: Ints, points: Floats) -> Tile:
    """The surface over a rectangle of regular quads; rings (F, 16) bicubic, (F, 9) bi-quadratic."""
    uniform, degree = _net(box, rings, points), round(rings.shape[1] ** 0.5) - 1
    knots_u, along_u = clamped(uniform, degree)
    knots_v, along_v = clamped(along_u.transpose(1, 0, 2), degree)
    surface = BSplineSurface(degree, degree, knots_u, knots_v, along_v.transpose(1, 0, 2))
    end = AT_END[degree]
    curves = (
        np.einsum("j,ijx->ix", end, uniform[:, :degree]),
        np.einsum("i,ijx->jx", end, uniform[-degree:]),
        np.einsum("j,ijx->ix", end, uniform[:, -degree:]),
        np.einsum("i,ijx->jx", end, uniform[:degree]),
    )
    return Tile(surface, _strips(box.faces, box.turns), curves, partial(_part_of_side, degree))


def _capped(box: Rectangle, surface: tuple[Ints, Floats], nets: Floats, place: Ints) -> Tile:
    """The surface over a rectangle with caps at its corners.

    nets  (M, 6, 6, 3) of the caps; place (F,) the cap of each quad, -1 where there is none
    """
    uniform = _net(box, *surface)
    size = round(surface[0].shape[1] ** 0.5)
    spans = np.lib.stride_tricks.sliding_window_view(uniform, (size, size), axis=(0, 1))
    patches = np.einsum("ijxaq,bq->ijabx", np.einsum("ap,ijxpq->ijxaq", QUINTIC[size], spans), QUINTIC[size])
    for j, i in np.argwhere(place[box.faces] >= 0).tolist():
        patches[i, j] = _turned_net(nets[place[box.faces[j, i]]], int(box.turns[j, i]))
    m, n = patches.shape[:2]
    knots_v, along_v = quintic_spline(patches.transpose(1, 3, 0, 2, 4).reshape(n, 6, 6 * m, 3))
    across = along_v.reshape(-1, m, 6, 3).transpose(1, 2, 0, 3)
    knots_u, along_u = quintic_spline(across)
    curves = patches[:, 0, :, 0], patches[-1, :, 5, :], patches[:, -1, :, 5], patches[0, :, 0, :]
    return Tile(
        BSplineSurface(DEGREE, DEGREE, knots_u, knots_v, along_u),
        _strips(box.faces, box.turns),
        curves,
        _part_of_quintics,
    )


def _turned_net(net: Floats, turn: int) -> Floats:
    """The poles (u, v) of a cap as they lie with its side `turn` at the bottom."""
    return np.asarray(np.rot90(net, -turn))


def _part_of_quintics(pieces: Floats, start: int, end: int) -> BSplineCurve:
    return BSplineCurve(DEGREE, *quintic_spline(pieces[start:end]))


def _strips(faces: Ints, turns: Ints) -> tuple[Strip, ...]:
    """Along the four sides of quads (n, m) in rows; turns (n, m) the side of each that lies at the bottom."""
    ends = (faces[0], turns[0]), (faces[:, -1], turns[:, -1]), (faces[-1], turns[-1]), (faces[:, 0], turns[:, 0])
    # quads run around themselves, against the direction of sides 2 and 3
    return tuple(Strip(quads, (side + turned) % 4, side < 2) for side, (quads, turned) in enumerate(ends))


def _part_of_side(degree: int, points: Floats, start: int, end: int) -> BSplineCurve:
    """The spans from start to end of a uniform B-spline."""
    return BSplineCurve(degree, *clamped(points[start : end + degree], degree))
