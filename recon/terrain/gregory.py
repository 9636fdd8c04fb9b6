"""The paper's own patches: bicubic Gregory patches over the curve mesh, and the B-splines that stand for them.

    contour edge   the contour's own cubic, at its height
    tiling edge    straight in plan, its inner points at thirds, with heights in the tangent planes at its ends (3)
    junction       a Gregory patch with its side v = 1 in one point; the paper has a triangular one there

No entity of STEP is a Gregory patch. Its B-spline keeps the sides and their cross derivatives but next to the corners;
the knots there lie as close as the promised angle asks for.

Paper  [zhang2006], sections 4.2 and 5; its radical shortcut (7) is replaced by the full condition.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry
from recon.geometry.bspline import BSplineSurface
from recon.geometry.patches import COLLAPSED
from recon.numerics.bernstein import bernstein, bernstein_derivative
from recon.numerics.bspline_basis import basis_matrix, clamped_knots
from recon.numerics.gregory import GregoryNets, gregory_nets, spline_nets
from recon.numerics.rows import unit_vectors
from recon.terrain.merging import PatchLayout
from recon.terrain.patch_group import PatchGroup
from recon.terrain.second_derivatives import VertexJets
from recon.terrain.tiling import Tiling

__all__ = ["GregoryPatches", "gregory_folds", "gregory_patches"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

FIRST_SPANS = (0.25, 0.1, 0.03, 0.01, 0.003, 0.001, 3e-4, 1e-4, 3e-5, 1e-5)  # tried in turn, until the angle is kept
UP = np.array([0.0, 0.0, 1.0])
FOLD_SAMPLES = np.linspace(0.0, 1.0, 15)
AT_ONCE = 4096  # patches, which bounds the memory
POINT = 1e-9  # of the side across: a side no longer is a point, but for rounding
LEAST_AREA = 0.02  # of a plan map's Jacobian, at least so much of its greatest
WIDENING = 3.0  # of the spans from a corner inward


@dataclass(frozen=True, eq=False)
class GregoryPatches(PatchGroup):
    """Gregory patches of a terrain, and how finely each becomes a B-spline.

    rows   (n,) patches of the layout
    nets   their control points
    level  (n,) place of the first span in FIRST_SPANS
    apart  (n, 4) radians between the tangent planes of patch and B-spline along each side, at most
    """

    rows: Ints
    nets: GregoryNets
    level: Ints
    apart: Floats

    def points(self, index: Ints, uv: Floats) -> tuple[Floats, Floats, Floats]:
        point, along_u, along_v = self.nets.part(index).points(uv[:, None])
        return point[:, 0], along_u[:, 0], along_v[:, 0]

    def grid(self, t: Floats) -> Floats:
        u, v = np.meshgrid(t, t, indexing="ij")
        points = self.nets.points(np.column_stack([u.ravel(), v.ravel()]))[0]
        return points.reshape(len(self.rows), len(t), len(t), 3)

    def normals(self, u: Floats, v: Floats) -> Floats:
        _, along_u, along_v = self.nets.points(np.column_stack([u, v]))
        return unit_vectors(np.cross(along_u, along_v))

    def boxes(self) -> tuple[Floats, Floats]:
        hull = np.concatenate([self.nets.net_s, self.nets.net_t], axis=1)[..., :2]
        return hull.min(axis=(1, 2)), hull.max(axis=(1, 2))

    def surfaces(self) -> list[BSplineSurface]:
        made: dict[int, BSplineSurface] = {}
        for level in np.unique(self.level).tolist():
            own = np.flatnonzero(self.level == level)
            breaks = _breaks(FIRST_SPANS[level])
            knots = clamped_knots(breaks, 3)
            part = self.nets.part(own)
            nets = spline_nets(part.moved(-part.corner), breaks) + part.corner
            made |= {k: BSplineSurface(3, 3, knots, knots, net) for k, net in zip(own.tolist(), nets)}
        return [made[k] for k in range(len(self.rows))]

    def stray(self) -> float:
        return float(self.apart.max(initial=0.0))

    def folded(self) -> Flags:
        """(n,) on a grid of samples: in a narrow steep patch, tangent planes push the inside over the sides."""
        top, extent = (np.ptp(net, axis=1).max(axis=1) for net in (self.nets.net_s[:, :, 3], self.nets.net_s[:, :, 0]))
        return _turned_over(self.nets, top < POINT * extent)

    def part(self, kept: Flags, rows: Ints) -> "GregoryPatches":
        return replace(self, rows=rows, nets=self.nets.part(kept), level=self.level[kept], apart=self.apart[kept])

    def replaced(self, new: "GregoryPatches") -> "GregoryPatches":
        at = np.searchsorted(self.rows, new.rows)
        net_s, net_t = self.nets.net_s.copy(), self.nets.net_t.copy()
        level, apart = self.level.copy(), self.apart.copy()
        net_s[at], net_t[at], level[at], apart[at] = new.nets.net_s, new.nets.net_t, new.level, new.apart
        return replace(self, nets=GregoryNets(net_s, net_t), level=level, apart=apart)


def gregory_patches(
    tiling: Tiling, layout: PatchLayout, jets: VertexJets, chosen: Ints | None = None, *, angle: float
) -> tuple[GregoryPatches]:
    """Gregory patches of the chosen rows of the layout, or of all.

    angle   degrees that the tangent planes of two B-splines may differ by along their common edge
    Raises  BadGeometry naming a place, when no knots keep the angle.
    """
    rows = np.arange(len(layout.corners)) if chosen is None else chosen
    part = layout.part(rows)
    slopes = jets.gradient[part.corners]
    normals = unit_vectors(np.concatenate([-slopes, np.ones((*slopes.shape[:2], 1))], axis=2))
    places = np.column_stack([tiling.points, jets.height])
    nets = gregory_nets(_sides(_edge_curves(tiling, places, jets.gradient), places, part), normals, UP)
    level, apart = _levels(nets, part.side_edges == COLLAPSED, 0.5 * np.radians(angle))
    if (level < 0).any():
        worst = int(np.argmin(level))
        x, y, _ = nets.net_s[worst].mean(axis=(0, 1))
        raise BadGeometry(
            "contours",
            f"a Gregory patch near ({x:.1f}, {y:.1f}), from the middle of the map, cannot become a B-spline within"
            f" {angle:g} degrees of its neighbours: allow more (--angle), or leave --patches gregory away",
        )
    return (GregoryPatches(rows, nets, level, apart),)


def gregory_folds(tiling: Tiling, layout: PatchLayout) -> Flags:
    """(P,) whether the plan map of a Gregory patch turns over, on a grid of samples; no heights need be known."""
    places = np.column_stack([tiling.points, np.zeros(len(tiling.points))])
    curves = _edge_curves(tiling, places, np.zeros((len(places), 2)))
    nets = gregory_nets(_sides(curves, places, layout), np.broadcast_to(UP, (len(layout.corners), 4, 3)), UP)
    return _turned_over(nets, layout.is_triangle)


def _turned_over(nets: GregoryNets, triangle: Flags) -> Flags:
    """(P,) whether the Jacobian of a plan map is not positive everywhere, by a share of its greatest."""
    found = np.zeros(len(triangle), dtype=bool)
    u, v = np.meshgrid(FOLD_SAMPLES, 0.98 * FOLD_SAMPLES, indexing="ij")  # short of an apex
    places = np.column_stack([u.ravel(), v.ravel()])
    for first in range(0, len(triangle), AT_ONCE):
        rows = np.arange(first, min(first + AT_ONCE, len(triangle)))
        _, along_u, along_v = nets.part(rows).points(places)
        area = along_u[..., 0] * along_v[..., 1] - along_u[..., 1] * along_v[..., 0]
        # towards a collapsed side, where it vanishes, in measure of what is left of the side
        area = area / np.where(triangle[rows, None], 1.0 - v.ravel(), 1.0)
        found[rows] = area.min(axis=1) <= LEAST_AREA * area.max(axis=1)
    return found


def _edge_curves(tiling: Tiling, places: Floats, gradient: Floats) -> Floats:
    """(E, 4, 3) cubic of every edge of the tiling between its places (V, 3), in the edge's own direction."""
    start, end = places[tiling.edges].transpose(1, 0, 2)
    curves = start[:, None] + np.linspace(0.0, 1.0, 4)[:, None] * (end - start)[:, None]
    way = (end - start)[:, :2]
    for vertex, at, sign in ((0, 1, 1.0), (1, 2, -1.0)):
        rise = np.einsum("nd,nd->n", gradient[tiling.edges[:, vertex]], way)
        curves[:, at, 2] = (start, end)[vertex][:, 2] + sign * rise / 3.0
    segment = tiling.edge_segment
    contour = np.flatnonzero(segment >= 0)
    curves[contour, :, :2] = tiling.curves.bezier[segment[contour]]
    curves[contour, :, 2] = start[contour, 2:]
    return curves


