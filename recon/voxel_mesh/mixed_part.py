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
    return _Assembly(part, faces, twin, patches, placed.chains, curves, place, *triangles).boundary()


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


@dataclass(eq=False)
class _Assembly:
    """Edges and faces, collected: chains between sheets are one edge, all other sides of triangles one each."""

    part: MixedPart
    faces: Ints
    twin: Ints
    patches: Patches
    chains: list[Chain]
    curves: dict[int, Floats]
    place: Floats
    rows: Ints
    left: Ints

    def boundary(self) -> MixedBoundary:
        self._edges: list[MixedEdge] = []
        self._numbers: dict[tuple[int, int], int] = {}
        self._places: list[Floats] = list(self.place)
        self._split: dict[tuple[int, int], list[int]] = {}
        self._mark_chains()
        self._split_chords()
        faces = [*self._true_faces(), *self._triangles()]
        return self._placed(faces)

    def _mark_chains(self) -> None:
        """Sides of the triangles that lie on a chain with a curve."""
        self._on_chain: dict[tuple[int, int], tuple[int, bool]] = {}
        for number, points in self.curves.items():
            v = self.chains[number].vertices
            edge = len(self._edges)
            self._edges.append(MixedEdge(int(v[0]), int(v[-1]), points if len(points) > 2 else None))
            for a, b in zip(v[:-1].tolist(), v[1:].tolist()):
                self._on_chain[a, b] = edge, True
                self._on_chain[b, a] = edge, False

    def _split_chords(self) -> None:
        """More vertices on the straight edges of curved sheets, until all are near enough to them."""
        owner = self.patches.owner
        for number, chain in enumerate(self.chains):
            own = [k for k in owner[[chain.left, chain.right]].tolist() if k != FREE]
            if number in self.curves or not own or isinstance(self.part.sheets[own[0]].surface, Plane):
                continue
            for a, b in zip(chain.vertices[:-1].tolist(), chain.vertices[1:].tolist()):
                self._split[min(a, b), max(a, b)] = self._halved(min(a, b), max(a, b), self.part.sheets[own[0]])

    def _halved(self, a: int, b: int, sheet: Sheet) -> list[int]:
        """Vertices between two on a sheet, as far off it as these on average."""
        ends = np.array([self._places[a], self._places[b]])
        middle = ends.mean(axis=0)
        off = float(sheet.surface.distance(middle[None])[0] - sheet.surface.distance(ends).mean())
        if abs(off) <= CHORD:
            return []
        self._places.append(middle - off * sheet.surface.normal(middle[None])[0])
        m = len(self._places) - 1
        return [*self._halved(a, m, sheet), m, *self._halved(m, b, sheet)]

    def _side(self, a: int, b: int) -> list[int]:
        """Vertices of a side from a up to, and without, b."""
        between = self._split.get((min(a, b), max(a, b)), [])
        return [a, *(between if a < b else between[::-1])]

    def _use(self, a: int, b: int) -> tuple[int, bool]:
        key = min(a, b), max(a, b)
        if key not in self._numbers:
            self._numbers[key] = len(self._edges)
            self._edges.append(MixedEdge(*key))
        return self._numbers[key], a < b

    def _true_faces(self) -> list[MixedFace]:
        """One face a patch on a sheet."""
        start, end = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        loops: dict[int, list[tuple[tuple[int, bool], ...]]] = {}
        for cycle in region_loops(self.twin, self.patches.patch):
            patch = int(self.patches.patch[cycle[0] // 3])
            if self.patches.owner[patch] != FREE:
                loops.setdefault(patch, []).append(self._loop(start[cycle].tolist(), end[cycle].tolist()))
        for patch in np.flatnonzero(self.patches.owner != FREE).tolist():
            loops.setdefault(patch, [])  # a whole sphere has no border
        corners = self.place[self.faces]
        area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        areas = np.bincount(self.patches.patch, area) * self.part.grid.voxel**2
        return [
            MixedFace(int(k), self.part.sheets[k].outside, tuple(loops[patch]), float(areas[patch]), patch)
            for patch, k in zip(loops, self.patches.owner[list(loops)])
        ]

    def _loop(self, start: list[int], end: list[int]) -> tuple[tuple[int, bool], ...]:
        uses: list[tuple[int, bool]] = []
        for a, b in zip(start, end):
            if (a, b) in self._on_chain:
                use = self._on_chain[a, b]
                if not uses or uses[-1] != use:
                    uses.append(use)
            else:
                row = [*self._side(a, b), b]
                uses += [self._use(p, q) for p, q in pairwise(row)]
        if len(uses) > 1 and uses[0] == uses[-1]:
            uses.pop()
        return tuple(uses)

    def _triangles(self) -> list[MixedFace]:
        found = []
        for (a, b, c), patch in zip(self.rows.tolist(), self.patches.patch[self.left].tolist()):
            for trio in _fan(a, b, c, (self._side(a, b)[1:], self._side(b, c)[1:], self._side(c, a)[1:])):
                p, q, r = (self._places[v] for v in trio)
                area = 0.5 * float(np.linalg.norm(np.cross(q - p, r - p))) * self.part.grid.voxel**2
                uses = tuple(self._use(x, y) for x, y in zip(trio, (*trio[1:], trio[0])))
                found.append(MixedFace(None, 1.0, (uses,), area, patch))
        return found

    def _placed(self, faces: list[MixedFace]) -> MixedBoundary:
        """In model units, with the vertices that are used, the bodies and their voids."""
        grid = self.part.grid
        used = np.unique([v for edge in self._edges for v in (edge.start, edge.end)])
        number = np.full(len(self._places), -1)
        number[used] = np.arange(len(used))
        edges = tuple(
            MixedEdge(
                int(number[e.start]),
                int(number[e.end]),
                None if e.points is None else grid.place(e.points),
            )
            for e in self._edges
        )
        surfaces = tuple(s.surface.placed(grid.direction, grid.voxel, grid.origin) for s in self.part.sheets)
        return MixedBoundary(
            grid.place(np.array(self._places)[used]),
            surfaces,
            edges,
            tuple(faces),
            self._bodies(faces),
            (CHORD + DEEP) * grid.voxel,
        )

    def _bodies(self, faces: list[MixedFace]) -> tuple[tuple[tuple[int, ...], ...], ...]:
        """Numbers of the faces by body and shell."""
        shell = connected_components(self.faces)
        patch_shell = np.zeros(len(self.patches.owner), dtype=np.int64)
        patch_shell[self.patches.patch] = shell
        of_face = patch_shell[[face.patch for face in faces]]
        shells = nested_shells(self.part.surface.vertices[self.faces], shell)
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
