"""Edge collapse of a part of a grid's surface, its border locked, within the same bound as the whole.

    first    the surface as it comes from a block of the grid: its border lies on the planes of the block
    later    a part of the joined surface within a block of another lattice: what reaches out of the block is locked

Beside the part itself a window of the grid is all that is needed.  The points at which the error is verified belong to
the grid's triangles, not to blocks: what one pass has verified holds for the next where nothing changed.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import Refusal
from recon.geometry.volume_source import SolidSource
from recon.numerics.cell_lookup import CellLookup, surface_distances
from recon.numerics.distance import TriangleTree, closest_points, sample_surface
from recon.numerics.edge_collapse import REGULARISER, CollapseMesh, collapse_edges, collapse_mesh
from recon.numerics.edge_heap import edge_heap
from recon.numerics.error_bound import TESTED, Bound, hanging_bound, no_bound
from recon.numerics.open_patch import ClosedOff, closed_off
from recon.numerics.quadrics import vertex_quadrics
from recon.numerics.self_intersection import crossing_triangles
from recon.voxel_mesh.block_lattice import Lattice, Place
from recon.voxel_mesh.marching_cubes import GridSurface, window_surface
from recon.voxel_mesh.simplify import REACH, ROUNDS, inner_limit

__all__ = ["Collapsed", "Patch", "Terms", "block_errors", "collapse_block", "collapse_patch", "first_patch"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

TOLD = 8  # points whose error is measured, for one that is told: all of them would fill the memory
SPREAD = np.array([3 << 40, 3 << 20, 3])  # numbers grid edges one by one, up to a million voxels along an axis


@dataclass(frozen=True)
class Terms:
    """When a pass stops.

    tolerance  as of a Goal
    remain     share of the grid's triangles that are few enough; 0 as far as the tolerance goes
    longest    voxels, longest side that a face may get: what is shorter fits between the planes of the next lattice
    """

    tolerance: float | None
    remain: float
    longest: float

    @property
    def margin(self) -> int:
        """Voxels around a block in which the grid's surface is looked at, too."""
        return 2 + int(np.ceil(self.tolerance or 0.0))


@dataclass(frozen=True, eq=False)
class Patch:
    """A part of a surface, in voxels, and what lies around it.

    vertices  (V, 3)                      quadrics  (V, 10)
    faces     (F, 3) the first `n_own` may change, the others lie around them
    locked    (V,) vertices that stay     n_here    faces that lie in the block, whether they may change or not
    """

    vertices: Floats
    quadrics: Floats
    faces: Ints
    n_own: int
    locked: Bools
    n_here: int


@dataclass(frozen=True, eq=False)
class Collapsed:
    """What became of a patch: places and quadrics of its vertices, and its own faces (G, 3) that are left.

    keys  (V,) of a first patch: the grid edge of a vertex on the border, -1 within
    """

    vertices: Floats
    quadrics: Floats
    faces: Ints
    keys: Ints = field(default_factory=lambda: np.empty(0, dtype=np.int64))


def first_patch(surface: GridSurface) -> Patch:
    """All of the surface within a block."""
    faces = surface.face_vertices
    quadrics = vertex_quadrics(surface.vertices, faces, regulariser=REGULARISER)
    return Patch(surface.vertices, quadrics, faces, len(faces), np.zeros(len(quadrics), dtype=bool), len(faces))


def collapse_block(solid: SolidSource, lattice: Lattice, terms: Terms, block: Place, kept: Floats) -> Collapsed:
    """The first pass: march a block and collapse within it; kept (n, 3) places around which nothing changes."""
    low, stop = lattice.extent(block)
    surface = window_surface(solid.window(low, stop + 1), low, solid.proportions)
    if not len(surface.face_vertices):
        return Collapsed(surface.vertices, np.empty((0, 10)), surface.face_vertices)
    patch = first_patch(surface)
    home = np.empty(len(surface.vertices), dtype=np.int64)
    home[patch.faces.ravel()] = np.repeat(np.arange(patch.n_own), 3)
    samples = _Samples(_sample_places(surface), np.append(np.arange(patch.n_own), home), 0.0)
    found = _collapsed(patch, samples, _Reference(surface, solid.proportions), terms, kept)
    inside = found.faces.ravel()
    keys = np.full(len(surface.vertices), -1, dtype=np.int64)
    border = closed_off(patch.faces, len(keys)).border
    number = np.ravel_multi_index(tuple((surface.edge_voxel[border] + 1).T), np.add(solid.shape, 2))
    keys[border] = 3 * number + surface.edge_axis[border]
    used, rows = np.unique(inside, return_inverse=True)
    return Collapsed(found.vertices[used], found.quadrics[used], rows.reshape(-1, 3), keys[used])


def collapse_patch(
    solid: SolidSource, lattice: Lattice, terms: Terms, block: Place, patch: Patch, kept: Floats
) -> Collapsed:
    """A later pass: collapse what was joined, within a block of another lattice."""
    if not patch.n_own:
        return Collapsed(patch.vertices, patch.quadrics, patch.faces[:0])
    reference = _window_reference(solid, lattice, terms, block)
    places = _sample_places(reference.surface)
    home = TriangleTree(patch.vertices, patch.faces).closest(places).faces
    mine = home < patch.n_own
    return _collapsed(patch, _Samples(places[mine], home[mine], TESTED), reference, terms, kept)


