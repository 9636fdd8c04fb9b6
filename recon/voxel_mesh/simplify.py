"""Fewer faces, by edge collapse, with what plain collapse does not promise: topology, no cuts, a bounded error.

The bound is kept while edges collapse and verified when all is done, on other points.  Where the verification still
finds a place beyond it, or two faces that cut each other, the vertices around are locked and all is done once more.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import Refusal
from recon.numerics.cell_lookup import CellLookup, surface_distances
from recon.numerics.closed_mesh import opposite_halfedges
from recon.numerics.distance import closest_points, sample_surface
from recon.numerics.edge_collapse import REGULARISER, collapse_edges, collapse_mesh
from recon.numerics.edge_heap import edge_heap
from recon.numerics.error_bound import face_bound, no_bound
from recon.numerics.quadrics import vertex_quadrics
from recon.numerics.self_intersection import crossing_triangles
from recon.voxel_mesh.marching_cubes import GridSurface

__all__ = ["Goal", "Simplified", "collapsed_between", "inner_limit", "simplified", "used_rows"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

MARGIN = 0.02  # voxels kept back while collapsing, for what lies between samples
PROBES = 60_000  # points a way for the verification, on the grid's surface twice as many
FEW_PROBES = 10_000  # where nothing is promised of the error
ROUNDS = 6
REACH = 2.0  # voxels around a bad place that are locked, doubled each round


@dataclass(frozen=True)
class Goal:
    """When to stop.

    n_faces    faces that are few enough
    tolerance  largest distance from the grid's surface, both ways, in voxels; None leaves it open
    """

    n_faces: int = 4
    tolerance: float | None = 0.5


@dataclass(frozen=True, eq=False)
class Simplified:
    """The surface with fewer faces.

    vertices       (V, 3) in voxels
    face_vertices  (F, 3)
    errors         (n,) distances found between the two surfaces, both ways, in voxels
    features_kept  feature vertices that are still there
    rounds         times that all was done
    """

    vertices: Floats
    face_vertices: Ints
    errors: Floats
    features_kept: int
    rounds: int


def simplified(
    surface: GridSurface,
    proportions: Floats,
    goal: Goal,
    *,
    feature: Bools | None = None,
    doing: Callable[[str], None] = lambda text: None,
) -> Simplified:
    """Collapse edges of a grid's surface until the goal is met, or nothing more may collapse.

    feature   (V,) vertices that stay where they are, and never collapse with one another
    Promises  closed, manifold, bodies, cavities and genus as before, no two faces cut each other, no error beyond the
              tolerance found.
    Raises    Refusal when cuts or errors remain after several rounds.
    """
    vertices, faces = surface.vertices, surface.face_vertices
    feature = np.zeros(len(vertices), dtype=bool) if feature is None else feature
    locked = np.zeros(len(vertices), dtype=bool)
    twin = opposite_halfedges(vertices, faces, "surface of the grid")
    look = surface.lookup(proportions)
    quadric = vertex_quadrics(vertices, faces, regulariser=REGULARISER)
    tree = None
    for number in range(ROUNDS):
        mesh = collapse_mesh(vertices, faces, twin, quadric=quadric.copy(), locked=locked, feature=feature)
        bound = no_bound() if goal.tolerance is None else face_bound(vertices, faces, inner_limit(goal.tolerance))
        collapse_edges(mesh, edge_heap(len(mesh.half)), bound, look, len(faces), goal.n_faces)
        doing("verifying the error")
        places, rows = _living(mesh.place, mesh.corner)
        errors, bad = _verified((places, rows), surface, look, goal.tolerance)
        if not len(bad):
            kept = int((feature & mesh.feature & (mesh.out >= 0)).sum())
            return Simplified(places, rows, errors, kept, number + 1)
        doing(f"collapsing again around {len(bad)} places")
        tree = tree or cKDTree(vertices)
        for near in tree.query_ball_point(bad, REACH * 2**number):
            locked[near] = True
    raise Refusal(f"after {ROUNDS} rounds {len(bad)} places still break the bound; allow a larger --tolerance.")


def collapsed_between(
    surface: GridSurface, place: Floats, proportions: Floats, *, free: Bools, tolerance: float
) -> tuple[Floats, Ints, Ints]:
    """Fewer of the free triangles (F,) of a grid's surface whose vertices have slid to `place` (V, 3), in voxels.

    tolerance  largest distance from the slid surface
    Promises   all other triangles and their vertices stay; free ones cut no free ones; the grid edges of free vertices
               are crossed as before.
    Returns    places (V, 3) of all vertices by their old numbers, the free triangles (T, 3) that are left, and which
               of the old triangles each of them was
    Raises     Refusal when cuts or errors remain after several rounds.
    """
    faces = surface.face_vertices
    slid = replace(surface, vertices=place)
    twin = opposite_halfedges(place, faces, "surface of the grid")
    locked = np.zeros(len(place), dtype=bool)
    locked[faces[~free]] = True
    if not free.any():
        return place, faces[free], np.flatnonzero(free)
    guard, look = _guard(surface, proportions, locked), slid.lookup(proportions)
    quadric = vertex_quadrics(place, faces, regulariser=REGULARISER)
    tree = cKDTree(place)
    for number in range(ROUNDS):
        mesh = collapse_mesh(place, faces, twin, quadric=quadric.copy(), locked=locked, feature=np.zeros_like(locked))
        bound = face_bound(place, faces, inner_limit(tolerance), guard=guard)
        collapse_edges(mesh, edge_heap(len(mesh.half)), bound, look, len(faces), 4)
        left = np.flatnonzero(free & (mesh.corner[::3] >= 0))
        rows = mesh.corner.reshape(-1, 3)[left].astype(np.int64)
        _, bad = crossing_triangles(*used_rows(mesh.place, rows))
        if not len(bad):
            return mesh.place, rows, left
        for near in tree.query_ball_point(bad, REACH * 2**number):
            locked[near] = True
    raise Refusal(f"after {ROUNDS} rounds {len(bad)} places between the true faces still cut each other.")


def _guard(surface: GridSurface, proportions: Floats, without: Bools) -> Floats:
    """(V, 3) axis of every vertex's grid edge, -1 for some, and where along it both centres are."""
    axis = surface.edge_axis
    low = surface.edge_voxel[np.arange(len(axis)), axis] * proportions[axis]
    return np.column_stack([np.where(without, -1.0, axis), low, low + proportions[axis]])


