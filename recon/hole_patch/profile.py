"""The profile of a thrown wall and the chart that it spans about the wheel's axis.

A vessel from the wheel is one curve turned about one axis. The curve is read off the wall, robustly and mostly from the
side where the hole is; turned, it carries coordinates in which every wall, steep or flat, is nearly a sheet of paper.

      axis  z ^        s            chart of the hole
         |    |       /  ^ n          s ^   .---.
         |    |      /  /               |  ( hole)
         |    |  ,--'  '----> d         |   '---'
         |    '--+-----> r              +---------> θ

    θ        angle about the axis, 0 in the middle of the hole
    s        length along the profile, from base to mouth
    d        distance from the turned profile, positive away from the vessel's inside
    c(s)     the profile, (radius, height)
    n(s)     its unit normal: the tangent turned clockwise, (c'_z, -c'_r)
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from recon.errors import NoSurface
from recon.geometry.bspline import BSplineCurve
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.surroundings import Axis, Wall
from recon.numerics.bspline_basis import basis_matrix, uniform_knots

__all__ = ["Profile", "vertex_areas_and_normals", "wall_profile"]

Floats = NDArray[np.float64]

SPAN = 2.0  # mm between knots: a foot or a shoulder turns within a few millimetres, relief is finer
NEARNESS = np.radians(60.0)  # ovality has period π: a wall a quarter turn away may be out of round the other way
LEAST_RADIUS = 1.0  # mm; nearer to the axis the chart is drawn together to a point
NEAR_AXIS = (
    0.25  # least over greatest radius of an edge that is rolled out; below, the chart would be stretched fourfold
)
EXTENDED = 6.0  # mm: the margin of a face beyond its hole
STIFF, LIMP = 1e3, 1e-3  # greatest and least weight of the bending energy beside the samples
BREADTHS = 3.0  # of the band of samples, by which the profile may not bend
LINKED = 2.5  # mm; neighbouring sherds leave gaps of about a millimetre
ABSOLUTE_ROUNDS, BIWEIGHT_ROUNDS = 8, 3  # of projecting, weighting and fitting; the length settles after three


@dataclass(frozen=True, eq=False)
class Profile:
    """A curve in (radius, height) about an axis, with the angle of the hole it was made for.

    axis      the wheel's axis
    curve     c(s), 2D, its parameter close to its length in millimetres, from base to mouth
    middle    angle in radians, in the axis's frame, that the chart counts from
    crossing  s where the profile crosses the axis, when the hole lies over or near it, else None; such a profile
              goes on beyond it as its own mirror image
    """

    axis: Axis
    curve: BSplineCurve
    middle: float
    crossing: float | None = None

    def chart(self, points: Floats) -> Floats:
        """(m, 3) θ in [-π, π), s and d of points (m, 3); s stays at an end for points beyond it."""
        turned = self.axis.cylindrical(points)
        s = self.foot(turned[:, 1:])
        d = np.einsum("ij,ij->i", turned[:, 1:] - self.curve.point(s), self.normal(s))
        return np.stack([wrapped(turned[:, 0] - self.middle), s, d], axis=1)

    def space(self, chart: Floats) -> Floats:
        """(m, 3) points of chart coordinates (m, 3): the inverse of `chart`, straight on beyond the profile's ends."""
        s = np.clip(chart[:, 1], *self.curve.domain)
        normal = self.normal(s)
        tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        section = self.curve.point(s) + (chart[:, 1] - s)[:, None] * tangent + chart[:, 2:] * normal
        return self.axis.cartesian(np.column_stack([chart[:, 0] + self.middle, section]))

    def normal(self, s: Floats) -> Floats:
        """(m, 2) unit normals n(s) in (radius, height)."""
        tangent = self.curve.derivative(s)
        normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)

    def radius(self, s: Floats) -> Floats:
        """(m,) distance of the profile from the axis."""
        return self.curve.point(s)[:, 0]

    def foot(self, section: Floats) -> Floats:
        """(m,) parameter of the profile's point nearest to each point (m, 2) in (radius, height)."""
        low, high = self.curve.domain
        seeds = np.linspace(low, high, max(16, int(4 * (high - low))))
        s = seeds[cKDTree(self.curve.point(seeds)).query(section)[1]]
        step = seeds[1] - seeds[0]
        for _ in range(4):
            off, first, second = (self.curve.derivative(s, k) for k in range(3))
            off = off - section
            slope = np.einsum("ij,ij->i", first, first) + np.einsum("ij,ij->i", off, second)
            # beyond the centre of curvature Newton runs away from the foot point: never more than a seed's distance
            move = np.einsum("ij,ij->i", off, first) / np.maximum(slope, 0.1)
            s = np.clip(s - np.clip(move, -step, step), low, high)
        return s