def block_errors(solid: SolidSource, lattice: Lattice, terms: Terms, block: Place, patch: Patch) -> Floats:
    """Distances, both ways, between the grid's surface and the faces of a patch, of points in the block: of one point
    in TOLD, and the largest of all.
    """
    reference = _window_reference(solid, lattice, terms, block)
    if not reference.own.any():
        return np.empty(0)
    there = _probes(reference.surface, reference.own)
    low, stop = (end * solid.proportions for end in lattice.extent(block))
    back = sample_surface(patch.vertices, patch.faces, len(there))
    back = back[((back >= low) & (back < stop)).all(axis=1)]
    off = closest_points(there, patch.vertices, patch.faces).distances
    found = np.concatenate([off, surface_distances(reference.look, back)])
    return np.append(found[::TOLD], found.max())


@dataclass(frozen=True, eq=False)
class _Samples:
    """Places (S, 3) on the grid's surface, the face of the patch on which each hangs, and how far at most the faces
    are from that surface, as a share of the limit.
    """

    places: Floats
    home: Ints
    reach: float


class _Reference:
    """The grid's surface that a patch is held to; own (F,) its triangles in the block itself."""

    def __init__(self, surface: GridSurface, proportions: Floats, own: Bools | None = None) -> None:
        self.surface = surface
        self.own = np.ones(len(surface.face_vertices), dtype=bool) if own is None else own
        self._proportions = proportions

    @property
    def look(self) -> CellLookup:
        return self.surface.lookup(self._proportions)


def _window_reference(solid: SolidSource, lattice: Lattice, terms: Terms, block: Place) -> _Reference:
    """The surface in a block, and around it as far as a patch may reach out."""
    low, stop = lattice.extent(block)
    inside = solid.window(low - terms.margin, stop + 1 + terms.margin)
    surface = window_surface(inside, low - terms.margin, solid.proportions)
    cells = surface.face_cells()
    own = np.asarray(((cells >= low) & (cells < stop)).all(axis=1))
    return _Reference(surface, solid.proportions, own)


def _sample_places(surface: GridSurface) -> Floats:
    """As of `face_bound`: the middle of every face, and every vertex."""
    return np.concatenate([surface.vertices[surface.face_vertices].mean(axis=1), surface.vertices])


def _probes(surface: GridSurface, own: Bools) -> Floats:
    """The points farthest from all samples: the middle of every side of the grid's triangles, once whatever the block.

    Of the two triangles at a side the one has it that runs along it towards the larger number.
    """
    number = surface.edge_voxel @ SPREAD + surface.edge_axis
    start = surface.face_vertices[own].ravel()
    end = np.roll(surface.face_vertices[own], -1, axis=1).ravel()
    once = number[start] < number[end]
    return 0.5 * (surface.vertices[start[once]] + surface.vertices[end[once]])


def _collapsed(patch: Patch, samples: _Samples, reference: _Reference, terms: Terms, kept: Floats) -> Collapsed:
    """Collapse, verify, lock what is around places that fail, and all again, as `simplify.simplified`."""
    closed = closed_off(patch.faces[: patch.n_own], len(patch.vertices))
    locked = patch.locked | closed.border
    tree = cKDTree(patch.vertices)
    _lock_near(locked, tree, kept, REACH)
    probes, look = _probes(reference.surface, np.ones_like(reference.own)), reference.look
    n_left = max(0, round(terms.remain * int(reference.own.sum())) - (patch.n_here - patch.n_own))
    for number in range(ROUNDS):
        mesh = _mesh(patch, closed, locked, terms.longest)
        bound = _bound(samples, patch.n_own, len(closed.faces), terms.tolerance)
        n_imaginary = len(closed.faces) - patch.n_own
        collapse_edges(mesh, edge_heap(len(mesh.half)), bound, look, len(closed.faces), n_left + n_imaginary)
        rows = mesh.corner.reshape(-1, 3)[: patch.n_own].astype(np.int64)
        rows = rows[rows[:, 0] >= 0]
        bad = _broken(mesh.place[:-1], (rows, patch.faces[patch.n_own :]), probes, terms.tolerance)
        if not len(bad):
            return Collapsed(mesh.place[:-1], mesh.quadric[:-1], rows)
        _lock_near(locked, tree, bad, REACH * 2**number)
    raise Refusal(f"after {ROUNDS} rounds {len(bad)} places still break the bound; allow a larger --tolerance.")


def _lock_near(locked: Bools, tree: cKDTree, places: Floats, reach: float) -> None:
    for near in tree.query_ball_point(places, reach) if len(places) else ():
        locked[near] = True


def _mesh(patch: Patch, closed: ClosedOff, locked: Bools, longest: float) -> CollapseMesh:
    """With the imaginary vertex at the end, which lies nowhere: so no fold is ever seen across the border."""
    return collapse_mesh(
        np.append(patch.vertices, np.full((1, 3), np.nan), axis=0),
        closed.faces,
        closed.twin,
        quadric=np.append(patch.quadrics, np.zeros((1, 10)), axis=0),
        locked=np.append(locked, True),
        feature=np.zeros(len(locked) + 1, dtype=bool),
        longest=longest,
    )


def _bound(samples: _Samples, n_own: int, n_faces: int, tolerance: float | None) -> Bound:
    if tolerance is None:
        return no_bound()
    limit = inner_limit(tolerance)
    return hanging_bound(samples.places, samples.home, n_faces, limit, reach=samples.reach * limit)


def _broken(places: Floats, faces: tuple[Ints, Ints], probes: Floats, tolerance: float | None) -> Floats:
    """(n, 3) places where faces cut each other, or the grid's surface lies farther away than allowed."""
    together = np.concatenate(faces)
    cuts = crossing_triangles(places, together)[1]
    if tolerance is None or not len(together):
        return cuts
    off = closest_points(probes, places, together).distances
    return np.concatenate([cuts, probes[off > tolerance]])
