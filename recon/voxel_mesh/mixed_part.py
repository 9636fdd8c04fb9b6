"""A grid's surface as true faces where the voxels bear them out, and as triangles elsewhere, with common edges.

sheets -> patches -> borders -> free triangles collapsed between the borders -> faces with their loops

Where a border finds no place, the triangles around are freed and the patches are made again.
All lengths in voxels but for the result, which is in model units.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from recon.errors import NoSolid
from recon.geometry.analytic import Plane
from recon.geometry.mixed import MixedBoundary, MixedEdge, MixedFace
from recon.geometry.voxel_grid import VoxelGrid
from recon.numerics.closed_mesh import nested_shells, opposite_halfedges
from recon.numerics.coplanar import region_loops
from recon.numerics.halfedges import connected_components
from recon.numerics.self_intersection import crossing_triangles
from recon.voxel_mesh.borders import Chain, Placed, conditions, placed_vertices, walked_curve
from recon.voxel_mesh.marching_cubes import GridSurface
from recon.voxel_mesh.patches import FREE, Patches, sheet_patches
from recon.voxel_mesh.settled_surfaces import Ends
from recon.voxel_mesh.sheets import DEEP, Sheet
from recon.voxel_mesh.simplify import collapsed_between, used_rows

__all__ = ["MixedPart", "mixed_boundary"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Side = tuple[int, int]  # from a vertex to a vertex
Use = tuple[int, bool]  # number of an edge, and whether it runs as it is used

TRIES = 8
CHORD = 0.01  # voxels that the middle of a straight edge may lie off its sheet


@dataclass(frozen=True, eq=False)
class MixedPart:
    """What a mixed boundary is made from: the grid's surface, smoothed, its sheets, and the voxels beside it."""

    grid: VoxelGrid
    surface: GridSurface
    smooth: Floats
    sheets: tuple[Sheet, ...]
    ends: Ends

    def without(self, refused: Sequence[int]) -> "MixedPart":
        """The part with some of its sheets left to triangles, and the roundings along them."""
        gone = set(refused)
        gone |= {k for k, sheet in enumerate(self.sheets) if any(t.other in gone for t in sheet.touches)}
        kept = [k for k in range(len(self.sheets)) if k not in gone]
        return MixedPart(
            self.grid,
            self.surface,
            self.smooth,
            tuple(self.sheets[k].renumbered({k: n for n, k in enumerate(kept)}) for k in kept),
            self.ends,
        )


def mixed_boundary(
    part: MixedPart, tolerance: float, *, doing: Callable[[str], None] = lambda text: None
) -> MixedBoundary:
    """Faces on the sheets of a part and triangles between them.

    tolerance  voxels that triangles may lie off the smoothed surface
    Promises   closed; straight edges no more than CHORD off the sheets beside them.
    Raises     NoSolid when borders find no place after all tries.
    """
    faces = part.surface.face_vertices
    twin = opposite_halfedges(part.surface.vertices, faces, "surface of the grid")
    doing("parting the surface into patches")
    patches, placed, curves = _settled(part, faces, twin)
    doing("collapsing edges between the true faces")
    free = patches.sheet == FREE
    is_free = np.zeros(len(part.smooth), dtype=bool)
    is_free[faces[free]] = True
    slid = np.where(is_free[:, None], placed.place, part.smooth)
    slid, *triangles = collapsed_between(part.surface, slid, part.grid.proportions, free=free, tolerance=tolerance)
    place = np.where(is_free[:, None], slid, placed.place)
    return _joined(_Pieces(part, faces, twin, patches, placed.chains, curves, place, *triangles))


def _settled(part: MixedPart, faces: Ints, twin: Ints) -> tuple[Patches, Placed, dict[int, Floats]]:
    """Patches whose borders have a place, and the curves of the chains between two sheets, by number of the chain."""
    freed: Bools | None = None
    for _ in range(TRIES):
        patches = sheet_patches(faces, twin, part.sheets, part.ends, freed=freed)
        placed = placed_vertices(faces, twin, patches, sheets=part.sheets, ends=part.ends, smooth=part.smooth)
        curves, lost = _curves(part, patches, placed)
        bad = np.unique(np.concatenate([placed.bad, *lost, _cutting(placed.place, faces[patches.sheet == FREE])]))
        if not len(bad):
            return patches, placed, curves
        more = np.zeros(len(part.smooth), dtype=bool)
        more[bad] = True
        more[faces[more[faces].any(axis=1)]] = True
        freed = more if freed is None else freed | more
    raise NoSolid("borders between the surfaces that were recognised found no place")


def _cutting(place: Floats, rows: Ints) -> Ints:
    """Corners (n,) of triangles that cut each other."""
    pairs, _ = crossing_triangles(*used_rows(place, rows))
    return np.unique(rows[pairs.ravel()])


