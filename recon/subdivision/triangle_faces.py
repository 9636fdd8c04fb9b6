"""The Loop surface as faces for a solid: four-sided patches with one side collapsed to a point.

    C ------ C             a triangle of degree d as a patch of degree d x d: v runs from side 0-1 to corner 2, side
     \\      /              v = 1 is the corner. In row v the triangle is of degree d in u again.
      0----1
                            S(u, v) = T((1 - u)(1 - v), u (1 - v), v)

A face covers as large a triangle as it can. One with three regular corners, whatever lies beyond, is one polynomial;
the fan around an irregular vertex can be capped where none of its triangles has another one. All other triangles are
refined, and their four parts looked at in the same way: a side of a large triangle has several small ones beyond it.

Regular triangles are exact, quartic. Those around an irregular vertex are caps of degree seven (see `caps`): two rows
of poles along the outer side are given by the box spline beyond, and along a smooth spoke C_i

    a D_v T_(i-1)(t) + b D_w T_i(t) = (1 + (2 cos(theta) - 1) (1 - t)^2) C_i'(t)

with D_v, D_w the derivatives toward the third corner: at a regular vertex 2 cos(theta) = 1, and so at the end t = 1.
Factors a = b = 1 but at corners, where they are those of `caps`.

Paper  [lai1992], Bezier points of the regular triangle; [loop2004], G1 caps.
"""

from functools import cache, lru_cache, partial
from math import comb, factorial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.control_mesh import ControlMesh
from recon.numerics.bernstein import degree_elevation, reparametrization
from recon.numerics.halfedges import opposite_sides
from recon.subdivision import loop
from recon.subdivision.caps import (
    BEZIER,
    Caps,
    CapTable,
    Places,
    Turn,
    caps_of,
    corner_turn,
    fans,
    finished_table,
    probed,
)
from recon.subdivision.evaluation import PatchArrays
from recon.subdivision.layout import irregular_corners, turned_faces
from recon.subdivision.limit_surface import TooCoarse, patch_arrays
from recon.subdivision.limit_tables import LOOP, regular_table
from recon.subdivision.mosaic import Strip, Tile, joined
from recon.subdivision.polygons import MAX_FACES, n_steps, refined, split_triangles
from recon.subdivision.quad_faces import LimitFaces
from recon.subdivision.semi_sharp import firm, semi_sharp_vertices
from recon.subdivision.sheets import Sheets, VertexKind, cut_along_creases, fan_corners

