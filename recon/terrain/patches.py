"""Step 6, patches: one polynomial surface a patch, with given height and gradient along its sides.

    plan     X(u, v) = (1 - v) a(u) + v b(u)
    side     z_v(u, 0) = gradient . X_v(u, 0),   z_u(0, v) = gradient . X_u(0, v),   and so on
    inside   z = bicubically blended Coons:  P_v z + P_u z - P_u P_v z,  P the cubic Hermite interpolants of the sides

Every term is a polynomial: degree 8 x 5 where side 0 or 2 is a contour edge, 5 x 5 elsewhere. The corner twists
z_uv = X_u . H X_v + g . X_uv agree from both sides because the Hessian H belongs to the vertex.

Paper  [zhang2006], section 5, has Gregory patches here, as `recon.terrain.gregory` does; Coons patches as in
[farin2002], chapter 22.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.geometry.bspline import BSplineSurface
from recon.geometry.patches import COLLAPSED
from recon.numerics.bernstein import bernstein, bernstein_derivative, bernstein_product, degree_elevation
from recon.numerics.rows import unit_vectors
from recon.terrain.curve_mesh import EdgeFields, edge_fields
from recon.terrain.merging import PatchLayout, plan_sides
from recon.terrain.patch_group import PatchGroup
from recon.terrain.second_derivatives import VertexJets
from recon.terrain.tiling import Tiling

__all__ = ["PatchNets", "patch_nets"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

DEGREE_V = 5
CURVED, STRAIGHT = 8, 5  # degree in u with and without a contour side


@dataclass(frozen=True, eq=False)
class PatchNets(PatchGroup):
    """Bezier control nets of one degree.

    rows  (n,) patches of the layout
    nets  (n, degree + 1, 6, 3)
    """

    rows: Ints
    nets: Floats

    @property
    def degree(self) -> int:
        return self.nets.shape[1] - 1

    def points(self, index: Ints, uv: Floats) -> tuple[Floats, Floats, Floats]:
        u, v = uv.T
        bu, bv, du, dv = self._basis(u, v)
        net = self.nets[index]
        point, along_u, along_v = (
            np.einsum("ni,nijd,nj->nd", a, net, b, optimize=True) for a, b in ((bu, bv), (du, bv), (bu, dv))
        )
        return point, along_u, along_v

    def plan(self, index: Ints, uv: Floats) -> tuple[Floats, Floats, Floats]:
        """By the ruled map, which is the linear blend of the two sides."""
        u, v = uv[:, 0], uv[:, 1:]
        value, slope = bernstein(self.degree, u), bernstein_derivative(self.degree, u)
        bottom, top = self.nets[index, :, 0, :2], self.nets[index, :, -1, :2]
        low, high, low_u, high_u = (
            np.einsum("nk,nkd->nd", basis, net) for basis in (value, slope) for net in (bottom, top)
        )
        return (1 - v) * low + v * high, (1 - v) * low_u + v * high_u, high - low

    def grid(self, t: Floats) -> Floats:
        value = bernstein(self.degree, t) @ self.nets.transpose(0, 3, 1, 2) @ bernstein(DEGREE_V, t).T
        return np.asarray(value.transpose(0, 2, 3, 1))

    def heights(self, t: Floats) -> Floats:
        return np.asarray(bernstein(self.degree, t) @ self.nets[..., 2] @ bernstein(DEGREE_V, t).T)

    def normals(self, u: Floats, v: Floats) -> Floats:
        bu, bv, du, dv = self._basis(u, v)
        along = [np.einsum("mi,nijd,mj->nmd", a, self.nets, b, optimize=True) for a, b in ((du, bv), (bu, dv))]
        return unit_vectors(np.cross(along[0], along[1]))

    def _basis(self, u: Floats, v: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        return (
            bernstein(self.degree, u),
            bernstein(DEGREE_V, v),
            bernstein_derivative(self.degree, u),
            bernstein_derivative(DEGREE_V, v),
        )

    def boxes(self) -> tuple[Floats, Floats]:
        sides = self.nets[:, :, [0, -1], :2]
        return sides.min(axis=(1, 2)), sides.max(axis=(1, 2))

    def surfaces(self) -> list[BSplineSurface]:
        knots_u, knots_v = (np.repeat([0.0, 1.0], degree + 1) for degree in (self.degree, DEGREE_V))
        return [BSplineSurface(self.degree, DEGREE_V, knots_u, knots_v, net) for net in self.nets]

    def part(self, kept: NDArray[np.bool_], rows: Ints) -> "PatchNets":
        return PatchNets(rows, self.nets[kept])

    def replaced(self, new: "PatchNets") -> "PatchNets":
        nets = self.nets.copy()
        nets[np.searchsorted(self.rows, new.rows)] = new.nets
        return PatchNets(self.rows, nets)


def patch_nets(
    tiling: Tiling, layout: PatchLayout, jets: VertexJets, chosen: Ints | None = None
) -> tuple[PatchNets, PatchNets]:
    """Control nets of the chosen patches, or of all: those with a contour side, and those without."""
    rows = np.arange(len(layout.corners)) if chosen is None else chosen
    sides = layout.side_edges[rows]
    curved = np.where(sides == COLLAPSED, False, tiling.is_contour[sides]).any(axis=1)
    fields = edge_fields(tiling, jets, np.unique(sides[sides != COLLAPSED]))
    made = []
    for own, degree in ((rows[curved], CURVED), (rows[~curved], STRAIGHT)):
        part = layout.part(own)
        sides_of = _Sides.of(tiling, part, jets, fields)
        made.append(PatchNets(own, _nets(part, jets, sides_of, plan_sides(tiling, part), degree)))
    return made[0], made[1]


@dataclass(frozen=True, eq=False)
class _Sides:
    """Bernstein coefficients along each side, in its own direction: heights (P, 6) and gradients (P, 6, 2).

    Heights are counted from that of corner 0.
    """

    height: tuple[Floats, ...]
    gradient: tuple[Floats, ...]

    @classmethod
    def of(cls, tiling: Tiling, layout: PatchLayout, jets: VertexJets, fields: EdgeFields) -> "_Sides":
        heights, gradients = [], []
        base = jets.height[layout.corners[:, 0]]
        for edge, forward in zip(layout.side_edges.T, layout.side_forward.T):
            z, g = fields.height[fields.place[edge]], fields.gradient[fields.place[edge]]
            z += (jets.height[tiling.edges[edge, 0]] - base)[:, None]
            z = np.where(forward[:, None], z, z[:, ::-1])
            g = np.where(forward[:, None, None], g, g[:, ::-1])
            point = edge == COLLAPSED
            z[point] = (jets.height[layout.corners[point, 3]] - base[point])[:, None]
            g[point] = jets.gradient[layout.corners[point, 3]][:, None]
            heights.append(z)
            gradients.append(g)
        return cls(tuple(heights), tuple(gradients))


# coefficients, columns, of the cubic Hermite functions: value and slope at 0, value and slope at 1
_HERMITE = np.array([[3, 0, 0, 0], [3, 1, 0, 0], [0, 0, 3, -1], [0, 0, 3, 0]]) / 3.0
_REDUCTION = np.linalg.pinv(degree_elevation(4, 5))  # of gradients along tiling edges, which are of degree 4


def _nets(layout: PatchLayout, jets: VertexJets, sides: _Sides, plan: tuple[Floats, Floats], degree: int) -> Floats:
    bottom, top = plan
    across = top - bottom  # X_v, the same at v = 0 and 1
    steps = [[3 * (net[:, 1] - net[:, 0]), 3 * (net[:, 3] - net[:, 2])] for net in plan]
    along = [np.stack([steps[0][k], steps[1][k]], axis=1) for k in (0, 1)]  # X_u at u = k
    raised = degree_elevation(DEGREE_V, degree)
    in_v = np.stack([
        sides.height[0] @ raised.T, _directed(sides.gradient[0], across, degree),
        sides.height[2] @ raised.T, _directed(sides.gradient[2], across, degree),
    ])  # fmt: skip
    in_u = np.stack([
        sides.height[3], _directed(sides.gradient[3], along[0], DEGREE_V),
        sides.height[1], _directed(sides.gradient[1], along[1], DEGREE_V),
    ])  # fmt: skip
    hu, hv = degree_elevation(3, degree) @ _HERMITE, degree_elevation(3, DEGREE_V) @ _HERMITE
    corner = _corner_tensor(layout, jets, plan)
    z = in_v.transpose(1, 2, 0) @ hv.T + hu @ (in_u.transpose(1, 0, 2) - corner @ hv.T)
    net = np.empty((len(z), degree + 1, DEGREE_V + 1, 3))
    net[..., 2] = z + jets.height[layout.corners[:, 0], None, None]
    raise_u, v = degree_elevation(3, degree), np.linspace(0, 1, DEGREE_V + 1)
    low, high = ((raise_u @ side)[:, :, None] for side in plan)
    net[..., :2] = (1 - v)[:, None] * low + v[:, None] * high
    return net


def _directed(gradient: Floats, way: Floats, degree: int) -> Floats:
    """(P, degree + 1) coefficients of the slope along a way: one that is cubic, or linear, from end to end."""
    if degree == CURVED:
        product = bernstein_product(DEGREE_V, 3)
    else:
        gradient, way, product = _REDUCTION @ gradient, way[:, [0, -1]], bernstein_product(DEGREE_V - 1, 1)
    outer = gradient[:, :, None, 0] * way[:, None, :, 0] + gradient[:, :, None, 1] * way[:, None, :, 1]
    return np.asarray(outer.reshape(-1, product[0].size) @ product.reshape(len(product), -1).T)


def _corner_tensor(layout: PatchLayout, jets: VertexJets, plan: tuple[Floats, Floats]) -> Floats:
    """(P, 4, 4) heights from that of corner 0, slopes and twists at the corners.

    Rows are z and z_u at u = 0, then at u = 1; columns so in v.
    """
    tensor = np.empty((len(layout.corners), 4, 4))
    across = [plan[1][:, 3 * k] - plan[0][:, 3 * k] for k in (0, 1)]
    steps = [[3 * (net[:, 1] - net[:, 0]), 3 * (net[:, 3] - net[:, 2])] for net in plan]
    for (i, j), corner in zip(((0, 0), (1, 0), (1, 1), (0, 1)), range(4)):
        vertex = layout.corners[:, corner]
        g, h = jets.gradient[vertex], jets.hessian[vertex]
        x_u, x_v, x_uv = steps[j][i], across[i], steps[1][i] - steps[0][i]
        tensor[:, 2 * i, 2 * j] = jets.height[vertex] - jets.height[layout.corners[:, 0]]
        tensor[:, 2 * i + 1, 2 * j] = np.einsum("nd,nd->n", g, x_u)
        tensor[:, 2 * i, 2 * j + 1] = np.einsum("nd,nd->n", g, x_v)
        tensor[:, 2 * i + 1, 2 * j + 1] = np.einsum("ni,nij,nj->n", x_u, h, x_v) + np.einsum("nd,nd->n", g, x_uv)
    return tensor
