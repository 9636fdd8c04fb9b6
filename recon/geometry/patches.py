"""Networks of four-sided patches that share their edges.

A patch S(u, v) has four sides, each run through in the direction of growing parameter:

             side 2 (v = 1)
           +------->-------+
           |               |
    side 3 ^               ^ side 1          corners 0 .. 3 counter-clockwise:
    (u = 0)|               | (u = 1)         (0,0) (1,0) (1,1) (0,1)
           +------->-------+
             side 0 (v = 0)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry
from recon.geometry.arrays import frozen_bools, frozen_floats, frozen_ints
from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.numerics.bernstein import degree_elevation
from recon.numerics.bspline_basis import basis_matrix

__all__ = ["PatchMosaic", "PatchNetwork", "side_curve", "sides_apart", "connect"]

Floats = NDArray[np.float64]
COLLAPSED = -1


def side_curve(patch: BSplineSurface, side: int) -> BSplineCurve:
    """The boundary curve of a patch along one of its four sides, exact."""
    pick = (np.s_[:, 0], np.s_[-1, :], np.s_[:, -1], np.s_[0, :])[side]
    degree, knots = (patch.degree_u, patch.knots_u) if side in (0, 2) else (patch.degree_v, patch.knots_v)
    weights = None if patch.weights is None else patch.weights[pick]
    return BSplineCurve.of_checked(degree, knots, patch.control_net[pick], weights)


def sides_apart(one: BSplineCurve, other: BSplineCurve) -> float | None:
    """A bound on how far two curves are apart at equal parameters; None where it does not follow from control points.

    They have to be polynomials without inner knots over one domain; the lower degree is raised to the higher.
    """
    simple = all(curve.weights is None and len(curve.control_points) == curve.degree + 1 for curve in (one, other))
    if not simple or one.domain != other.domain:
        return None
    degree = max(one.degree, other.degree)
    raised = [
        c.control_points if c.degree == degree else degree_elevation(c.degree, degree) @ c.control_points
        for c in (one, other)
    ]
    return float(np.sqrt(((raised[0] - raised[1]) ** 2).sum(axis=1).max()))


@dataclass(frozen=True, eq=False)
class PatchNetwork:
    """Patches joined along whole sides.

    patches         P surfaces
    vertices        (V, 3) corner points, each once
    edge_vertices   (E, 2) start and end vertex of every edge; the same twice for a closed edge
    side_edges      (P, 4) edge along each side, or -1 where the side is collapsed to a point; the same edge on two
                    sides of one patch is a seam
    side_forward    (P, 4) whether the edge runs in the side's own direction
    corner_vertices (P, 4) vertex at each corner
    Raises  BadGeometry when a number is out of range or an edge does not join its side's corners.
    """

    patches: tuple[BSplineSurface, ...]
    vertices: NDArray[np.float64]
    edge_vertices: NDArray[np.int64]
    side_edges: NDArray[np.int64]
    side_forward: NDArray[np.bool_]
    corner_vertices: NDArray[np.int64]

    def __post_init__(self) -> None:
        n = len(self.patches)
        object.__setattr__(self, "patches", tuple(self.patches))
        object.__setattr__(self, "vertices", frozen_floats(self.vertices, (None, 3), "patch network: vertices"))
        for name, shape in (("edge_vertices", (None, 2)), ("side_edges", (n, 4)), ("corner_vertices", (n, 4))):
            object.__setattr__(self, name, frozen_ints(getattr(self, name), shape, f"patch network: {name}"))
        forward = frozen_bools(self.side_forward, (n, 4), "patch network: side_forward")
        object.__setattr__(self, "side_forward", forward)
        self._check_corners()

    def _check_corners(self) -> None:
        begin = self.corner_vertices[:, [0, 1, 3, 0]]
        end = self.corner_vertices[:, [1, 2, 2, 3]]
        used = self.side_edges != COLLAPSED
        if self.side_edges.max(initial=0) >= len(self.edge_vertices) or self.side_edges.min(initial=0) < COLLAPSED:
            raise BadGeometry("patch network", "a side names an edge that does not exist")
        _require_vertices(self.edge_vertices, len(self.vertices), "patch network: edge_vertices")
        _require_vertices(self.corner_vertices, len(self.vertices), "patch network: corner_vertices")
        pairs = np.append(self.edge_vertices, [[COLLAPSED, COLLAPSED]], axis=0)[self.side_edges]
        first = np.where(self.side_forward, pairs[..., 0], pairs[..., 1])
        last = np.where(self.side_forward, pairs[..., 1], pairs[..., 0])
        wrong = np.where(used, (first != begin) | (last != end), begin != end)
        if wrong.any():
            patch, side = (int(i) for i in np.argwhere(wrong)[0])
            raise BadGeometry(
                "patch network", f"the edge on side {side} of patch {patch} does not join that side's corners"
            )


@dataclass(frozen=True, eq=False)
class PatchMosaic:
    """Patches of different sizes: a side may run along several edges, one after the other.

          +-------+---+       side 1 of A runs along two edges, for B and C lie beyond it
          |       | C |
          |   A   +---+
          |       | B |
          +-------+---+

    patches         P surfaces
    vertices        (V, 3) points where edges end
    edge_curves     E curves, each running from its start vertex to its end vertex
    edge_vertices   (E, 2) those vertices
    smooth_edges    (E,) whether the tangent planes of both patches are to agree along the edge
    side_starts     (4 P + 1,) where the row of each side begins: side s of patch p is row 4 p + s; an empty row is a
                    side collapsed to a point
    side_edges      (K,) edges along the sides, in the sides' own direction
    side_forward    (K,) whether the edge runs in that direction
    side_ranges     (K, 2) parameters of the side at the edge's start and end
    Raises  BadGeometry when a number is out of range or the edges of a side do not follow each other.
    """

    patches: tuple[BSplineSurface, ...]
    vertices: NDArray[np.float64]
    edge_curves: tuple[BSplineCurve, ...]
    edge_vertices: NDArray[np.int64]
    smooth_edges: NDArray[np.bool_]
    side_starts: NDArray[np.int64]
    side_edges: NDArray[np.int64]
    side_forward: NDArray[np.bool_]
    side_ranges: NDArray[np.float64]

    def __post_init__(self) -> None:
        object.__setattr__(self, "side_edges", frozen_ints(self.side_edges, (None,), "patch mosaic: side_edges"))
        what, n_edges, n_uses = "patch mosaic", len(self.edge_curves), len(self.side_edges)
        object.__setattr__(self, "patches", tuple(self.patches))
        object.__setattr__(self, "edge_curves", tuple(self.edge_curves))
        object.__setattr__(self, "vertices", frozen_floats(self.vertices, (None, 3), f"{what}: vertices"))
        object.__setattr__(self, "side_ranges", frozen_floats(self.side_ranges, (n_uses, 2), f"{what}: side_ranges"))
        shapes = {"edge_vertices": (n_edges, 2), "side_starts": (4 * len(self.patches) + 1,)}
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen_ints(getattr(self, name), shape, f"{what}: {name}"))
        for name, size in (("smooth_edges", n_edges), ("side_forward", n_uses)):
            object.__setattr__(self, name, frozen_bools(getattr(self, name), (size,), f"{what}: {name}"))
        self._check_sides()

    def _check_sides(self) -> None:
        if self.side_edges.max(initial=-1) >= len(self.edge_curves) or self.side_edges.min(initial=0) < 0:
            raise BadGeometry("patch mosaic", "a side names an edge that does not exist")
        _require_vertices(self.edge_vertices, len(self.vertices), "patch mosaic: edge_vertices")
        if self.side_starts[0] or self.side_starts[-1] != len(self.side_edges) or (np.diff(self.side_starts) < 0).any():
            raise BadGeometry("patch mosaic", "side_starts does not divide side_edges into sides")
        ends = self.edge_vertices[self.side_edges]
        begin = np.where(self.side_forward, ends[:, 0], ends[:, 1])
        last = np.where(self.side_forward, ends[:, 1], ends[:, 0])
        follows = np.ones(max(len(begin) - 1, 0), dtype=bool)
        inner = self.side_starts[(self.side_starts > 0) & (self.side_starts < len(begin))]
        follows[inner - 1] = False
        broken = follows & (last[:-1] != begin[1:])
        if broken.any():
            side = int(np.searchsorted(self.side_starts, np.argmax(broken), side="right")) - 1
            raise BadGeometry("patch mosaic", f"the edges along side {side % 4} of patch {side // 4} do not join")

    @property
    def is_closed(self) -> bool:
        """Whether every edge has two patches."""
        return bool((np.bincount(self.side_edges, minlength=len(self.edge_curves)) == 2).all())


def _require_vertices(numbers: NDArray[np.int64], n_vertices: int, what: str) -> None:
    if numbers.size and (numbers.min() < 0 or numbers.max() >= n_vertices):
        raise BadGeometry(what, f"names a vertex outside 0 to {n_vertices - 1}")


SHARES = np.linspace(0.0, 1.0, 9)  # of a side's parameter range, where sides are compared
BEGIN, END = [0, 1, 3, 0], [1, 2, 2, 3]  # corners at which the four sides begin and end


def connect(patches: Sequence[BSplineSurface], merge: float) -> PatchNetwork:
    """Find out which sides of patches are one edge, in either direction, at any speed; which are seams, or collapsed.

    merge     length: corners and sides that lie closer are one
    Promises  an edge runs in the direction of the first side that carries it; free sides have an edge of their own.
    Raises    BadGeometry when there is no patch.
    """
    if not patches:
        raise BadGeometry("patch network", "has no patches")
    sides = _sampled_sides(patches)
    vertices, corners = _merged_corners(sides[:, [0, 0, 1, 2], [0, -1, -1, 0]], merge)
    collapsed = np.linalg.norm(sides - sides[:, :, :1], axis=3).max(axis=2) <= merge
    side_edges = np.full((len(patches), 4), COLLAPSED)
    side_forward = np.ones((len(patches), 4), dtype=bool)
    edges: list[tuple[int, int]] = []
    known: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
    for p, side in np.argwhere(~collapsed).tolist():
        start, end = int(corners[p, BEGIN[side]]), int(corners[p, END[side]])
        alike = known.setdefault((min(start, end), max(start, end)), [])
        found = _same_side(patches, sides, (p, side), alike, merge)
        if found is None:
            found = len(edges), True
            alike.append((found[0], p, side))
            edges.append((start, end))
        side_edges[p, side], side_forward[p, side] = found
    return PatchNetwork(
        tuple(patches), vertices, np.array(edges).reshape(-1, 2), side_edges, side_forward.astype(np.int64), corners
    )


def _sampled_sides(patches: Sequence[BSplineSurface]) -> Floats:
    """(P, 4, m, 3) points along every side in its own direction; the basis is kept for sides with the same knots."""
    bases: dict[tuple[int, bytes], Any] = {}
    sides = np.empty((len(patches), 4, len(SHARES), 3))
    for p, patch in enumerate(patches):
        for side in range(4):
            curve = side_curve(patch, side)
            key = curve.degree, curve.knots.tobytes()
            if key not in bases:
                first, last = curve.domain
                bases[key] = basis_matrix(curve.knots, curve.degree, first + SHARES * (last - first))
            basis = bases[key]
            if curve.weights is None:
                sides[p, side] = basis @ curve.control_points
            else:
                weighted = basis @ (curve.control_points * curve.weights[:, None])
                sides[p, side] = weighted / (basis @ curve.weights)[:, None]
    return sides


def _merged_corners(points: Floats, merge: float) -> tuple[Floats, NDArray[np.int64]]:
    """(V, 3) the first of every group of corners that lie within `merge`, and (P, 4) the group of each corner."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    flat = points.reshape(-1, 3)
    pairs = cKDTree(flat).query_pairs(merge, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(flat), len(flat)))
    group = connected_components(graph, directed=False)[1]
    _, first = np.unique(group, return_index=True)
    return flat[first], group.reshape(-1, 4).astype(np.int64)


