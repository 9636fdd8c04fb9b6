"""Scans thinned cell by cell: what must stay of them stays, and no cell leaves a trace."""

import numpy as np
import pytest

from recon.errors import NotManifold
from recon.geometric_fit.scan_cells import thinned_scan
from recon.geometry.mesh_source import MeshSource
from recon.numerics.closed_mesh import opposite_halfedges
from recon.numerics.halfedges import boundary_loops
from recon.numerics.self_intersection import crossing_triangles
from recon.readers.mesh_windows import open_mesh
from recon.voxel_mesh.topology import mesh_topology


def bumpy_torus(n: int) -> MeshSource:
    """2 n by n points on a torus with bumps."""
    u, v = np.meshgrid(2 * np.pi * np.arange(2 * n) / (2 * n), 2 * np.pi * np.arange(n) / n, indexing="ij")
    r = 30 + 1.5 * np.sin(5 * u) * np.sin(4 * v)
    points = np.stack([(70 + r * np.cos(v)) * np.cos(u), (70 + r * np.cos(v)) * np.sin(u), r * np.sin(v)], axis=-1)
    number = np.arange(2 * n * n).reshape(2 * n, n)
    right, up = np.roll(number, -1, axis=0), np.roll(number, -1, axis=1)
    both = np.roll(right, -1, axis=1)
    faces = np.concatenate([np.stack([number, right, both], axis=-1), np.stack([number, both, up], axis=-1)])
    return MeshSource.of(points.reshape(-1, 3), faces.reshape(-1, 3), "torus")


def sheet(n: int) -> MeshSource:
    """n by n points of a wave, open all around."""
    x, y = np.meshgrid(np.arange(float(n)), np.arange(float(n)), indexing="ij")
    number = np.arange(n * n).reshape(n, n)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).reshape(-1, 3)
    return MeshSource.of(np.stack([x, y, 2.0 * np.sin(0.2 * x)], axis=-1).reshape(-1, 3), faces, "sheet")


def test_a_thinned_scan_is_closed_has_its_handle_and_lies_near_the_scan():
    scan = bumpy_torus(100)
    found = thinned_scan(scan, 1000, cell=2_000)
    vertices, faces = found.mesh.vertices, found.mesh.face_vertices
    opposite_halfedges(vertices, faces)
    assert len(vertices) == pytest.approx(1000, rel=0.1)
    assert tuple(mesh_topology(vertices, faces)) == (1, 0, 1)
    assert len(crossing_triangles(vertices, faces)[0]) == 0
    assert found.mesh.volume() == pytest.approx(1.2437e6, rel=0.005)
    assert len(found.distances) == scan.n_vertices
    assert found.distances.max() < 1.5 and np.sqrt((found.distances**2).mean()) < 0.3


def test_cells_cost_no_precision_against_the_whole_at_once():
    rms = [
        np.sqrt((thinned_scan(bumpy_torus(100), 1000, cell=cell).distances ** 2).mean()) for cell in (2_000, 100_000)
    ]
    assert rms[0] < 1.2 * rms[1]


def test_the_order_of_the_cells_changes_no_byte():
    def backwards(function, items):
        return [function(item) for item in reversed(list(items))][::-1]

    one, other = (thinned_scan(bumpy_torus(60), 500, cell=1_000, each=each) for each in (map, backwards))
    assert one.mesh.vertices.tobytes() == other.mesh.vertices.tobytes()
    assert one.mesh.face_vertices.tobytes() == other.mesh.face_vertices.tobytes()


def stored(path, scan):
    """The scan in binary files, its points numbered in the order in which the triangles name them."""
    faces = scan.triangles(slice(None))
    first, rows = np.unique(faces, return_index=True)
    number = np.empty(len(first), dtype=np.int64)
    number[first[np.argsort(rows)]] = np.arange(len(first))
    points, faces = scan.points(first[np.argsort(rows)]).astype("<f4"), number[faces]
    table = np.zeros(len(faces), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    table["count"], table["corners"] = 3, faces
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    counts = f"element vertex {len(points)}\n{axes}element face {len(faces)}\nproperty list uchar int vertex_indices\n"
    head = f"ply\nformat binary_little_endian 1.0\n{counts}end_header\n"
    (path / "scan.ply").write_bytes(head.encode() + points.tobytes() + table.tobytes())
    loose = np.zeros(len(faces), np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]))
    loose["corners"] = points[faces]
    (path / "scan.stl").write_bytes(bytes(80) + np.uint32(len(faces)).tobytes() + loose.tobytes())
    return path / "scan.ply", path / "scan.stl"


@pytest.mark.parametrize("scan", [bumpy_torus(60), sheet(50)], ids=["torus", "sheet"])
def test_a_scan_without_numbers_for_its_points_is_thinned_to_the_same_bytes(scan, tmp_path):
    found = [thinned_scan(open_mesh(path, least=1), 700, cell=1_000) for path in stored(tmp_path, scan)]
    for name in ("vertices", "face_vertices"):
        one, other = (getattr(each.mesh, name) for each in found)
        assert one.tobytes() == other.tobytes()
    assert found[0].distances.tobytes() == found[1].distances.tobytes()


def test_the_border_of_an_open_scan_stays_as_it_was():
    scan = sheet(60)
    mesh = thinned_scan(scan, 900, cell=800).mesh
    (before,), (after,) = boundary_loops(scan.triangles(slice(None))), boundary_loops(mesh.face_vertices)
    points = scan.points(slice(None))
    assert sorted(points[before].tolist()) == sorted(mesh.vertices[after].tolist())
    assert mesh.n_vertices < 0.4 * scan.n_vertices


def test_a_vertex_where_two_surfaces_touch_stays_where_it_is():
    scan = bumpy_torus(40)
    points, faces = scan.points(slice(None)), scan.triangles(slice(None))
    high = int(points[:, 0].argmax())
    mirrored = points * [-1.0, 1.0, 1.0] + [2.0 * points[high, 0], 0.0, 0.0]
    other = np.where(faces == high, -1, faces)[:, ::-1] + len(points)
    together = np.concatenate([faces, np.where(other == len(points) - 1, high, other)])
    mesh = thinned_scan(MeshSource.of(np.concatenate([points, mirrored]), together, "two"), 800, cell=1_000).mesh
    at = np.flatnonzero((np.abs(mesh.vertices - points[high]) < 1e-12).all(axis=1))
    assert len(at) == 1
    around = mesh.vertices[mesh.face_vertices[(mesh.face_vertices == at[0]).any(axis=1)]].mean(axis=1)
    assert (around[:, 0] < points[high, 0]).any() and (around[:, 0] > points[high, 0]).any()


def test_an_edge_that_belongs_to_no_surface_is_named():
    points, faces = bumpy_torus(20).points(slice(None)), bumpy_torus(20).triangles(slice(None)).copy()
    faces[5] = faces[5][::-1]
    with pytest.raises(NotManifold, match="same direction"):
        thinned_scan(MeshSource.of(points, faces, "torus"), 300)
