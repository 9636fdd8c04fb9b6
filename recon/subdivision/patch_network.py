"""The limit surface as Bezier patches for a kernel: four-sided, one side collapsed to a point.

    C ------ C             a quartic triangle 0 1 2 as a bi-quartic patch: v runs from side 0-1 to corner 2,
     \\      /              side v = 1 is the corner. In row v the triangle is a quartic in u again.
      0----1
                            S(u, v) = T((1 - u)(1 - v), u (1 - v), v)

Regular patches are exact. An irregular one is the quartic through fifteen of its limit points, so its sides depend on
points of the side alone: the network has no gaps. How far it is off inside is measured.
"""

from math import comb

import numpy as np
from numpy.typing import NDArray

from recon.geometry.bspline import BSplineSurface
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.patches import PatchNetwork
from recon.subdivision.evaluation import points_at
from recon.subdivision.limit_surface import LimitPatches
from recon.subdivision.limit_tables import BEZIER_INDICES, quartic_bernstein

__all__ = ["limit_network"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

KNOTS = np.repeat([0.0, 1.0], 5)


def limit_network(mesh: ControlMesh, patches: LimitPatches) -> tuple[PatchNetwork, float]:
    """The surface as a network of bi-quartic patches, four a control face, and the largest distance between the two.

    The distance is measured at 21 points of each irregular patch; regular ones are exact.
    """
    nets, misfit = _bezier_nets(mesh, patches)
    surfaces = [BSplineSurface(4, 4, KNOTS, KNOTS, net) for net in _collapsed(nets)]
    faces, across = patches.sheets.faces, patches.sheets.across
    own = np.arange(across.size).reshape(across.shape)
    first = np.where(across < 0, own, np.minimum(own, across))
    leaders, edge = np.unique(first, return_inverse=True)
    edge = edge.reshape(across.shape)
    # sides of the patch: 0-1 along v = 0, 1-2 along u = 1, the point, and 0-2 along u = 0
    vertices = np.empty((len(patches.sheets.kinds), 3))
    vertices[faces] = nets[:, _corner_places()]
    edge_vertices = np.stack([faces.ravel()[leaders], np.roll(faces, -1, axis=1).ravel()[leaders]], axis=1)
    leads = first == own
    side_edges = np.stack([edge[:, 0], edge[:, 1], np.full(len(faces), -1), edge[:, 2]], axis=1)
    forward = np.stack([leads[:, 0], leads[:, 1], np.ones(len(faces), dtype=bool), ~leads[:, 2]], axis=1)
    corners = faces[:, [0, 1, 2, 2]]
    network = PatchNetwork(tuple(surfaces), vertices, edge_vertices, side_edges, forward, corners)
    return network, misfit


def _corner_places() -> Ints:
    """Where the three corners stand among the fifteen Bezier points."""
    return np.array([int(np.flatnonzero(BEZIER_INDICES[:, i] == 4)[0]) for i in range(3)])


def _side_places() -> Ints:
    """(3, 5) the Bezier points along each side, from corner i to corner i + 1."""
    rows = []
    for i in range(3):
        on = np.flatnonzero(BEZIER_INDICES[:, (i + 2) % 3] == 0)
        rows.append(on[np.argsort(BEZIER_INDICES[on, (i + 1) % 3])])
    return np.array(rows)


def _bezier_nets(mesh: ControlMesh, patches: LimitPatches) -> tuple[Floats, float]:
    """(C, 15, 3) Bezier points of every patch, and how far the irregular ones are off."""
    points = patches.points @ mesh.vertices
    n = len(patches.sheets.faces)
    _i, j, k = BEZIER_INDICES.T / 4.0
    values = _values(patches, points, np.arange(n), j, k)
    nets = np.einsum("ab,nbx->nax", np.linalg.inv(quartic_bernstein(j, k)), values)
    irregular = np.flatnonzero(patches.arrays.tables >= 0)
    _share_sides(nets, patches.sheets.across)
    if len(irregular) == 0:
        return nets, 0.0
    a, b = np.indices((6, 6)).reshape(2, -1)
    inside = a + b < 6
    v, w = (a[inside] + 1 / 3) / 6, (b[inside] + 1 / 3) / 6
    drawn = np.einsum("ab,nbx->nax", quartic_bernstein(v, w), nets[irregular])
    exact = _values(patches, points, irregular, v, w)
    return nets, float(np.linalg.norm(drawn - exact, axis=2).max())


def _share_sides(nets: Floats, across: Ints) -> None:
    """Give both patches on a side the same five Bezier points, those of the side that comes first, in place."""
    places = _side_places()
    for side in range(3):
        other = across[:, side]
        follows = (other >= 0) & (other < 3 * np.arange(len(across)) + side)
        mine, its = np.flatnonzero(follows), other[follows]
        nets[mine[:, None], places[side]] = nets[its[:, None] // 3, places[its % 3][:, ::-1]]


def _values(patches: LimitPatches, points: Floats, chosen: Ints, v: Floats, w: Floats) -> Floats:
    patch = np.repeat(chosen, len(v))
    where = np.tile(v, len(chosen)), np.tile(w, len(chosen))
    return points_at(patches.arrays, points, patch, *where, 1).reshape(len(chosen), len(v), 3)


def _collapsed(nets: Floats) -> Floats:
    """(C, 5, 5, 3) nets [along u, along v] of the bi-quartic patches: row v of the triangle raised to degree four."""
    full = np.zeros((len(nets), 5, 5, 3))
    number = {tuple(index): i for i, index in enumerate(BEZIER_INDICES.tolist())}
    for k in range(5):
        degree = 4 - k
        row = np.stack([nets[:, number[degree - j, j, k]] for j in range(degree + 1)], axis=1)
        for u in range(5):
            for j in range(max(0, u - k), min(degree, u) + 1):
                share = comb(degree, j) * comb(k, u - j) / comb(4, u)
                full[:, u, k] += share * row[:, j]
    return full
