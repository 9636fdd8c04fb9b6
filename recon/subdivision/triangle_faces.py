"""The Loop surface as faces for a solid: a triangle a face, four-sided with one side collapsed to a point.

    C ------ C             a triangle of degree d as a patch of degree d x d: v runs from side 0-1 to corner 2, side
     \\      /              v = 1 is the corner. In row v the triangle is of degree d in u again.
      0----1
                            S(u, v) = T((1 - u)(1 - v), u (1 - v), v)

Regular triangles are exact, quartic. Those around an irregular vertex are caps of degree seven (see `caps`): two rows
of poles along the outer side are given by the box spline beyond, and along a smooth spoke C_i

    D_w T_i(t) + D_v T_(i-1)(t) = (1 + (2 cos(theta) - 1) (1 - t)^2) C_i'(t)

with D_v, D_w the derivatives toward the third corner: at a regular vertex 2 cos(theta) = 1, and so at the end t = 1.

Paper  [lai1992], Bezier points of the regular triangle; [loop2004], G1 caps.
"""

from functools import cache
from math import comb, factorial

import numpy as np
from numpy.typing import NDArray

from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.patches import PatchMosaic
from recon.subdivision import loop
from recon.subdivision.caps import (
    AT_ONCE,
    CapTable,
    corner_angle,
    fans,
    finished_table,
    solved_fans,
    spoke_angle,
)
from recon.subdivision.evaluation import PatchArrays
from recon.subdivision.layout import Layout, isolated
from recon.subdivision.limit_surface import patch_arrays
from recon.subdivision.limit_tables import LOOP, regular_table
from recon.subdivision.quad_faces import LimitFaces
from recon.subdivision.sheets import Sheets, VertexKind, edge_numbers

