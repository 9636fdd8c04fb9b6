"""What kind of surface a scan is, for a tensor-product surface has only three: disc, cylinder and torus.

    genus g, b borders       disc                    cylinder                 torus
                           .------.                 .--.  .--.               ______
    V - E + F              |  ()  |  one border     |  |  |  |  two          / ____ \\    none
      = 2 - 2 g - b        '------'  is the rim     '--'  '--'  are rims     \\______/

All other borders are holes: discs of triangles are laid over them, for the parameters alone or, where that was asked
for, for good.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from recon.errors import NoSurface
from recon.geometric_fit.hole_filling import fill_loops
from recon.geometry.mesh import TriangleMesh
from recon.numerics.halfedges import boundary_loops, connected_components, euler_number, opposite_sides

__all__ = ["ScanKind", "SheetScan", "sheet_scans"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

RIM = 0.4  # of the longest border, from where on the second longest may be the other rim of a cylinder
ADVICE = "fit it with --surface loop, or cut it into such parts"


class ScanKind(StrEnum):
    """What a scan can be unrolled to."""

    DISC = "disc"
    CYLINDER = "cylinder"
    TORUS = "torus"


@dataclass(frozen=True, eq=False)
class SheetScan:
    """A scan that can be unrolled.

    kind        what it is
    mesh        the scan with its holes laid over; its own vertices and faces come first
    origins     (n,) the vertex of the scan that each of those is: one of several where borders touched in it
    n_faces     of the scan itself
    rims        border of the disc, or both of the cylinder, as rows of vertices with the surface to the left
    holes       the other borders, likewise
    """

    kind: ScanKind
    mesh: TriangleMesh
    origins: Ints
    n_faces: int
    rims: tuple[Ints, ...]
    holes: tuple[Ints, ...]


def sheet_scans(scan: TriangleMesh) -> list[SheetScan]:
    """The scan as a disc, a cylinder or a torus; with two long borders as a cylinder first, and as a disc.

    Vertices that no face uses are left out. Where borders touch in a vertex, they are taken apart there: the vertex is
    there twice, in one place.
    Raises  NoSurface naming what it is instead, and what to do.
    """
    apart, origins = _taken_apart(scan)
    n_parts = int(connected_components(apart.face_vertices).max()) + 1
    if n_parts > 1:
        raise NoSurface(f"{scan.name} is in {n_parts} parts, and one B-spline surface covers one; fit each alone.")
    loops = sorted(boundary_loops(apart.face_vertices), key=lambda loop: -_length(apart.vertices, loop))
    return [_as_kind(kind, apart, origins, loops) for kind in _kinds(apart, loops)]


def _as_kind(kind: ScanKind, apart: TriangleMesh, origins: Ints, loops: list[Ints]) -> SheetScan:
    n_rims = {ScanKind.DISC: 1, ScanKind.CYLINDER: 2, ScanKind.TORUS: 0}[kind]
    rims, holes = loops[:n_rims], loops[n_rims:]
    return SheetScan(kind, fill_loops(apart, holes), origins, apart.n_faces, tuple(rims), tuple(holes))


def _taken_apart(scan: TriangleMesh) -> tuple[TriangleMesh, Ints]:
    """The scan with one vertex for every fan of faces, and the vertex that each was."""
    across = opposite_sides(scan.face_vertices)
    side, other = np.flatnonzero(across.ravel() >= 0), across[across >= 0]
    # the corner where a side starts is the one where the side across ends
    ends = 3 * (other // 3) + (other + 1) % 3
    links = sparse.coo_array((np.ones(len(side)), (side, ends)), shape=(across.size, across.size))
    number = csgraph.connected_components(links, directed=False)[1]
    fan, first = np.unique(number, return_index=True)
    origins = scan.face_vertices.ravel()[first]
    order = np.argsort(origins, kind="stable")
    rank = np.empty(len(fan), dtype=np.int64)
    rank[order] = np.arange(len(fan))
    faces = rank[number].reshape(-1, 3)
    return TriangleMesh(scan.vertices[origins[order]], faces, scan.name), origins[order]


def _kinds(scan: TriangleMesh, loops: list[Ints]) -> list[ScanKind]:
    genus = (2 - len(loops) - euler_number(scan.face_vertices)) // 2
    if genus == 1 and not loops:
        return [ScanKind.TORUS]
    if genus == 1:
        length = _length(scan.vertices, loops[0])
        if length < np.sqrt(np.linalg.norm(scan.area_vectors(), axis=1).sum()):
            return [ScanKind.TORUS]
    if genus > 0:
        handles = "one handle and a wide border" if genus == 1 else f"{genus} handles"
        raise NoSurface(f"{scan.name} has {handles}, where a B-spline surface is a disc, a tube or a torus; {ADVICE}.")
    if not loops:
        raise NoSurface(f"{scan.name} is closed as a sphere is, where a B-spline surface would have poles; {ADVICE}.")
    second = _length(scan.vertices, loops[1]) if len(loops) > 1 else 0.0
    two_rims = second > RIM * _length(scan.vertices, loops[0])
    return [ScanKind.CYLINDER, ScanKind.DISC] if two_rims else [ScanKind.DISC]


def _length(vertices: Floats, loop: Ints) -> float:
    row = vertices[loop]
    return float(np.linalg.norm(np.roll(row, -1, axis=0) - row, axis=1).sum())
