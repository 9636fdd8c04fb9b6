"""Planar faces between straight edges: what is read from arrays is what the kernel would have said."""

import numpy as np
import pytest
from kernel_shapes import box, compound
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepGProp import BRepGProp
from OCP.GProp import GProp_GProps
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS, TopoDS_Shape

from brep_export import measures, triangulation
from brep_export.check import check
from brep_export.check_geometry import edge_gaps
from brep_export.check_topology import sub_shapes
from brep_export.faceted_step import write_faceted_step
from brep_export.measures import measure
from brep_export.read_back import read_cad
from brep_export.solids import polyhedron_solid
from brep_export.survey import survey
from brep_export.triangulation import triangulate
from recon.geometry.mesh import TriangleMesh
from recon.geometry.polyhedron import Polyhedron, merge_coplanar
from recon.geometry.voxel_grid import VoxelGrid
from recon.tolerance import Tolerance
from recon.voxel_mesh.marching_cubes import marching_cubes


def carved_block() -> Polyhedron:
    """A block with a round void and a hole through it: triangles, large polygons, polygons with holes."""
    x, y, z = np.meshgrid(*[np.arange(18) - 8.5] * 3, indexing="ij")
    solid = (np.abs(x) < 8) & (np.abs(y) < 8) & (np.abs(z) < 8) & (x**2 + y**2 + z**2 > 12.0)
    solid &= (x - 5.5) ** 2 + y**2 > 2.0
    grid = VoxelGrid(np.full(3, 0.5), np.array([3.0, -20.0, 7.0]), np.eye(3), "block", solid)
    surface = marching_cubes(grid)
    return merge_coplanar(grid.placed(surface.vertices, surface.face_vertices), 1e-9)


@pytest.fixture(scope="module")
def block() -> tuple[Polyhedron, TopoDS_Shape]:
    polyhedron = carved_block()
    return polyhedron, polyhedron_solid(polyhedron)


def test_all_faces_of_a_polyhedron_are_flat_and_none_of_a_box_with_curves_on_its_faces(block):
    assert survey(block[1]).planes.all()
    assert not survey(box()).planes.flat.any()
    assert not survey(compound(block[1], box())).planes.all()


def test_volume_area_and_centre_are_those_of_the_kernel(block, monkeypatch):
    monkeypatch.setattr(measures, "SURVEYED_FROM", 1)
    of_volume, of_area = GProp_GProps(), GProp_GProps()
    BRepGProp.VolumeProperties_s(block[1], of_volume)
    BRepGProp.SurfaceProperties_s(block[1], of_area)
    found = measure(block[1])
    assert found.volume == pytest.approx(of_volume.Mass(), rel=1e-9)
    assert found.area == pytest.approx(of_area.Mass(), rel=1e-9)
    assert found.centroid == pytest.approx(of_volume.CentreOfMass().Coord(), rel=1e-9)
    assert np.ptp(np.array(found.bounding_box), axis=0) == pytest.approx([8.0] * 3)


def test_triangles_around_polygons_close_and_enclose_the_volume(block, monkeypatch):
    monkeypatch.setattr(triangulation, "SOUGHT_FROM", 1)
    planes = survey(block[1]).planes
    assert 10 < len(planes.triangles()[0]) < len(planes.flat)
    made = triangulate(block[1], 0.01, planes=planes)
    assert _closes(made.mesh) and not made.missing
    assert made.mesh.volume() == pytest.approx(measure(block[1]).volume, rel=1e-9)
    normals = made.mesh.area_vectors()
    along = np.einsum("ij,ij->i", normals, planes.normals[made.triangle_face])
    assert along == pytest.approx(np.linalg.norm(normals, axis=1))


def _closes(mesh: TriangleMesh) -> bool:
    a, b, c = mesh.face_vertices.T
    there = set(zip([*a, *b, *c], [*b, *c, *a]))
    return len(there) == 3 * mesh.n_faces and all((v, u) in there for u, v in there)


@pytest.mark.parametrize("many", [1, 10**6])
def test_a_vertex_off_its_edges_is_a_gap_as_before(many, monkeypatch):
    monkeypatch.setattr(triangulation, "SOUGHT_FROM", many)
    shape = polyhedron_solid(carved_block())
    vertex = TopoDS.Vertex_s(next(sub_shapes(shape, TopAbs_ShapeEnum.TopAbs_VERTEX)))
    moved = BRep_Tool.Pnt_s(vertex)
    moved.SetX(moved.X() + 0.01)
    BRep_Builder().UpdateVertex(vertex, moved, 1e-7)
    assert edge_gaps(survey(shape)).at_ends.max() == pytest.approx(0.01, rel=1e-6)
    assert "vertex-gap" in [defect.code for defect in check(shape, Tolerance()).defects]


def test_a_plane_off_its_edges_is_a_gap(block):
    planes = survey(block[1]).planes
    planes.offsets[0] += 0.02
    rows = np.flatnonzero(planes.uses.face == 0)
    assert planes.gaps_on_faces(rows) == pytest.approx(np.full(len(rows), 0.02))


def test_what_is_read_without_mending_is_sound(block, tmp_path):
    polyhedron, shape = block
    path = tmp_path / "block.step"
    assert write_faceted_step(polyhedron, path, measures=measure(shape)).same
    assert survey(read_cad(path, healed=False)).planes.all()
    assert check(read_cad(path, healed=False), Tolerance()).passed
    assert measure(read_cad(path)).volume == pytest.approx(measure(shape).volume, rel=1e-12)


@pytest.mark.parametrize("healed", [True, False])
def test_planes_that_meet_at_a_small_angle_pass_when_they_are_read_again(tmp_path, healed):
    """The kernel's reader calls edges smooth along which planes meet at less than a hundredth of a radian."""
    n = 12
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, n), np.linspace(-1.0, 1.0, n), indexing="ij")
    top = np.stack([x, y, 0.5 - 0.02 * (x**2 + y**2)], axis=-1).reshape(-1, 3)
    floor = top * [1.0, 1.0, 0.0]
    cell = np.array(
        [(i * n + j, i * n + n + j, i * n + n + j + 1, i * n + j + 1) for i in range(11) for j in range(11)]
    )
    up = np.concatenate([cell[:, [0, 1, 2]], cell[:, [0, 2, 3]]])
    sides = [(a, b) for a, b in {tuple(e) for t in up for e in ((t[0], t[1]), (t[1], t[2]), (t[2], t[0]))}]
    border = np.array([(a, b) for a, b in sides if (b, a) not in set(sides)])
    low = border + n * n
    walls = np.concatenate([np.c_[border[:, ::-1], low[:, 0]], np.c_[border[:, 1], low]])
    mesh = TriangleMesh(np.concatenate([top, floor]), np.concatenate([up, up[:, ::-1] + n * n, walls]))
    polyhedron = merge_coplanar(mesh, 1e-9)
    write_faceted_step(polyhedron, tmp_path / "roof.step", measures=measure(polyhedron_solid(polyhedron)))
    report = check(read_cad(tmp_path / "roof.step", healed=healed), Tolerance())
    assert report.passed, [str(defect) for defect in report.defects]