def _sides(curves: Floats, places: Floats, part: PatchLayout) -> tuple[Floats, Floats, Floats, Floats]:
    """(n, 4, 3) cubics of the four sides of every patch, along growing u or v; one point where a side is collapsed."""
    apex, sides = places[part.corners[:, 3]][:, None], []
    for edge, forward in zip(part.side_edges.T, part.side_forward.T):
        own = np.where(forward[:, None, None], curves[edge], curves[edge][:, ::-1])
        sides.append(np.where((edge == COLLAPSED)[:, None, None], apex, own))
    return sides[0], sides[1], sides[2], sides[3]


def _breaks(first: float) -> Floats:
    """Breaks over [0, 1], symmetric, wider and wider from either end."""
    half = [0.0]
    step = first
    while step < 0.5:
        half.append(step)
        step *= WIDENING
    if len(half) < 3:
        return np.linspace(0.0, 1.0, 5)
    return np.concatenate([half, [0.5], 1.0 - np.array(half[::-1])])


def _levels(nets: GregoryNets, collapsed: Flags, allowed: float) -> tuple[Ints, Floats]:
    """(n,) the coarsest knots that keep every side within the angle, -1 for none, and (n, 4) the angles there."""
    level, apart = np.full(len(nets.net_s), -1), np.zeros((len(nets.net_s), 4))
    nets = nets.moved(-nets.corner)
    for k, first in enumerate(FIRST_SPANS):
        open_ = np.flatnonzero(level < 0)
        if not len(open_):
            break
        breaks = _breaks(first)
        found = _angles(nets.part(open_), spline_nets(nets.part(open_), breaks), breaks)
        found[collapsed[open_]] = 0.0
        kept = (found <= allowed).all(axis=1)
        level[open_[kept]], apart[open_[kept]] = k, found[kept]
    return level, apart


