"""STEP, BREP and the reader: files come back as what they were, whole or not at all, and bad ones are refused."""

import os
import subprocess
import sys
from pathlib import Path

import cadquery as cq
import pytest
from kernel_shapes import box, compound, faces, lens, shell, sound_shapes, spline_prism
from OCP.BRep import BRep_Tool
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS, TopoDS_Shape

from brep_export.check_topology import ShapeKind, sub_shapes
from brep_export.file_header import FileHeader, LengthUnit
from brep_export.measures import measure
from brep_export.outputs import require_writable, write_outputs
from brep_export.read_back import read_cad
from brep_export.staging import staged
from brep_export.step import StepSchema, needs_pcurves, write_step
from brep_export.triangulation import triangulate
from recon.errors import NotWritten, UnreadableFile, UnsupportedFormat

SOUND = sound_shapes()


@pytest.mark.parametrize("name", SOUND)
def test_sound_shapes_come_back_the_same(name: str, tmp_path: Path) -> None:
    back = write_step(SOUND[name], tmp_path / "part.step")
    assert back.same and back.defects == ()
    assert back.volume_change == pytest.approx(0.0, abs=1e-6)


def test_the_kernel_prints_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write_step(SOUND["box"], tmp_path / "part.step")
    assert capfd.readouterr() == ("", "")


def test_open_shapes_come_back_as_what_they_are(tmp_path: Path) -> None:
    open_box = shell(faces(box())[1:], marked_closed=False)
    for shape, kind in ((open_box, ShapeKind.SHELL), (faces(lens())[0], ShapeKind.FACE)):
        assert measure(shape).kind is kind
        assert write_step(shape, tmp_path / "open.stp").same


@pytest.mark.parametrize("schema", StepSchema)
def test_the_header_says_who_and_what(schema: StepSchema, tmp_path: Path) -> None:
    path = tmp_path / "part.step"
    write_step(box(), path, header=FileHeader("amphora 7", "A. Potter", "Workshop"), schema=schema)
    text = path.read_text()
    for word in ("'amphora 7'", "('A. Potter')", "('Workshop')", "'recon-brep ", "SI_UNIT(.MILLI.,.METRE.)"):
        assert word in text
    assert ("AUTOMOTIVE_DESIGN" if schema is StepSchema.AP214 else "AP242") in text


def test_the_file_holds_its_volume_area_and_centroid(tmp_path: Path) -> None:
    for shape in (box(at=(1, 2, 3)), box().Moved(cq.Location((1, 2, 3)).wrapped)):
        path = tmp_path / "part.step"
        write_step(shape, path)
        text = "".join(path.read_text().split())
        assert "VOLUME_MEASURE(6.E+03)" in text or "VOLUME_MEASURE(6.000000000000E+03)" in text
        assert "AREA_MEASURE(2.2E+03)" in text or "AREA_MEASURE(2.200000000000E+03)" in text
        assert "CARTESIAN_POINT('centrepoint',(1.,2.,3.))" in text
        assert text.count("=PRODUCT(") == 1  # one part, no assembly around it


@pytest.mark.parametrize("unit", LengthUnit)
def test_coordinates_keep_their_numbers_and_the_unit_says_what_they_mean(unit: LengthUnit, tmp_path: Path) -> None:
    path = tmp_path / "part.step"
    assert write_step(box(), path, header=FileHeader(unit=unit)).same
    assert measure(read_cad(path)).volume == pytest.approx(6000 * (1e3 * unit.in_metres) ** 3)


def test_curves_on_faces_are_kept_only_where_a_spline_face_is_trimmed() -> None:
    assert needs_pcurves(lens())
    assert not any(needs_pcurves(SOUND[name]) for name in ("box", "sphere", "torus", "cone", "loft", "spline prism"))


@pytest.mark.parametrize("name", ["box", "cylinder", "torus", "cone", "spline of revolution", "trimmed spline faces"])
def test_another_kernel_reads_the_same_solid(name: str, tmp_path: Path) -> None:
    pykentron = pytest.importorskip("pykentron")
    path = tmp_path / "part.step"
    write_step(SOUND[name], path)
    other = pykentron.importers.importStep(str(path)).val()
    assert other.ShapeType() == "Solid" and other.isValid()
    assert other.Volume() == pytest.approx(measure(SOUND[name]).volume, rel=3e-5)


def test_another_kernel_confirms_the_volume_over_a_long_spline_edge(tmp_path: Path) -> None:
    pykentron = pytest.importorskip("pykentron")
    shape, volume = spline_prism()
    write_step(shape, tmp_path / "prism.step")
    assert pykentron.importers.importStep(str(tmp_path / "prism.step")).val().Volume() == pytest.approx(
        volume, rel=1e-4
    )


# Reading --------------------------------------------------------------------------------------------------------------


