"""STEP of many spline faces, written from arrays: two kernels read the same shapes back, pcurves and all."""

import numpy as np
import pytest
from kernel_shapes import box, faces, sound_shapes
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepClass3d import BRepClass3d_SolidClassifier
from OCP.TopAbs import TopAbs_ShapeEnum, TopAbs_State
from OCP.TopoDS import TopoDS
from quad_meshes import with_handles

from brep_export.blocks import block_solid
from brep_export.check import ShapeKind, check
from brep_export.check_geometry import max_tolerance
from brep_export.check_topology import sub_shapes
from brep_export.compounds import one_or_compound
from brep_export.file_header import FileHeader, LengthUnit
from brep_export.infinity import infinity_is_outside
from brep_export.measures import measure
from brep_export.mosaics import mosaic_shape
from brep_export.read_back import read_cad
from brep_export.shells import network_shell
from brep_export.spline_cones import is_whole
from brep_export.spline_step import write_spline_text
from brep_export.step import StepSchema, write_step
from brep_export.survey import survey
from recon.geometry.bspline import BSplineSurface
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.patches import PatchNetwork, connect
from recon.subdivision.quad_faces import catmull_clark_faces
from recon.tolerance import Tolerance

TOLERANCE = Tolerance(merge=1e-6, fit=1e-3)
KNOTS = np.repeat([0.0, 1.0], 2)
SOUND = sound_shapes()


def saddles() -> PatchNetwork:
    """z = x y over 9 x 8 unit squares, far from the origin in x."""
    cells = [(1000.0 + i, float(j)) for i in range(9) for j in range(8)]
    nets = [[[[x + i, y + j, 0.1 * (x + i - 1000) * (y + j)] for j in (0, 1)] for i in (0, 1)] for x, y in cells]
    return connect([BSplineSurface(1, 1, KNOTS, KNOTS, np.array(net)) for net in nets], 1e-9)


def pyramid(n: int = 72) -> PatchNetwork:
    """n triangles around an apex, each a patch with one side in a point."""
    turn = 2 * np.pi * np.arange(n + 1) / n
    rim = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    rim[-1] = rim[0]
    nets = [[[a, [0.0, 0.0, 1.0]], [b, [0.0, 0.0, 1.0]]] for a, b in zip(rim[:-1].tolist(), rim[1:].tolist())]
    return connect([BSplineSurface(1, 1, KNOTS, KNOTS, np.array(net)) for net in nets], 1e-9)


NETWORKS = {"saddles": saddles, "pyramid": pyramid}


@pytest.mark.parametrize("unit", [LengthUnit.MILLIMETRE, LengthUnit.METRE])
@pytest.mark.parametrize("name", NETWORKS)
def test_blocks_and_shells_come_back_the_same(name, unit, tmp_path):
    network = NETWORKS[name]()
    path, header = tmp_path / "part.step", FileHeader(name="o'ground", unit=unit)
    for shape, kind in (
        (block_solid(network, -1.0, TOLERANCE), ShapeKind.SOLID),
        (network_shell(network, TOLERANCE), ShapeKind.SHELL),
        (network_shell(network, TOLERANCE).Reversed(), ShapeKind.SHELL),
    ):
        assert write_spline_text(shape, path, header, measure(shape))
        back = read_cad(path, unit=str(unit))
        assert measure(back).kind is kind
        assert measure(back).area == pytest.approx(measure(shape).area, rel=1e-6)
        assert measure(back).faces == measure(shape).faces and measure(back).edges == measure(shape).edges
        assert [d.code for d in check(back, TOLERANCE, expect=kind).defects] == []


def test_every_edge_has_its_curve_on_the_face_in_the_file(tmp_path):
    shape, path = block_solid(saddles(), -1.0, TOLERANCE), tmp_path / "part.step"
    assert write_step(shape, path).same
    seen = survey(read_cad(path))
    splined = seen.nets.grouped()[seen.uses.face]
    assert seen.straight[splined].all()  # projected by the reader they would be splines
    assert path.read_text().count("DEFINITIONAL_REPRESENTATION(") <= 8  # four sides, either way


