"""Solids of limit surfaces are what a designer can use: valid, smooth, cut and measured, the same after a file."""

from pathlib import Path

import numpy as np
import pytest
from hull_meshes import bumpy_ball
from OCP.BRepAlgoAPI import BRepAlgoAPI_Common, BRepAlgoAPI_Cut, BRepAlgoAPI_Section
from OCP.BRepOffsetAPI import BRepOffsetAPI_MakeOffsetShape
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCylinder
from OCP.gp import gp_Ax2, gp_Dir, gp_Pln, gp_Pnt
from OCP.TopAbs import TopAbs_ShapeEnum
from quad_meshes import creased, drum, grid, shaken, with_handles

from brep_export.check import ShapeKind, check
from brep_export.check_topology import sub_shapes
from brep_export.file_header import FileHeader
from brep_export.measures import measure
from brep_export.mosaics import mosaic_shape
from brep_export.step import write_step
from brep_export.triangulation import triangulate
from recon.errors import NotManifold
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.patches import PatchMosaic
from recon.numerics.halfedges import edge_table
from recon.subdivision.limit_faces import limit_faces
from recon.subdivision.limit_surface import Scheme, tessellate
from recon.tolerance import Tolerance

TOLERANCE = Tolerance(merge=1e-7, fit=1e-5)
SOLIDS = {
    "one handle": (Scheme.CATMULL_CLARK, shaken(with_handles(1), 0.05)),
    "drum": (Scheme.CATMULL_CLARK, drum(7, layers=4)),
    "creased drum": (Scheme.CATMULL_CLARK, creased(drum(5, layers=3), np.arange(10, 20))),
    "doo-sabin": (Scheme.DOO_SABIN, shaken(with_handles(1), 0.05)),
    "loop": (
        Scheme.LOOP,
        ControlMesh.from_faces(bumpy_ball(30).vertices, bumpy_ball(30).face_vertices),
    ),
}


def dense_volume(mesh, scheme):
    """Of the limit surface: tessellated twice, the error, which falls fourfold, taken out."""
    coarse, fine = (tessellate(mesh, scheme=scheme, halvings=h).volume() for h in (5, 6))
    return (4 * fine - coarse) / 3


@pytest.mark.parametrize("name", SOLIDS)
def test_the_solid_passes_the_gate_with_the_volume_of_the_limit_surface(name):
    scheme, mesh = SOLIDS[name]
    report = check(mosaic_shape(limit_faces(mesh, scheme).mosaic, TOLERANCE), TOLERANCE)
    assert report.passed, report.defects
    assert report.max_smooth_edge_angle < np.radians(0.01)
    assert report.max_gap < 1e-9
    assert report.measures.volume == pytest.approx(dense_volume(mesh, scheme), rel=1e-5)


@pytest.mark.parametrize("name", ["one handle", "loop"])
def test_a_boolean_cut_takes_away_what_both_have_in_common(name):
    scheme, mesh = SOLIDS[name]
    solid = mosaic_shape(limit_faces(mesh, scheme).mosaic, TOLERANCE)
    low, high = np.array(measure(solid).bounding_box)
    middle, size = (low + high) / 2, float((high - low).max())
    corner = middle + 0.013 * size
    box = BRepPrimAPI_MakeBox(gp_Pnt(*corner.tolist()), size, size, size).Solid()
    axis = gp_Ax2(gp_Pnt(*(middle - [0.31 * size, 0.02 * size, size]).tolist()), gp_Dir(0, 0, 1))
    cylinder = BRepPrimAPI_MakeCylinder(axis, 0.07 * size, 2 * size).Solid()
    for tool in (box, cylinder):
        cut, common = BRepAlgoAPI_Cut(solid, tool).Shape(), BRepAlgoAPI_Common(solid, tool).Shape()
        report = check(cut, Tolerance(fit=1e-3 * size), expect=ShapeKind.COMPOUND)
        assert report.passed, report.defects
        parts = measure(cut).volume + (measure(common).volume or 0.0)
        assert parts == pytest.approx(measure(solid).volume, rel=1e-4)


def test_a_solid_can_be_offset():
    scheme, mesh = SOLIDS["doo-sabin"]
    solid = mosaic_shape(limit_faces(mesh, scheme).mosaic, TOLERANCE)
    whole = measure(solid)
    thickness = 0.003
    offset = BRepOffsetAPI_MakeOffsetShape()
    offset.PerformByJoin(solid, thickness, 1e-5)
    assert offset.IsDone()
    report = check(offset.Shape(), Tolerance(fit=1e-3), expect=ShapeKind.COMPOUND)
    assert report.passed, report.defects
    # to first order the skin is its area times its thickness
    assert measure(offset.Shape()).volume - whole.volume == pytest.approx(whole.area * thickness, rel=0.02)