__all__ = ["loop_faces"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

CAP = 7  # degree of a cap
SAMPLES = 9
MAX_STEPS = 3  # by which caps are made smaller for the sake of accuracy


class _Level(NamedTuple):
    """A control mesh of triangles, refined so many times.

    sheets   cut along the creases that stay sharp; an irregular corner comes first
    turns    (F,) the corner of the mesh's face that does
    whole    the sheets with what is reflected in their borders, and `points` of its vertices
    regular  (F,) whether no corner is irregular, and `single` (F,) whether one is; in both cases no semi-sharp crease
             or corner meets the face
    """

    sheets: Sheets
    turns: Ints
    whole: Sheets
    points: Floats
    regular: Bools
    single: Bools


class _Piece(NamedTuple):
    """Poles (N, 3) of a triangle that covers a face; its corner 0 is the face's corner `turn`."""

    depth: int
    face: int
    turn: int
    poles: Floats


def indices(degree: int) -> Ints:
    """(N, 3) powers (i, j, k) of u, v and w, rows of constant k."""
    return np.array([(degree - j - k, j, k) for k in range(degree + 1) for j in range(degree + 1 - k)])


def places_of(degree: int) -> dict[tuple[int, ...], int]:
    """Where each pole stands among `indices`."""
    return {tuple(row): i for i, row in enumerate(indices(degree).tolist())}


def bernstein(degree: int, v: Floats, w: Floats) -> Floats:
    """(n, N) Bernstein polynomials of a triangle."""
    i, j, k = indices(degree).T
    count = [factorial(degree) / (factorial(a) * factorial(b) * factorial(c)) for a, b, c in indices(degree).tolist()]
    u = 1.0 - v - w
    return np.array(count) * u[:, None] ** i * v[:, None] ** j * w[:, None] ** k


@cache
def raised(degree: int, to: int) -> Floats:
    """(M, N) poles of a higher degree over those of a triangle."""
    matrix = np.eye(len(indices(degree)))
    for d in range(degree, to):
        low = places_of(d)
        step = np.zeros((len(indices(d + 1)), len(low)))
        for row, index in enumerate(indices(d + 1).tolist()):
            for axis in range(3):
                if index[axis]:
                    below = tuple(x - (a == axis) for a, x in enumerate(index))
                    step[row, low[below]] += index[axis] / (d + 1)
        matrix = step @ matrix
    return matrix


def loop_faces(mesh: ControlMesh, *, allowed: float = np.inf) -> LimitFaces:
    """Faces of the Loop surface of a triangle control mesh.

    allowed   how far caps may stay from the limit surface, as far as three refinements of them go
    Promises  tangent planes agree along every edge that is no crease, but at corners where the surface has none;
              regular triangles are exact. Without semi-sharp creases one face a triangle where irregular vertices are
              isolated, four where two of them share a triangle, and more where `allowed` asks for it.
    Raises    BadGeometry when a face is no triangle, a vertex has too many faces, or semi-sharp creases take over
              250,000 triangles; NotManifold.
    """
    exact, caps, off = [], [], 0.0
    left, depth, most = np.ones(mesh.n_faces, dtype=bool), 0, n_steps(mesh) + 1 + MAX_STEPS
    while True:
        level = _level(mesh)
        regular = np.flatnonzero(left & level.regular)
        rings = loop.regular_rings(level.whole, regular)
        exact += _pieces(depth, level, regular, np.einsum("ab,nbx->nax", regular_table(), level.points[rings]))
        is_last = depth == most or 4 * mesh.n_faces > MAX_FACES
        capped, poles, misfit = _caps(level, left & level.single, None if is_last else allowed)
        caps += _pieces(depth, level, capped, poles)
        off = max(off, misfit)
        left[regular] = left[capped] = False
        if not left.any():
            break
        mesh, left, depth = refined(mesh, split_triangles), np.repeat(left, 4), depth + 1
    across = opposite_sides(mesh.faces_of(3))
    smooth = cut_along_creases(firm(mesh), 3)[0].across >= 0
    tiles = [_tile(piece, depth) for piece in exact + caps]
    return LimitFaces(joined(fan_corners(across).reshape(across.shape), across, smooth, tiles), len(exact), off)


def _level(mesh: ControlMesh) -> _Level:
    cut, behind = cut_along_creases(firm(mesh), 3)
    irregular = irregular_corners(cut, loop.REGULAR_FACES)
    turns = irregular.argmax(axis=1)
    sheets = Sheets(*turned_faces(cut.faces, cut.across, turns), cut.kinds)
    whole = loop.extended(sheets)
    met = semi_sharp_vertices(mesh)[behind][cut.faces].any(axis=1)
    count = np.where(met, -1, irregular.sum(axis=1))
    return _Level(sheets, turns, whole.sheets, whole.matrix @ mesh.vertices[behind], count == 0, count == 1)


def _pieces(depth: int, level: _Level, faces: Ints, poles: Floats) -> list[_Piece]:
    return [_Piece(depth, *where) for where in zip(faces.tolist(), level.turns[faces].tolist(), poles)]


def _caps(level: _Level, wanted: Bools, allowed: float | None) -> tuple[Ints, Floats, float]:
    """Caps around the vertices all of whose faces are wanted: (M,) the faces, their poles, and how far they are off.

    Fans that are off by more than allowed, or fold, are left out; none is where allowed is None.
    """
    apex, n_vertices = level.sheets.faces[:, 0], len(level.sheets.kinds)
    all_wanted = np.bincount(apex[wanted], minlength=n_vertices) == np.bincount(
        level.sheets.faces.ravel(), minlength=n_vertices
    )
    chosen = np.flatnonzero(wanted & all_wanted[apex])
    if not len(chosen):
        return chosen, np.empty((0, len(indices(CAP)), 3)), 0.0
    try:
        arrays = patch_arrays(LOOP, level.sheets, level.whole, chosen)
    except TooCoarse:
        return chosen[:0], np.empty((0, len(indices(CAP)), 3)), 0.0
    quartic = np.einsum("ab,nbx->nax", regular_table(), level.points[loop.regular_rings(level.whole, chosen)])
    outer = np.einsum("ab,nbx->nax", raised(4, CAP), quartic)
    caps = _fan_caps(level.sheets, (arrays, level.points), outer, chosen)
    bad = np.zeros(n_vertices, dtype=bool)
    if allowed is not None:
        bad[apex[chosen][caps.folded | (caps.off > allowed)]] = True
    near = ~bad[apex[chosen]]
    return chosen[near], caps.nets[near], float(caps.off[near].max(initial=0.0))


def _fan_caps(sheets: Sheets, surface: tuple[PatchArrays, Floats], outer: Floats, irregular: Ints) -> Caps:
    """Caps around the first corners of the faces; outer: poles of which those along the outer sides are given."""
    place = np.full(len(sheets.faces), -1)
    place[irregular] = np.arange(len(irregular))
    _, first = np.unique(sheets.faces[irregular, 0], return_index=True)
    groups: dict[Turn, list[Ints]] = {}
    for fan in fans(sheets, 3 * irregular[first]):
        rows = place[fan]
        groups.setdefault(_border_curves((sheets, surface[1]), fan, outer, rows), []).append(rows)
    return caps_of(groups, (cap_table, _places()), outer, (*surface, irregular))


def _border_curves(mesh: tuple[Sheets, Floats], fan: Ints, outer: Floats, rows: Ints) -> Turn:
    """Write the first and last spoke, where they are border, into the poles; how the fan turns."""
    sheets, points = mesh
    faces = sheets.faces
    turn = Turn(VertexKind(sheets.kinds[faces[fan[0], 0]]), len(fan))
    if turn.is_closed:
        return turn
    ahead = _beyond(sheets, 3 * int(fan[0]), forward=True)
    behind = _beyond(sheets, 3 * int(fan[-1]) + 2, forward=False)
    apex, one, two = (points[v] for v in (faces[fan[0], 0], faces[fan[0], 1], faces[fan[-1], 2]))
    before = (two, one) if turn.kind == VertexKind.BORDER else (2 * apex - one, 2 * apex - two)
    lines = spoke_places()
    outer[rows[0], lines[0]] = _border_poles() @ np.array([before[0], apex, one, points[ahead]])
    outer[rows[-1], lines[1]] = _border_poles() @ np.array([before[1], apex, two, points[behind]])
    if turn.kind == VertexKind.BORDER:
        return turn
    spots = places_of(CAP)
    inner = outer[rows][:, [spots[0, 3, CAP - 3], spots[0, CAP - 3, 3]]].mean(axis=(0, 1))
    return corner_turn(len(fan), (one - apex, two - apex), inner - apex)


@cache
def spoke_places() -> Ints:
    """(2, CAP + 1) the poles of a cap along its first and second spoke, from the vertex outward."""
    spots = places_of(CAP)
    return np.array([[spots[CAP - t, t, 0] for t in range(CAP + 1)], [spots[CAP - t, 0, t] for t in range(CAP + 1)]])


def _beyond(sheets: Sheets, side: int, *, forward: bool) -> int:
    """The border vertex that follows a border side, ahead of it or behind."""
    flat, across = sheets.faces.ravel(), sheets.across.ravel()
    at = side - side % 3 + (side + (1 if forward else 2)) % 3
    while across[at] >= 0:
        other = int(across[at])
        at = other - other % 3 + (other + (1 if forward else 2)) % 3
    return int(flat[at - at % 3 + (at + 1) % 3] if forward else flat[at])


@cache
def _border_poles() -> Floats:
    """(8, 4) Bezier points of degree seven over the control points of a uniform cubic B-spline's span."""
    return degree_elevation(3, CAP) @ BEZIER[4]


@cache
def _places() -> Places:
    """Samples on a grid, none on the outer side, which is given."""
    grid = np.indices((SAMPLES, SAMPLES)).reshape(2, -1)
    samples = grid[:, grid.sum(axis=0) < SAMPLES] / SAMPLES
    return Places(partial(bernstein, CAP), samples, probed(samples + 1.0 / (3.0 * SAMPLES)))


@lru_cache(maxsize=1024)
def cap_table(turn: Turn) -> CapTable:
    """The table of a vertex."""
    n, index, lines = turn.n_faces, indices(CAP), spoke_places()
    poles = np.arange(n * len(index)).reshape(n, -1)
    for i in range(n if turn.is_closed else n - 1):
        poles[(i + 1) % n, lines[0]] = poles[i, lines[1]]
    numbers = np.unique(poles.ravel(), return_inverse=True)[1]
    given = np.zeros((n, len(index)), dtype=bool)
    given[:, index[:, 0] <= 1] = True
    if not turn.is_closed:
        given[0, lines[0]] = given[n - 1, lines[1]] = True
    rows = [_spoke_rows(turn, i, numbers) for i in turn.inner_spokes]
    return finished_table(np.concatenate([np.zeros((0, int(numbers.max()) + 1)), *rows]), _places(), numbers, given)


def _spoke_rows(turn: Turn, i: int, numbers: Ints) -> Floats:
    """(CAP + 1, size) the condition along spoke i; its last coefficient holds by what is given."""
    d, spots, ratio = CAP, places_of(CAP), turn.ratio
    n_poles = len(spots)
    before, after = n_poles * ((i - 1) % turn.n_faces), n_poles * i
    rows = np.zeros((d + 2, n_poles * turn.n_faces))
    factors = ((ratio, 1.0 / ratio, 2 * np.cos(turn.theta)), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    for k in range(d):  # degree d - 1 as degree d + 1
        for m, (one, two, three) in enumerate(factors):
            share = comb(d - 1, k) * comb(2, m) / comb(d + 1, k + m)
            for pole, factor in (
                (after + spots[d - 1 - k, k, 1], two),
                (after + spots[d - k, k, 0], -two),
                (before + spots[d - 1 - k, 1, k], one),
                (before + spots[d - k, 0, k], -one),
                (after + spots[d - k - 1, k + 1, 0], -three),
                (after + spots[d - k, k, 0], three),
            ):
                rows[k + m, pole] += share * factor
    folded = np.zeros((d + 2, int(numbers.max()) + 1))
    np.add.at(folded.T, numbers, rows.T)
    return folded[:-1]


@cache
def _collapse(degree: int) -> Floats:
    """(d + 1, d + 1, N) poles of the four-sided patch: row v of the triangle raised to its degree."""
    spots = places_of(degree)
    full = np.zeros((degree + 1, degree + 1, len(spots)))
    for k in range(degree + 1):
        low = degree - k
        for u in range(degree + 1):
            for j in range(max(0, u - k), min(low, u) + 1):
                full[u, k, spots[low - j, j, k]] += comb(low, j) * comb(k, u - j) / comb(degree, u)
    return full


def _tile(piece: _Piece, depth: int) -> Tile:
    """The patch of a triangle: sides 0-1 along v = 0, 1-2 along u = 1, nothing along v = 1, 0-2 along u = 0."""
    degree = 4 if len(piece.poles) == len(indices(4)) else CAP
    steps = depth - piece.depth
    net = _collapse(degree) @ piece.poles
    knots = np.repeat([0.0, float(1 << steps)], degree + 1)
    first, second, third = (_fine_sides(piece.face, (side + piece.turn) % 3, steps) for side in range(3))
    strips = (
        Strip(*first, along=True),
        Strip(*second, along=True),
        None,
        Strip(third[0][::-1], third[1][::-1], along=False),
    )
    sides = (net[:, 0], net[-1], net[:, -1], net[0])
    return Tile(BSplineSurface(degree, degree, knots, knots, net), strips, sides, partial(_part_of_side, 1 << steps))


def _fine_sides(face: int, side: int, steps: int) -> tuple[Ints, Ints]:
    """The faces, and the side of each, into which a side falls when the mesh is refined."""
    faces, sides = np.array([face]), np.array([side])
    for _ in range(steps):
        faces = np.stack([4 * faces + sides, 4 * faces + (sides + 1) % 3], axis=1).ravel()
        sides = np.tile([0, 2], len(sides))
    return faces, sides


def _part_of_side(length: int, points: Floats, start: int, end: int) -> BSplineCurve:
    """From start to end of a Bezier curve over [0, length]."""
    degree = len(points) - 1
    if end - start < length:
        points = reparametrization(degree, start / length, end / length) @ points
    return BSplineCurve(degree, np.repeat([0.0, float(end - start)], degree + 1), points)