def wall_profile(wall: Wall, axis: Axis, *, reach: float = 30.0, nearness: float = NEARNESS) -> Profile:
    """The profile of a wall near its hole, read off the wall as scanned.

    As scanned, not as smoothed: the turn averages noise and relief away just as well, and a low-pass filter that is
    strong enough for relief cuts across the bend between base and wall by up to a millimetre.
    reach     millimetres by which the profile goes on beyond the hole where the wall does
    nearness  radians; walls count by exp(-θ²/2 nearness²) of their angle from the hole
    Promises  runs from base to mouth, its normal on the side of the wall's normals, and straight on by `EXTENDED` mm
              beyond the wall, but not over the axis; parts off the wheel's surface (a handle, a spout) do not bend it.
              Where the hole lies over the axis, the profile bridges it with the least bending.
    Raises    NoSurface when the wall near the hole gives no single profile, or the hole leaves too little of it.
    """
    edge = axis.cylindrical(wall.edge.points)
    over = _lies_over_axis(edge)
    middle, nearness = (0.0, np.inf) if over else (_middle_angle(edge), nearness)
    samples = _section_samples(wall, axis, middle=middle, nearness=nearness)
    near = cKDTree(edge[:, 1:]).query(samples.place, distance_upper_bound=reach)[0] <= reach
    s = _rough_lengths(samples.of(near), edge[:, 1:], link=max(LINKED, 2.0 * _edge_length(wall.measured)))
    together = np.isfinite(s)
    samples, s = samples.of(near).of(together), s[together]
    if not over:
        return Profile(axis, _fit_curve(samples, s), middle)
    curve = _fit_curve(*_mirrored(samples, s))
    return Profile(axis, curve, middle, _crossing(curve))


def wrapped(angle: Floats) -> Floats:
    """Angles in [-π, π)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def vertex_areas_and_normals(mesh: TriangleMesh) -> tuple[Floats, Floats]:
    """(V,) a third of the area around every vertex and (V, 3) its unit normal, zero where no face is."""
    vectors = mesh.area_vectors()
    areas, normals = np.zeros(mesh.n_vertices), np.zeros((mesh.n_vertices, 3))
    for corner in mesh.face_vertices.T:
        areas += np.bincount(corner, np.linalg.norm(vectors, axis=1) / 3.0, mesh.n_vertices)
        normals += np.stack([np.bincount(corner, column, mesh.n_vertices) for column in vectors.T], axis=1)
    return areas, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


@dataclass(frozen=True, eq=False)
class _Samples:
    """Wall vertices turned into one half plane: (m, 2) places in (radius, height), (m, 2) normals, (m,) weights."""

    place: Floats
    normal: Floats
    weight: Floats

    def of(self, which: NDArray[np.bool_]) -> "_Samples":
        return _Samples(self.place[which], self.normal[which], self.weight[which])


def _lies_over_axis(edge: Floats) -> bool:
    """Whether the hole goes round the axis, or comes near it for its size."""
    steps = wrapped(np.diff(edge[:, 0], append=edge[0, 0]))
    return bool(abs(steps.sum()) > np.pi or edge[:, 1].min() < NEAR_AXIS * edge[:, 1].max())


def _mirrored(samples: _Samples, s: Floats) -> tuple[_Samples, Floats]:
    """The samples and their mirror images beyond the axis, as far from each other as their radii say."""
    first = np.argsort(s)[: max(1, len(s) // 100)]
    s = s - s[first].mean() + samples.place[first, 0].mean()
    both = _Samples(
        np.concatenate([samples.place, samples.place * [-1, 1]]),
        np.concatenate([samples.normal, samples.normal * [-1, 1]]),
        np.tile(samples.weight, 2),
    )
    return both, np.concatenate([s, -s])


def _crossing(curve: BSplineCurve) -> float:
    """Parameter where the curve crosses the axis for the last time on its way to the mouth."""
    t = np.linspace(*curve.domain, 4000)
    radius = curve.point(t)[:, 0]
    k = int(np.flatnonzero(radius <= 0.0)[-1])
    return float(t[k] - radius[k] * (t[k + 1] - t[k]) / (radius[k + 1] - radius[k]))


def _middle_angle(edge: Floats) -> float:
    """The angle halfway between the two ends of the hole."""
    steps = wrapped(np.diff(edge[:, 0], append=edge[0, 0]))
    unrolled = edge[0, 0] + np.concatenate([[0.0], np.cumsum(steps[:-1])])
    if np.ptp(unrolled) > np.radians(300.0):
        raise NoSurface("The hole takes more than 300 degrees of the turn: too little of the wall is left beside it.")
    return float(wrapped(np.array(0.5 * (unrolled.min() + unrolled.max()))))


def _section_samples(wall: Wall, axis: Axis, *, middle: float, nearness: float) -> _Samples:
    areas, normals = vertex_areas_and_normals(wall.measured)
    turned = axis.cylindrical(wall.measured.vertices)
    ahead = axis.cylindrical(axis.point + normals)  # normals as points: their angle, size across, size along the axis
    outward = ahead[:, 1] * np.cos(ahead[:, 0] - turned[:, 0])
    normal = np.stack([outward, ahead[:, 2]], axis=1)
    # a wall that faces along θ is a handle or a mislabelled fracture: the square of what is left grades it down
    weight = areas * (normal**2).sum(axis=1)
    weight *= np.exp(-0.5 * (wrapped(turned[:, 0] - middle) / nearness) ** 2)
    return _Samples(turned[:, 1:], normal, weight).of(weight > 1e-4 * weight.max())


def _edge_length(mesh: TriangleMesh) -> float:
    """Length of the longest sides of the mesh's faces, in the mean."""
    corners = mesh.corners()
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1).mean())