def _same_side(
    patches: Sequence[BSplineSurface],
    sides: Floats,
    here: tuple[int, int],
    alike: list[tuple[int, int, int]],
    merge: float,
) -> tuple[int, bool] | None:
    """Edge among `alike` (edge, patch, side) along which this side runs too, and whether in the same direction."""
    mine = sides[here]
    for e, p, side in alike:
        its = sides[p, side]
        for way in (True, False):
            if np.linalg.norm(mine - its[:: 1 if way else -1], axis=1).max() <= merge:
                return e, way
    for e, p, side in alike:
        curve = side_curve(patches[p], side)
        t = _foot_parameters(curve, mine)
        if np.linalg.norm(curve.point(t) - mine, axis=1).max() <= merge:
            return e, bool(t[len(t) // 2] > t[1])
    return None


def _foot_parameters(curve: BSplineCurve, points: Floats) -> Floats:
    """(m,) parameters of the curve near the points, exact for points on it: Gauss-Newton from 65 samples."""
    first, last = curve.domain
    seeds = np.linspace(first, last, 65)
    t = seeds[np.linalg.norm(points[:, None] - curve.point(seeds), axis=2).argmin(axis=1)]
    for _ in range(12):
        slope = curve.derivative(t)
        step = np.einsum("ij,ij->i", points - curve.point(t), slope)
        square = np.einsum("ij,ij->i", slope, slope)
        t = np.clip(t + np.divide(step, square, out=np.zeros_like(t), where=square > 0), first, last)
    return t