def _angles(nets: GregoryNets, splines: Floats, breaks: Floats) -> Floats:
    """(n, 4) radians between the tangent planes of patches and B-splines along the sides, on samples in every span."""
    knots = clamped_knots(breaks, 3)
    t = np.interp(np.arange(4 * len(breaks) - 3) / 4.0, np.arange(len(breaks)), breaks)[
        1:-1
    ]  # no corner: one may be an apex
    fine, coarse = basis_matrix(knots, 3, t).toarray(), bernstein(3, t)
    along = bernstein_derivative(3, t)
    angles = []
    for side in range(4):
        net = nets.net_s.transpose(0, 2, 1, 3) if side in (0, 2) else nets.net_t
        spline = splines.transpose(0, 2, 1, 3) if side in (0, 2) else splines
        if side in (1, 2):
            net, spline = net[:, ::-1], spline[:, ::-1]
        tangent = along @ net[:, 0]
        given, made = coarse @ (net[:, 1] - net[:, 0]), fine @ (spline[:, 1] - spline[:, 0])
        one, other = (unit_vectors(np.cross(tangent, across)) for across in (given, made))
        sine = np.linalg.norm(np.cross(one, other), axis=2)
        angles.append(np.arcsin(np.clip(sine, 0.0, 1.0)).max(axis=1))
    return np.stack(angles, axis=1)
