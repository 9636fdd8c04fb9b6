"""Voxels to boundaries: error and time beside other programs.

python benchmarks/voxel_mesh.py [GRID ...] [--half]
python benchmarks/voxel_mesh.py --picture FILE.png

The picture sets the bounded collapse beside plain quadrics (--fast, fast-simplification) at the same count of faces.

Grids: those beside the checkout where they are, else parts made here; --half takes every second voxel.  Errors are in
voxels, symmetric over 100,000 samples and all vertices, against the marching cubes surface.  Seconds are processor time
after a warm-up.
"""

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from recon.errors import ReconError
from recon.geometry.voxel_grid import VoxelGrid, binary_grid
from recon.numerics.distance import TriangleTree, sample_surface
from recon.numerics.self_intersection import crossing_triangles
from recon.readers.volumes import read_volume
from recon.voxel_mesh.marching_cubes import GridSurface, marching_cubes
from recon.voxel_mesh.simplify import Goal, simplified
from recon.voxel_mesh.topology import mesh_topology
from tables import Table, machine

GRIDS = Path(__file__).parents[2] / "shared" / "data" / "voxels"
SHARES = {"curved": (0.9, 0.95), "bracket_turned": (0.95,), "bottle": (0.95, 0.98), "bracket": (0.98, 0.99)}
TOLERANCE = 0.55
SAMPLES = 100_000

Mesh = tuple[np.ndarray, np.ndarray]
Method = Callable[[GridSurface, VoxelGrid, int], Mesh]


def ours(surface: GridSurface, grid: VoxelGrid, n: int) -> Mesh:
    less = simplified(surface, grid.proportions, Goal(n, TOLERANCE))
    return less.vertices, less.face_vertices


def ours_fast(surface: GridSurface, grid: VoxelGrid, n: int) -> Mesh:
    less = simplified(surface, grid.proportions, Goal(n, None))
    return less.vertices, less.face_vertices


def fast_simplification(surface: GridSurface, grid: VoxelGrid, n: int) -> Mesh:
    import fast_simplification as peer

    points, faces = peer.simplify(
        surface.vertices.astype(np.float32), surface.face_vertices.astype(np.int32), target_count=n
    )
    return points.astype(np.float64), faces.astype(np.int64)


def vtk_quadric(surface: GridSurface, grid: VoxelGrid, n: int) -> Mesh:
    import pyvista

    mesh = pyvista.PolyData.from_regular_faces(surface.vertices, surface.face_vertices)
    less = mesh.decimate(1.0 - n / len(surface.face_vertices))
    return np.asarray(less.points, dtype=np.float64), less.regular_faces.astype(np.int64)


def pymeshlab_quadric(surface: GridSurface, grid: VoxelGrid, n: int) -> Mesh:
    import pymeshlab

    session = pymeshlab.MeshSet()
    session.add_mesh(pymeshlab.Mesh(surface.vertices, surface.face_vertices.astype(np.int32)))
    session.meshing_decimation_quadric_edge_collapse(targetfacenum=n, preservetopology=True)
    mesh = session.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix().astype(np.int64)


METHODS: dict[str, Method] = {
    "ours": ours,
    "ours, --fast": ours_fast,
    "fast-simplification": fast_simplification,
    "VTK": vtk_quadric,
    "pymeshlab": pymeshlab_quadric,
}


def cases(names: list[str], step: int) -> Iterator[tuple[str, VoxelGrid, tuple[float, ...]]]:
    found = [name for name in SHARES if (GRIDS / f"{name}.npz").exists() and (not names or name in names)]
    for name in found:
        grid = binary_grid(read_volume(GRIDS / f"{name}.npz"))
        solid = grid.solid[::step, ::step, ::step]
        yield name, VoxelGrid(grid.spacing * step, grid.origin, grid.direction, grid.name, solid), SHARES[name]
    if not found:
        yield "ball with a slot", ball_with_slot(96), (0.9, 0.95)


def ball_with_slot(n: int) -> VoxelGrid:
    x, y, z = np.meshgrid(*[np.arange(n) - 0.5 * n + 0.137] * 3, indexing="ij")
    ball = x**2 + y**2 + z**2 < (0.4 * n) ** 2
    return VoxelGrid(solid=ball & ~((np.abs(x + 0.3 * y) < 0.08 * n) & (z > 0)), name="ball with a slot")


def metro(one: Mesh, other: Mesh) -> float:
    """Largest distance of samples and vertices of either mesh from the other."""
    samples = [np.concatenate([sample_surface(*mesh, SAMPLES), mesh[0]]) for mesh in (one, other)]
    away = [TriangleTree(*mesh).closest(points).distances for mesh, points in zip((other, one), samples)]
    return float(max(away[0].max(), away[1].max()))


def row(surface: GridSurface, grid: VoxelGrid, n: int, method: Method) -> tuple[object, ...]:
    """Faces, error, cuts, whether the topology is the same, seconds; or what went wrong."""
    start = time.process_time()
    try:
        vertices, faces = method(surface, grid, n)
    except ImportError:
        return ("not installed",)
    except Exception as failure:  # noqa: BLE001 - a peer that breaks must not end the table
        return (f"failed: {failure}",)
    spent = time.process_time() - start
    error = metro((vertices, faces), (surface.vertices, surface.face_vertices))
    cuts = len(crossing_triangles(vertices, faces)[0])
    try:
        same = mesh_topology(vertices, faces) == mesh_topology(surface.vertices, surface.face_vertices)
    except ReconError:
        same = False
    return len(faces), error, cuts, "yes" if same else "no", spent


def picture(path: str) -> None:
    """Three results of the same count side by side, in flat colours and with their edges."""
    import pyvista

    grid = ball_with_slot(72)
    surface = marching_cubes(grid)
    n = round(0.05 * len(surface.face_vertices))
    plotter = pyvista.Plotter(off_screen=True, shape=(1, 3), window_size=(1500, 560), border=False)
    for k, title in enumerate(("ours", "ours, --fast", "fast-simplification")):
        mesh = METHODS[title](surface, grid, n)
        plotter.subplot(0, k)
        plotter.add_mesh(pyvista.PolyData.from_regular_faces(*mesh), color="#9db7d5", show_edges=True, line_width=0.5)
        error = metro(mesh, (surface.vertices, surface.face_vertices))
        plotter.add_text(
            f"{title}: {len(mesh[1]):,} triangles, {error:.2f} voxel off at most", font_size=9, color="black"
        )
        plotter.view_vector((1.0, -0.6, 1.2), viewup=(0.0, 0.0, 1.0))
        plotter.camera.zoom(1.5)
    plotter.screenshot(path)


def main() -> None:
    if "--picture" in sys.argv:
        picture(sys.argv[sys.argv.index("--picture") + 1])
        return
    step = 2 if "--half" in sys.argv else 1
    small = ball_with_slot(24)
    for method in (ours, ours_fast):
        method(marching_cubes(small), small, 200)
    print(f"{machine()}; processor time\n")
    table = Table(
        {"grid": "16", "method": "22", "share": "6.2f", "faces": "8,", "error": "8.3f", "cuts": "5,"}
        | {"same topology": "3", "seconds": "8.1f"}
    )
    for name, grid, shares in cases([a for a in sys.argv[1:] if not a.startswith("-")], step):
        surface = marching_cubes(grid)
        for share in shares:
            for title, method in METHODS.items():
                n = round((1.0 - share) * len(surface.face_vertices))
                table.row(name, title, share, *row(surface, grid, n, method))


if __name__ == "__main__":
    main()