def used_rows(place: Floats, rows: Ints) -> tuple[Floats, Ints]:
    """Some triangles of a mesh with the places that they use alone, in the old order."""
    used, numbers = np.unique(rows, return_inverse=True)
    return place[used], numbers.reshape(-1, 3)


def inner_limit(tolerance: float) -> float:
    """The bound that is kept while edges collapse."""
    return max(tolerance - MARGIN, 0.5 * tolerance)


def _living(place: Floats, corner: NDArray[np.int32]) -> tuple[Floats, Ints]:
    rows = corner.reshape(-1, 3)
    used, numbers = np.unique(rows[rows[:, 0] >= 0], return_inverse=True)
    return place[used], numbers.reshape(-1, 3).astype(np.int64)


def _verified(
    one: tuple[Floats, Ints], surface: GridSurface, look: CellLookup, tolerance: float | None
) -> tuple[Floats, Floats]:
    """Distances of points spread over both surfaces, and the places where a promise is broken."""
    _, cuts = crossing_triangles(*one)
    n = FEW_PROBES if tolerance is None else PROBES
    there = sample_surface(surface.vertices, surface.face_vertices, 2 * n)
    back = np.concatenate([sample_surface(*one, n), one[0]])
    errors = np.concatenate([closest_points(there, *one).distances, surface_distances(look, back)])
    if tolerance is None:
        return errors, cuts
    beyond = np.concatenate([there, back])[errors > tolerance]
    return errors, np.concatenate([cuts, beyond])