def _rough_lengths(samples: _Samples, edge: Floats, *, link: float) -> Floats:
    """(m,) rough length along the profile of every sample, NaN for samples that do not hang together with the hole.

    The shortest way through cells of half a span, from the end of the profile that is nearer to the base.
    """
    cell, cells = _cells(samples)
    heavy = cells.weight > 0.02 * np.median(cells.weight)
    near = cKDTree(cells.place).query_pairs(link, output_type="ndarray")
    alike = np.einsum("ij,ij->i", cells.normal[near[:, 0]], cells.normal[near[:, 1]]) > 0.3
    a, b = near[alike & heavy[near].all(axis=1)].T
    n = len(cells.place)
    graph = sparse.csr_array((np.linalg.norm(cells.place[a] - cells.place[b], axis=1) + 1e-9, (a, b)), shape=(n, n))
    part = connected_components(graph, directed=False)[1]
    at_hole = np.unique(cKDTree(cells.place[heavy]).query(edge)[1])
    end = int(np.flatnonzero(part == np.bincount(part[heavy][at_hole]).argmax())[0])
    for _ in range(2):  # the farthest from anywhere is an end, the farthest from there the other
        length = dijkstra(graph, directed=False, indices=end)
        end = int(np.argmax(np.where(np.isfinite(length), length, -1.0)))
    known = np.isfinite(length)
    if np.quantile(cKDTree(cells.place[known]).query(edge)[0], 0.95) > 4 * link:
        raise NoSurface("The wall around the hole gives no single profile: give more of the sherds beside it.")
    length[~known] = np.nan
    return _from_base_up(length, cells)[cell]


def _cells(samples: _Samples) -> tuple[NDArray[np.int64], _Samples]:
    """(m,) cell of every sample, and the cells' means; both sides of a foot fall into cells of their own."""
    quarter = np.floor(np.arctan2(samples.normal[:, 1], samples.normal[:, 0]) / (np.pi / 2))
    keys = np.column_stack([np.floor(samples.place / (SPAN / 2)), quarter]).astype(np.int64)
    cell = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    total = np.bincount(cell, samples.weight).astype(np.float64)
    place, normal = (
        np.stack([np.bincount(cell, samples.weight * x) / total for x in rows.T], axis=1)
        for rows in (samples.place, samples.normal)
    )
    return cell, _Samples(place, normal, total)