def _curves(part: MixedPart, patches: Patches, placed: Placed) -> tuple[dict[int, Floats], list[Ints]]:
    """Curves of chains between two sheets, and the vertices of the chains that have none."""
    curves: dict[int, Floats] = {}
    lost: list[Ints] = []
    bad = np.zeros(len(part.smooth), dtype=bool)
    bad[placed.bad] = True
    for number, chain in enumerate(placed.chains):
        pair = patches.owner[[chain.left, chain.right]]
        if FREE in pair or bad[chain.vertices].any():
            continue
        along = placed.place[chain.vertices]
        meet = conditions(pair.tolist(), part.sheets, along.mean(axis=0) if len(along) < 3 else along[len(along) // 2])
        points = walked_curve(along[0], None if chain.is_ring else along[-1], along, meet) if len(meet) == 2 else None
        if points is None:
            lost.append(chain.vertices)
        else:
            curves[number] = points
    return curves, lost


@dataclass(frozen=True, eq=False)
class _Pieces:
    """What edges and faces are made of: chains between sheets are one edge, all other sides of triangles one each.

    faces, twin  the grid's triangles and their opposite half-edges
    curves       of the chains between two sheets, by number of the chain
    place        (V, 3) where the vertices have settled
    rows, left   the free triangles that are left, as vertices and as numbers among `faces`
    """

    part: MixedPart
    faces: Ints
    twin: Ints
    patches: Patches
    chains: list[Chain]
    curves: dict[int, Floats]
    place: Floats
    rows: Ints
    left: Ints


def _joined(pieces: _Pieces) -> MixedBoundary:
    """All edges, numbered as the loops first use them, and all faces."""
    curved, on_chain = _chain_edges(pieces)
    split, places = _split_chords(pieces)
    loops = _sheet_loops(pieces, split, on_chain)
    triangles = _small_triangles(pieces, split)
    straight = [side for _, loop in loops for side in loop if side not in on_chain]
    straight += [side for trio, _ in triangles for side in _around(trio)]
    number = {ends: len(curved) + k for k, ends in enumerate(dict.fromkeys((min(s), max(s)) for s in straight))}
    uses = [(patch, _merged([on_chain.get(side) or _use(side, number) for side in loop])) for patch, loop in loops]
    faces = _sheet_faces(pieces, uses)
    for trio, patch in triangles:
        p, q, r = places[list(trio)]
        area = 0.5 * float(np.linalg.norm(np.cross(q - p, r - p))) * pieces.part.grid.voxel**2
        faces.append(MixedFace(None, 1.0, (tuple(_use(side, number) for side in _around(trio)),), area, patch))
    return _in_model_units(pieces, places, [*curved, *(MixedEdge(*ends) for ends in number)], faces)


def _chain_edges(pieces: _Pieces) -> tuple[list[MixedEdge], dict[Side, Use]]:
    """An edge for each chain with a curve, and of the sides of triangles on it the use."""
    edges: list[MixedEdge] = []
    on_chain: dict[Side, Use] = {}
    for edge, (number, points) in enumerate(pieces.curves.items()):
        v = pieces.chains[number].vertices.tolist()
        edges.append(MixedEdge(v[0], v[-1], points if len(points) > 2 else None))
        for a, b in pairwise(v):
            on_chain[a, b] = edge, True
            on_chain[b, a] = edge, False
    return edges, on_chain


def _split_chords(pieces: _Pieces) -> tuple[dict[Side, list[int]], Floats]:
    """Vertices between the ends of straight edges of curved sheets, from the lower to the higher number, so many that
    all are near enough to the sheets; and all places with those of the new ones.
    """
    sheets, owner = pieces.part.sheets, pieces.patches.owner
    split: dict[Side, list[int]] = {}
    places: list[Floats] = list(pieces.place)
    for number, chain in enumerate(pieces.chains):
        own = [k for k in owner[[chain.left, chain.right]].tolist() if k != FREE]
        if number in pieces.curves or not own or isinstance(sheets[own[0]].surface, Plane):
            continue
        for ends in pairwise(chain.vertices.tolist()):
            a, b = min(ends), max(ends)
            made, order = _halved(pieces.place[a], pieces.place[b], sheets[own[0]])
            split[a, b] = [len(places) + k for k in order]
            places += made
    return split, np.array(places)


def _halved(a: Floats, b: Floats, sheet: Sheet) -> tuple[list[Floats], list[int]]:
    """Places between two on a sheet, as far off it as these on average, and their numbers in the order from a to b."""
    ends = np.array([a, b])
    middle = ends.mean(axis=0)
    off = float(sheet.surface.distance(middle[None])[0] - sheet.surface.distance(ends).mean())
    if abs(off) <= CHORD:
        return [], []
    middle = middle - off * sheet.surface.normal(middle[None])[0]
    (before, first), (after, second) = _halved(a, middle, sheet), _halved(middle, b, sheet)
    order = [*(1 + k for k in first), 0, *(1 + len(before) + k for k in second)]
    return [middle, *before, *after], order


def _between(a: int, b: int, split: dict[Side, list[int]]) -> list[int]:
    """Vertices that split a side, from a to b."""
    found = split.get((min(a, b), max(a, b)), [])
    return found if a < b else found[::-1]


def _around(trio: tuple[int, int, int]) -> tuple[Side, Side, Side]:
    a, b, c = trio
    return (a, b), (b, c), (c, a)


def _use(side: Side, number: dict[Side, int]) -> Use:
    return number[min(side), max(side)], side[0] < side[1]


def _merged(uses: list[Use]) -> tuple[Use, ...]:
    """A loop with a row of uses of one edge as a single one."""
    kept = [use for k, use in enumerate(uses) if k == 0 or uses[k - 1] != use]
    return tuple(kept[:-1] if len(kept) > 1 and kept[0] == kept[-1] else kept)


def _sheet_loops(
    pieces: _Pieces, split: dict[Side, list[int]], on_chain: dict[Side, Use]
) -> list[tuple[int, list[Side]]]:
    """Borders of the patches on sheets, each with its patch, as sides that are split where they lie on no chain."""
    start, end = pieces.faces.ravel(), np.roll(pieces.faces, -1, axis=1).ravel()
    found = []
    for cycle in region_loops(pieces.twin, pieces.patches.patch):
        patch = int(pieces.patches.patch[cycle[0] // 3])
        if pieces.patches.owner[patch] != FREE:
            sides = zip(start[cycle].tolist(), end[cycle].tolist())
            rows = [[a, b] if (a, b) in on_chain else [a, *_between(a, b, split), b] for a, b in sides]
            found.append((patch, [side for row in rows for side in pairwise(row)]))
    return found


def _small_triangles(pieces: _Pieces, split: dict[Side, list[int]]) -> list[tuple[tuple[int, int, int], int]]:
    """The free triangles, each as those that the vertices on its sides part it into, with their patch."""
    found = []
    for (a, b, c), patch in zip(pieces.rows.tolist(), pieces.patches.patch[pieces.left].tolist()):
        sides = _between(a, b, split), _between(b, c, split), _between(c, a, split)
        found += [(trio, patch) for trio in _fan(a, b, c, sides)]
    return found


def _sheet_faces(pieces: _Pieces, uses: list[tuple[int, tuple[Use, ...]]]) -> list[MixedFace]:
    """One face a patch on a sheet, with its loops."""
    owner, corners = pieces.patches.owner, pieces.place[pieces.faces]
    loops: dict[int, list[tuple[Use, ...]]] = {}
    for patch, loop in uses:
        loops.setdefault(patch, []).append(loop)
    for patch in np.flatnonzero(owner != FREE).tolist():
        loops.setdefault(patch, [])  # a whole sphere has no border
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    areas = np.bincount(pieces.patches.patch, area) * pieces.part.grid.voxel**2
    return [
        MixedFace(int(k), pieces.part.sheets[k].outside, tuple(loops[patch]), float(areas[patch]), patch)
        for patch, k in zip(loops, owner[list(loops)])
    ]


def _in_model_units(
    pieces: _Pieces, places: Floats, edges: Sequence[MixedEdge], faces: Sequence[MixedFace]
) -> MixedBoundary:
    """With the vertices that are used, the bodies and their voids."""
    grid = pieces.part.grid
    used = np.unique(np.array([v for edge in edges for v in (edge.start, edge.end)], dtype=np.int64))
    number = np.full(len(places), -1)
    number[used] = np.arange(len(used))
    placed = (
        MixedEdge(int(number[e.start]), int(number[e.end]), None if e.points is None else grid.place(e.points))
        for e in edges
    )
    surfaces = tuple(s.surface.placed(grid.direction, grid.voxel, grid.origin) for s in pieces.part.sheets)
    slack = (CHORD + DEEP) * grid.voxel
    return MixedBoundary(grid.place(places[used]), surfaces, tuple(placed), tuple(faces), _bodies(pieces, faces), slack)


def _bodies(pieces: _Pieces, faces: Sequence[MixedFace]) -> tuple[tuple[tuple[int, ...], ...], ...]:
    """Numbers of the faces by body and shell."""
    shell = connected_components(pieces.faces)
    patch_shell = np.zeros(len(pieces.patches.owner), dtype=np.int64)
    patch_shell[pieces.patches.patch] = shell
    of_face = patch_shell[[face.patch for face in faces]]
    shells = nested_shells(pieces.part.surface.vertices[pieces.faces], shell)
    return tuple(tuple(tuple(np.flatnonzero(of_face == s).tolist()) for s in body) for body in shells)


def _fan(a: int, b: int, c: int, sides: tuple[list[int], list[int], list[int]]) -> list[tuple[int, int, int]]:
    """Triangles of a triangle with more vertices on its sides ab, bc, ca: one is halved after the other."""
    ab, bc, ca = sides
    if not ab and not bc and not ca:
        return [(a, b, c)]
    if not ab:
        return _fan(b, c, a, (bc, ca, ab))
    k = len(ab) // 2
    return [*_fan(a, ab[k], c, (ab[:k], [], ca)), *_fan(ab[k], b, c, (ab[k + 1 :], bc, []))]