__all__ = ["loop_faces"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CAP = 7  # degree of a cap
SAMPLES = 9


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


def loop_faces(mesh: ControlMesh) -> LimitFaces:
    """Faces of the Loop surface of a triangle control mesh.

    Promises  tangent planes agree along every edge that is no crease, but at corners where the surface has none;
              regular triangles are exact; one face a triangle, or four where two irregular vertices share a triangle.
    Raises    BadGeometry when a face is no triangle or a vertex has too many faces; NotManifold.
    """
    layout = isolated(mesh, LOOP)
    whole = loop.extended(layout.sheets)
    points = whole.matrix @ (layout.points @ mesh.vertices)
    quartic = np.einsum(
        "ab,nbx->nax", regular_table(), points[loop.regular_rings(whole.sheets, np.arange(len(layout.faces)))]
    )
    _share_sides(quartic, layout)
    regular, irregular = np.flatnonzero(layout.regular), np.flatnonzero(~layout.regular)
    nets = dict(zip(regular.tolist(), quartic[regular]))
    off = 0.0
    if len(irregular):
        arrays = patch_arrays(LOOP, layout.sheets, whole.sheets)
        outer = np.einsum("ab,nbx->nax", raised(4, CAP), quartic[irregular])
        caps, off = _caps(layout.sheets, (arrays, points), outer, irregular)
        nets |= dict(zip(irregular.tolist(), caps))
    order = np.concatenate([regular, irregular])
    return LimitFaces(_mosaic(layout, [nets[f] for f in order.tolist()], order), len(regular), off, len(layout.faces))


def _share_sides(quartic: Floats, layout: Layout) -> None:
    """Give both triangles on a side the same five poles, in place, so that nothing but rounding parts them."""
    spots = places_of(4)
    lines = np.array([[spots[tuple(np.roll((4 - t, t, 0), side))] for t in range(5)] for side in range(3)])
    across = layout.sheets.across
    for side in range(3):
        other = across[:, side]
        follows = (other >= 0) & (other < 3 * np.arange(len(across)) + side)
        its = other[follows]
        quartic[np.flatnonzero(follows)[:, None], lines[side]] = quartic[its[:, None] // 3, lines[its % 3][:, ::-1]]


def _caps(sheets: Sheets, surface: tuple[PatchArrays, Floats], outer: Floats, irregular: Ints) -> tuple[Floats, float]:
    place = np.full(len(sheets.faces), -1)
    place[irregular] = np.arange(len(irregular))
    vertices, first = np.unique(sheets.faces[irregular, 0], return_index=True)
    groups: dict[tuple[VertexKind, int, int], list[Ints]] = {}
    points = surface[1]
    for vertex, fan in zip(vertices.tolist(), fans(sheets, 3 * irregular[first])):
        kind, rows = VertexKind(sheets.kinds[vertex]), place[fan]
        angle = _border_curves(kind, (sheets, points), fan, outer, rows)
        groups.setdefault((kind, len(fan), angle), []).append(rows)
    nets, off = np.empty_like(outer), np.zeros(len(irregular))
    for (kind, n, angle), clusters in groups.items():
        rows = np.array(clusters)
        for begin in range(0, len(rows), AT_ONCE):
            some = rows[begin : begin + AT_ONCE]
            nets[some.ravel()], off[some.ravel()] = solved_fans(
                cap_table(kind, n, angle), outer[some], sample_places(), (*surface, irregular[some])
            )
    return nets, float(off.max())


def _border_curves(kind: VertexKind, mesh: tuple[Sheets, Floats], fan: Ints, outer: Floats, rows: Ints) -> int:
    """Write the first and last spoke, where they are border, into the poles; the angle at a corner."""
    if kind in (VertexKind.SMOOTH, VertexKind.DART):
        return 0
    sheets, points = mesh
    faces = sheets.faces
    spots = places_of(CAP)
    ahead = _beyond(sheets, 3 * int(fan[0]), forward=True)
    behind = _beyond(sheets, 3 * int(fan[-1]) + 2, forward=False)
    apex, one, two = (points[v] for v in (faces[fan[0], 0], faces[fan[0], 1], faces[fan[-1], 2]))
    before = (two, one) if kind == VertexKind.BORDER else (2 * apex - one, 2 * apex - two)
    for row, line, curve in (
        (rows[0], [spots[CAP - t, t, 0] for t in range(CAP + 1)], (before[0], apex, one, points[ahead])),
        (rows[-1], [spots[CAP - t, 0, t] for t in range(CAP + 1)], (before[1], apex, two, points[behind])),
    ):
        outer[row, line] = _elevated_cubic() @ np.array(curve)
    if kind == VertexKind.BORDER:
        return 0
    inner = outer[rows][:, [spots[0, 3, CAP - 3], spots[0, CAP - 3, 3]]].mean(axis=(0, 1))
    return corner_angle(one - apex, two - apex, inner - apex)


def _beyond(sheets: Sheets, side: int, *, forward: bool) -> int:
    """The border vertex that follows a border side, ahead of it or behind."""
    flat, across = sheets.faces.ravel(), sheets.across.ravel()
    at = side - side % 3 + (side + (1 if forward else 2)) % 3
    while across[at] >= 0:
        other = int(across[at])
        at = other - other % 3 + (other + (1 if forward else 2)) % 3
    return int(flat[at - at % 3 + (at + 1) % 3] if forward else flat[at])


@cache
def _elevated_cubic() -> Floats:
    """(8, 4) Bezier points of degree seven over the control points of a uniform cubic B-spline's span."""
    rows = np.zeros((CAP + 1, 4))
    for a in range(CAP + 1):
        for i in range(max(0, a - CAP + 3), min(3, a) + 1):
            rows[a, i] = comb(3, i) * comb(CAP - 3, a - i) / comb(CAP, a)
    return rows @ np.array([[1, 4, 1, 0], [0, 4, 2, 0], [0, 2, 4, 0], [0, 1, 4, 1]]) / 6.0


@cache
def sample_places() -> tuple[Floats, Floats]:
    """(S,) v and w of the samples of one patch; none on the outer side, which is given."""
    a, b = np.indices((SAMPLES, SAMPLES)).reshape(2, -1)
    inside = a + b < SAMPLES
    return a[inside] / SAMPLES, b[inside] / SAMPLES


@cache
def cap_table(kind: VertexKind, n: int, angle: int) -> CapTable:
    """The table of a vertex with n triangles; angle, in parts of a half turn, matters at a corner only."""
    closed = kind in (VertexKind.SMOOTH, VertexKind.DART)
    index, spots = indices(CAP), places_of(CAP)
    lines = np.array([[spots[CAP - t, t, 0] for t in range(CAP + 1)], [spots[CAP - t, 0, t] for t in range(CAP + 1)]])
    poles = np.arange(n * len(index)).reshape(n, -1)
    for i in range(n if closed else n - 1):
        poles[(i + 1) % n, lines[0]] = poles[i, lines[1]]
    numbers = np.unique(poles.ravel(), return_inverse=True)[1]
    given = np.zeros((n, len(index)), dtype=bool)
    given[:, index[:, 0] <= 1] = True
    if not closed:
        given[0, lines[0]] = given[n - 1, lines[1]] = True
    theta = spoke_angle(kind, n, angle)
    spokes = range(n) if kind == VertexKind.SMOOTH else range(1, n)
    constraints = np.zeros((0, int(numbers.max()) + 1))
    if len(spokes):
        constraints = np.concatenate([_spoke_rows(n, i, theta, numbers) for i in spokes])
    v, w = sample_places()
    return finished_table(constraints, (bernstein(CAP, v, w), v * w == 0.0), numbers, given)


def _spoke_rows(n: int, i: int, theta: float, numbers: Ints) -> Floats:
    """(CAP + 1, size) the condition along spoke i; its last coefficient holds by what is given."""
    d, spots = CAP, places_of(CAP)
    n_poles = len(spots)
    before, after = n_poles * ((i - 1) % n), n_poles * i
    rows = np.zeros((d + 2, n_poles * n))
    for k in range(d):  # degree d - 1 as degree d + 1
        for m in range(k, k + 3):
            share = comb(d - 1, k) * comb(2, m - k) / comb(d + 1, m)
            for pole, sign in (
                (after + spots[d - 1 - k, k, 1], 1.0),
                (after + spots[d - k, k, 0], -1.0),
                (before + spots[d - 1 - k, 1, k], 1.0),
                (before + spots[d - k, 0, k], -1.0),
            ):
                rows[m, pole] += share * sign
            scale = (2 * np.cos(theta), 1.0, 1.0)[m - k] * share
            rows[m, after + spots[d - k - 1, k + 1, 0]] -= scale
            rows[m, after + spots[d - k, k, 0]] += scale
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


def _mosaic(layout: Layout, nets: list[Floats], order: Ints) -> PatchMosaic:
    """One patch a triangle; sides 0-1 along v = 0, 1-2 along u = 1, nothing along v = 1, 0-2 along u = 0."""
    numbers, n_edges = edge_numbers(layout.across)
    smooth = np.zeros(n_edges, dtype=bool)
    smooth[numbers[layout.sheets.across >= 0]] = True
    curves: list[BSplineCurve | None] = [None] * n_edges
    ends = np.zeros((n_edges, 2), dtype=np.int64)
    patches, starts, uses, forward = [], [0], [], []
    for f, net in zip(order.tolist(), nets):
        degree = 4 if len(net) == 15 else CAP
        knots = np.repeat([0.0, 1.0], degree + 1)
        full = _collapse(degree) @ net
        patches.append(BSplineSurface(degree, degree, knots, knots, full))
        corners = layout.faces[f]
        sides = ((0, 0, 1, full[:, 0]), (1, 1, 2, full[-1]), None, (2, 0, 2, full[0]))
        for side in sides:
            if side is not None:
                own, a, b, poles = side
                e = int(numbers[f, own])
                if curves[e] is None:
                    curves[e] = BSplineCurve(degree, knots, poles)
                    ends[e] = corners[a], corners[b]
                uses.append(e)
                forward.append(bool(ends[e, 0] == corners[a]))
            starts.append(len(uses))
    vertices = np.empty((int(layout.faces.max()) + 1, 3))
    made = [curve for curve in curves if curve is not None]
    vertices[ends[:, 0]] = [curve.control_points[0] for curve in made]
    vertices[ends[:, 1]] = [curve.control_points[-1] for curve in made]
    ways = np.array(forward)
    ranges = np.where(ways[:, None], [0.0, 1.0], [1.0, 0.0])
    return PatchMosaic(
        tuple(patches), vertices, tuple(made), ends, smooth, np.array(starts), np.array(uses), ways, ranges
    )