def _from_base_up(length: Floats, cells: _Samples) -> Floats:
    """Lengths counted from the other end where the tangent turned clockwise would point against the wall's normals."""
    order = np.argsort(length)[: np.isfinite(length).sum()]
    tangent = np.stack([-cells.normal[:, 1], cells.normal[:, 0]], axis=1)[order]
    # from cell to cell the place is noise; a few cells on it is a direction
    lag = max(1, len(order) // 20)
    steps = cells.place[order][lag:] - cells.place[order][:-lag]
    agreement = np.einsum("ij,ij->", steps, 0.5 * (tangent[lag:] + tangent[:-lag]))
    return length if agreement > 0 else np.nanmax(length) - length


def _fit_curve(samples: _Samples, s: Floats) -> BSplineCurve:
    """Smoothing spline through the samples, its parameter its length; least absolute distances, then Tukey's biweight.

    Least squares would start halfway to a handle, and the biweight would stay there. Stiff at first: where the vessel
    is out of round the turned wall is a broad band, and a limp curve would wander in it.
    """
    s = s - s.min()
    curve = _weighted_spline(samples.place, samples.weight, s, bending=STIFF)
    for k in range(ABSOLUTE_ROUNDS + BIWEIGHT_ROUNDS):
        s, away = _foot_lengths(curve, samples.place)
        scale = max(_weighted_median(away, samples.weight) / 0.6745, 1e-6)
        # the samples are a band about twice as broad as this: no bend may be shorter than the band is broad
        bending = max((BREADTHS * scale / SPAN) ** 4, LIMP)
        if k < ABSOLUTE_ROUNDS:
            trust = scale / np.maximum(away, 0.5 * scale)
            bending = max(bending, STIFF * (LIMP / STIFF) ** ((k + 1) / ABSOLUTE_ROUNDS))
        else:
            trust = np.clip(1.0 - (away / (4.685 * scale)) ** 2, 0.0, None) ** 2
        curve = _weighted_spline(samples.place, samples.weight * trust, s, bending=bending)
    before = float(np.clip(curve.control_points[0, 0] - LEAST_RADIUS, 0.0, EXTENDED))
    weight = samples.weight * trust
    return _weighted_spline(samples.place, weight, s + before, bending=bending, beyond=(before, EXTENDED))


def _weighted_spline(
    place: Floats, weight: Floats, s: Floats, *, bending: float, beyond: tuple[float, float] = (0.0, 0.0)
) -> BSplineCurve:
    """Least squares with a bending energy that bends nothing shorter than bending^(1/4) spans.

    beyond   lengths without samples before s[0] = beyond[0] and after the last, where the energy alone runs on straight
    """
    length = float(s.max()) + beyond[1]
    knots = uniform_knots(max(4, round(length / SPAN)) + 3, 3, 0.0, length)
    basis = basis_matrix(knots, 3, s)
    at = np.linspace(0.0, length, 4 * len(knots))
    bend = basis_matrix(knots, 3, at, 2) * (SPAN**2 * np.sqrt(bending * weight.sum() / len(at)))
    equations = sparse.csc_array(basis.T @ (basis * weight[:, None]) + bend.T @ bend)
    return BSplineCurve(3, knots, np.asarray(spsolve(equations, basis.T @ (place * weight[:, None]))))


def _foot_lengths(curve: BSplineCurve, place: Floats) -> tuple[Floats, Floats]:
    """(m,) length along the curve to every sample's foot point, and (m,) the distance from it."""
    line = curve.point(np.linspace(*curve.domain, 16 * len(curve.knots)))
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    foot = np.clip(cKDTree(line).query(place)[1], 1, len(line) - 2)
    along = line[foot + 1] - line[foot - 1]
    off = place - line[foot]
    share = np.clip(np.einsum("ij,ij->i", off, along) / np.einsum("ij,ij->i", along, along), -1.0, 1.0)
    s = length[foot] + share * (length[foot + 1] - length[foot - 1])
    return np.clip(s, 0.0, length[-1]), np.linalg.norm(off - share[:, None] * along, axis=1)


def _weighted_median(values: Floats, weight: Floats) -> float:
    order = np.argsort(values)
    total = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])