def write_bad_files(folder: Path) -> dict[str, str]:
    write_step(box(), folder / "whole.step")
    text = (folder / "whole.step").read_bytes()
    (folder / "cut.step").write_bytes(text[: len(text) // 2])
    (folder / "empty.step").write_bytes(b"")
    (folder / "picture.step").write_bytes(bytes(range(256)) * 8)
    (folder / "picture.igs").write_bytes(bytes(range(256)) * 8)
    (folder / "words.brep").write_text("nothing of the kind\n")
    (folder / "folder.step").mkdir()
    head = text[: text.index(b"DATA;")]
    (folder / "nothing.step").write_bytes(head + b"DATA;\nENDSEC;\nEND-ISO-10303-21;\n")
    (folder / "wrong.step").write_bytes(head + b"DATA;\n#1=SPHERE(;\nENDSEC;\nEND-ISO-10303-21;\n")
    return {
        "missing.step": "no such file",
        "cut.step": "before its end",
        "empty.step": "empty",
        "picture.step": "content",
        "picture.igs": "content",
        "words.brep": "content",
        "folder.step": "directory",
        "nothing.step": "holds no shape",
        "wrong.step": "kernel",
    }


def test_bad_files_are_refused_with_one_sentence(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for name, reason in write_bad_files(tmp_path).items():
        with pytest.raises(UnreadableFile, match=reason) as caught:
            read_cad(tmp_path / name)
        assert name in str(caught.value) and "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_other_endings_are_refused_and_capitals_are_not(tmp_path: Path) -> None:
    with pytest.raises(UnsupportedFormat, match=r"\.step"):
        read_cad(tmp_path / "part.dwg")
    write_step(box(), tmp_path / "PART.STEP")
    assert measure(read_cad(tmp_path / "PART.STEP")).volume == pytest.approx(6000)


# Several files at once ------------------------------------------------------------------------------------------------


def test_all_formats_of_one_shape_are_put_in_place_together(tmp_path: Path) -> None:
    shape = lens()
    mesh = triangulate(shape, 0.05).mesh
    names = ["p.step", "p.stp", "p.iges", "p.igs", "p.brep", "p.stl", "p.3mf", "p.glb"]
    results = write_outputs(shape, mesh, [tmp_path / name for name in names])
    assert all(result.same for result in results)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)


def test_when_one_file_fails_none_appears_and_old_ones_stay(tmp_path: Path) -> None:
    (tmp_path / "a.step").write_text("old")
    mesh = triangulate(box(), 0.1).mesh
    with pytest.raises(NotWritten, match=r"b\.stl"):
        write_outputs(box(), mesh.part(mesh.face_vertices[:, 0] < 0), [tmp_path / "a.step", tmp_path / "b.stl"])
    assert [path.name for path in tmp_path.iterdir()] == ["a.step"]
    assert (tmp_path / "a.step").read_text() == "old"


def test_a_place_that_cannot_take_a_file_is_refused_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "dir.step").mkdir()
    for path in (tmp_path / "dir.step", tmp_path / "no" / "where.step"):
        with pytest.raises(NotWritten), staged(path):
            pytest.fail("the block must not run")
    with pytest.raises(UnsupportedFormat):
        require_writable(["part.docx"])


def test_an_unwritten_or_failed_block_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(NotWritten, match="nothing came out"), staged(tmp_path / "a.step"):
        pass
    with pytest.raises(ValueError), staged(tmp_path / "a.step", tmp_path / "b.step") as (a, _):
        a.write_text("half")
        raise ValueError
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_reads_back_as_something_else_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def other(path: Path, *, unit: str = "MM") -> TopoDS_Shape:
        return compound(box(), box(at=(50, 0, 0)))

    monkeypatch.setattr("brep_export.step.read_cad", other)
    mesh = triangulate(box(), 0.1).mesh
    with pytest.raises(NotWritten, match="read-back"):
        write_outputs(box(), mesh, [tmp_path / "a.step"])
    assert list(tmp_path.iterdir()) == []
    assert not write_outputs(box(), mesh, [tmp_path / "a.step"], allow_change=True)[0].same


@pytest.mark.parametrize(
    ("unit", "per_mm"), [(LengthUnit.MILLIMETRE, 1.0), (LengthUnit.METRE, 1e-3), (LengthUnit.INCH, 1 / 25.4)]
)
def test_the_accuracy_that_a_file_states_is_the_least_tolerance_of_what_is_read(tmp_path, unit, per_mm):
    part = box()
    path = tmp_path / "part.step"
    write_step(part, path, header=FileHeader(unit=unit))
    text = path.read_text()
    stated = text[text.index("LENGTH_MEASURE(", text.index("UNCERTAINTY_MEASURE_WITH_UNIT")) :]
    path.write_text(text.replace(stated[: stated.index(")") + 1], f"LENGTH_MEASURE({0.02 * per_mm:.6E})"))
    edge = next(iter(sub_shapes(read_cad(path), TopAbs_ShapeEnum.TopAbs_EDGE)))
    assert BRep_Tool.Tolerance_s(TopoDS.Edge_s(edge)) == pytest.approx(0.02, rel=1e-5)


def test_what_a_killed_run_left_is_cleared_away_by_a_later_one(tmp_path: Path) -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    names = {
        "old": f".part.{gone.pid}.0.step",
        "old copy": f".part.{gone.pid}.advance.step",
        "running": f".part.{os.getpid()}.7.step",
        "of another": f".parts.{gone.pid}.0.step",
        "young": f".part.{gone.pid}.1.step",
    }
    for name in names.values():
        (tmp_path / name).write_text("half")
        os.utime(tmp_path / name, (0, 0))
    os.utime(tmp_path / names["young"])
    with staged(tmp_path / "part.step") as (temporary,):
        temporary.write_text("whole")
    kept = {path.name for path in tmp_path.iterdir()}
    assert kept == {"part.step", names["running"], names["of another"], names["young"]}