def test_a_section_is_a_closed_curve():
    scheme, mesh = SOLIDS["drum"]
    solid = mosaic_shape(limit_faces(mesh, scheme).mosaic, TOLERANCE)
    section = BRepAlgoAPI_Section(solid, gp_Pln(gp_Pnt(0.0, 0.0, 0.07), gp_Dir(0.0, 0.0, 1.0)))
    section.Build()
    ends = [
        tuple(np.round(vertex, 5))
        for edge in sub_shapes(section.Shape(), TopAbs_ShapeEnum.TopAbs_EDGE)
        for vertex in _ends(edge)
    ]
    assert ends and all(ends.count(end) == 2 for end in ends)


def _ends(edge):
    from OCP.BRep import BRep_Tool
    from OCP.TopoDS import TopoDS

    return [
        BRep_Tool.Pnt_s(TopoDS.Vertex_s(vertex)).Coord() for vertex in sub_shapes(edge, TopAbs_ShapeEnum.TopAbs_VERTEX)
    ]


def test_triangles_of_three_tolerances_are_closed_and_come_nearer_to_the_volume():
    scheme, mesh = SOLIDS["one handle"]
    solid = mosaic_shape(limit_faces(mesh, scheme).mosaic, TOLERANCE)
    exact, deflections = measure(solid), (0.03, 0.01, 0.003)
    off = [abs(triangulate(solid, deflection).mesh.volume() - exact.volume) for deflection in deflections]
    assert off[2] < off[1] < off[0]
    # the volume between two surfaces nowhere farther apart
    assert all(found < exact.area * deflection for found, deflection in zip(off, deflections))


def test_the_solid_comes_back_from_a_file(tmp_path: Path):
    scheme, mesh = SOLIDS["one handle"]
    shape = mosaic_shape(limit_faces(mesh, scheme).mosaic, TOLERANCE)
    back = write_step(shape, tmp_path / "solid.step", header=FileHeader(name="solid"))
    assert back.same
    assert abs(back.volume_change) < 1e-9


def test_an_open_mesh_becomes_a_shell():
    shape = mosaic_shape(limit_faces(grid(5, 4), Scheme.CATMULL_CLARK).mosaic, TOLERANCE)
    assert check(shape, TOLERANCE, expect=ShapeKind.SHELL).passed


def test_two_bodies_become_two_solids():
    one, n = drum(3), drum(3).n_vertices
    points = np.concatenate([one.vertices, one.vertices + np.array([5.0, 0.0, 0.0])])
    two = ControlMesh.from_faces(points, np.concatenate([one.faces_of(4), one.faces_of(4) + n]))
    report = check(mosaic_shape(limit_faces(two, Scheme.CATMULL_CLARK).mosaic, TOLERANCE), TOLERANCE)
    assert report.passed, report.defects
    assert report.measures.solids == 2


def test_a_mesh_turned_inside_out_gives_the_same_solid():
    mesh = drum(5)
    turned = ControlMesh.from_faces(mesh.vertices, mesh.faces_of(4)[:, ::-1])
    volumes = [
        measure(mosaic_shape(limit_faces(m, Scheme.CATMULL_CLARK).mosaic, TOLERANCE)).volume for m in (mesh, turned)
    ]
    assert volumes[1] == pytest.approx(volumes[0], rel=1e-9)


def test_the_gate_refuses_an_angle_above_the_one_promised():
    cube = with_handles(0)
    sharp = ControlMesh.from_faces(cube.vertices, cube.faces_of(4), crease_edges=edge_table(cube.faces_of(4)).edges)
    mosaic = limit_faces(sharp, Scheme.CATMULL_CLARK).mosaic
    assert check(mosaic_shape(mosaic, TOLERANCE), TOLERANCE).passed
    said = PatchMosaic(
        mosaic.patches, mosaic.vertices, mosaic.edge_curves, mosaic.edge_vertices, np.ones(len(mosaic.edge_curves)),
        mosaic.side_starts, mosaic.side_edges, mosaic.side_forward, mosaic.side_ranges,
    )  # fmt: skip
    found = check(mosaic_shape(said, TOLERANCE), TOLERANCE).defects
    assert [defect.code for defect in found] == ["edge-angle"]


def test_patches_that_gape_are_refused():
    mosaic = limit_faces(drum(3), Scheme.CATMULL_CLARK).mosaic
    moved = [
        curve.__class__(curve.degree, curve.knots, curve.control_points + 1e-3) for curve in mosaic.edge_curves[:1]
    ]
    gaping = PatchMosaic(
        mosaic.patches, mosaic.vertices, (*moved, *mosaic.edge_curves[1:]), mosaic.edge_vertices, mosaic.smooth_edges,
        mosaic.side_starts, mosaic.side_edges, mosaic.side_forward, mosaic.side_ranges,
    )  # fmt: skip
    with pytest.raises(NotManifold, match="apart along an edge"):
        mosaic_shape(gaping, TOLERANCE)
