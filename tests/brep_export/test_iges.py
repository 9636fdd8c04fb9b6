"""IGES keeps solids and units; BREP keeps everything."""

from pathlib import Path

import cadquery as cq
import pytest
from kernel_shapes import box, sound_shapes, spline_prism
from OCP.TopAbs import TopAbs_ShapeEnum

from brep_export.brep_file import write_brep
from brep_export.check_topology import sub_shapes
from brep_export.file_header import FileHeader, LengthUnit
from brep_export.iges import write_iges
from brep_export.measures import measure
from brep_export.outputs import write_outputs
from brep_export.read_back import read_cad
from brep_export.triangulation import triangulate
from recon.errors import NotWritten, UnreadableFile

SOUND = sound_shapes()


@pytest.mark.parametrize("name", [name for name in SOUND if name != "box with a void"])
def test_sound_shapes_come_back_the_same(name: str, tmp_path: Path) -> None:
    assert write_iges(SOUND[name], tmp_path / "part.igs").defects == ()
    assert write_brep(SOUND[name], tmp_path / "part.brep").defects == ()


def test_the_solid_is_one_of_the_brep_form(tmp_path: Path) -> None:
    write_iges(box(), tmp_path / "part.iges")
    back = read_cad(tmp_path / "part.iges")
    assert len(list(sub_shapes(back, TopAbs_ShapeEnum.TopAbs_SOLID))) == 1
    assert "\n     186 " in (tmp_path / "part.iges").read_text()


def test_the_header_names_the_program_and_no_account(tmp_path: Path) -> None:
    write_iges(box(), tmp_path / "part.igs", header=FileHeader("jar"))
    glued = "".join(line[:72] for line in (tmp_path / "part.igs").read_text().splitlines() if line[72:73] == "G")
    assert "3Hjar" in glued and "Hrecon-brep " in glued and "7Hunknown" in glued


@pytest.mark.parametrize("unit", LengthUnit)
def test_coordinates_keep_their_numbers_and_the_unit_says_what_they_mean(unit: LengthUnit, tmp_path: Path) -> None:
    assert write_iges(box(), tmp_path / "part.igs", header=FileHeader(unit=unit)).same
    assert measure(read_cad(tmp_path / "part.igs")).volume == pytest.approx(6000 * (1e3 * unit.in_metres) ** 3)


def test_what_the_kernel_loses_in_iges_is_listed(tmp_path: Path) -> None:
    """A ball with two holes, one of them star-shaped: the kernel reads it with curves on the ball far off the edges."""
    star = cq.Workplane(cq.Shape.cast(spline_prism()[0]).scale(0.3)).translate((4, 0, 0))
    ball = cq.Workplane().sphere(10).cut(cq.Workplane().cylinder(30, 3)).cut(star).val().wrapped
    back = write_iges(ball, tmp_path / "ball.igs")
    assert {defect.code for defect in back.defects} >= {"read-back-volume", "read-back-area"}
    mesh = triangulate(ball, 0.1).mesh
    with pytest.raises(NotWritten, match="read-back-volume"):
        write_outputs(ball, mesh, [tmp_path / "other.igs"])
    assert not (tmp_path / "other.igs").exists()


@pytest.mark.parametrize("ending", [".igs", ".brep"])
def test_a_file_cut_short_is_refused(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"part{ending}"
    (write_iges if ending == ".igs" else write_brep)(box(), path)
    whole = path.read_bytes()
    for part in (0.3, 0.6, 0.95):
        path.write_bytes(whole[: int(part * len(whole))])
        with pytest.raises(UnreadableFile, match="before its end"):
            read_cad(path)