def test_the_file_tells_volume_area_and_centre(tmp_path):
    shape, path = block_solid(saddles(), -1.0, TOLERANCE), tmp_path / "part.step"
    write_step(shape, path)
    text, measures = path.read_text(), measure(shape)
    assert f"VOLUME_MEASURE({measures.volume!r})" in text and f"AREA_MEASURE({measures.area!r})" in text


def test_several_solids_come_back_as_several(tmp_path):
    both = one_or_compound([block_solid(pyramid(), -1.0, TOLERANCE), block_solid(saddles(), -1.0, TOLERANCE)])
    assert write_spline_text(both, tmp_path / "part.step", FileHeader(), measure(both))
    assert write_step(both, tmp_path / "part.step").same


def test_the_file_states_the_widest_tolerance_and_spells_any_name(tmp_path):
    shape, path = block_solid(saddles(), -1.0, TOLERANCE), tmp_path / "part.step"
    BRep_Builder().UpdateVertex(TopoDS.Vertex_s(next(sub_shapes(shape, TopAbs_ShapeEnum.TopAbs_VERTEX))), 2.5e-4)
    write_step(shape, path, header=FileHeader(name="B\u00f6schung \\ 7"))
    assert "UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.00025)" in path.read_text()
    assert r"PRODUCT('B\X2\00F6\X0\schung \\ 7'" in path.read_text()
    assert max_tolerance(read_cad(path)) >= 2.5e-4


def test_another_kernel_reads_the_same_block(tmp_path):
    pykentron = pytest.importorskip("pykentron")
    shape, path = block_solid(saddles(), -1.0, TOLERANCE), tmp_path / "part.step"
    write_step(shape, path)
    other = pykentron.importers.importStep(str(path)).val()
    assert other.ShapeType() == "Solid" and other.isValid()
    assert other.Volume() == pytest.approx(measure(shape).volume, rel=1e-5)


def test_what_it_cannot_hold_is_left_to_the_kernel(tmp_path):
    path = tmp_path / "part.step"
    for shape in (*SOUND.values(), faces(box())[0]):
        assert not write_spline_text(shape, path, FileHeader(), measure(shape))
    assert not path.exists()
    block = block_solid(saddles(), -1.0, TOLERANCE)
    assert write_step(block, path, schema=StepSchema.AP242).same  # by the kernel
    assert write_step(block, path, header=FileHeader(unit=LengthUnit.INCH)).same


@pytest.mark.parametrize("name", [*SOUND, *NETWORKS])
def test_whole_faces_are_those_of_a_face_by_face_look(name):
    shape = SOUND[name] if name in SOUND else block_solid(NETWORKS[name](), -1.0, TOLERANCE)
    seen = survey(shape)
    grouped = seen.nets.grouped()
    for face, in_group, whole in zip(seen.uses.faces, grouped, seen.whole()):
        assert whole == (bool(in_group) and is_whole(face, BRep_Tool.Surface_s(face)))


def test_faces_that_are_turned_over_are_whole_also_once_they_were_read(tmp_path):
    outside_in = with_handles(1)
    mesh = ControlMesh.from_faces(outside_in.vertices, outside_in.faces_of(4)[:, ::-1])
    shape = mosaic_shape(catmull_clark_faces(mesh, grouped=False).mosaic, TOLERANCE)
    path = tmp_path / "part.step"
    for _ in range(2):  # as it was made, and as it was read
        assert survey(shape).whole().all()
        assert write_spline_text(shape, path, FileHeader(), measure(shape))
        shape = read_cad(path)


@pytest.mark.parametrize("name", SOUND)
def test_lines_tell_of_infinity_what_the_classifier_tells(name):
    for shape in (SOUND[name], SOUND[name].Reversed()):
        classifier = BRepClass3d_SolidClassifier(shape)
        classifier.PerformInfinitePoint(1e-7)
        assert infinity_is_outside(shape) == (classifier.State() == TopAbs_State.TopAbs_OUT)
