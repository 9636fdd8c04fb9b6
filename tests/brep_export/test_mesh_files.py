"""Mesh files keep the triangles, the volume and, where the format knows one, the unit."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from kernel_shapes import box, sound_shapes

from brep_export.file_header import FileHeader, LengthUnit
from brep_export.mesh_files import MESH_ENDINGS, write_mesh
from brep_export.triangulation import triangulate
from recon.errors import NotWritten, UnsupportedFormat
from recon.geometry.mesh import TriangleMesh

MESHES = {name: triangulate(shape, 0.05).mesh for name, shape in sound_shapes().items()}


@pytest.mark.parametrize("ending", MESH_ENDINGS)
@pytest.mark.parametrize("name", MESHES)
def test_triangles_and_volume_come_back(name: str, ending: str, tmp_path: Path) -> None:
    back = write_mesh(MESHES[name], tmp_path / f"part{ending}")
    assert back.defects == ()
    assert back.volume_change is not None and back.volume_change < 1e-5


def test_an_independent_reader_finds_a_closed_stl(tmp_path: Path) -> None:
    write_mesh(MESHES["torus"], tmp_path / "part.stl", header=FileHeader("solid gold"))
    again = trimesh.load(tmp_path / "part.stl")
    assert again.is_watertight and again.is_winding_consistent
    assert again.volume == pytest.approx(MESHES["torus"].volume(), rel=1e-6)
    assert (tmp_path / "part.stl").stat().st_size == 84 + 50 * MESHES["torus"].n_faces


def test_a_3mf_is_a_package_that_says_its_unit(tmp_path: Path) -> None:
    path = tmp_path / "part.3mf"
    write_mesh(MESHES["box"], path, header=FileHeader('a "b" & <c>', unit=LengthUnit.METRE))
    with zipfile.ZipFile(path) as package:
        assert set(package.namelist()) == {"[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"}
        assert {part.date_time[0] for part in package.infolist()} == {1980}  # the same bytes whenever it is written
        assert 'unit="meter"' in package.read("3D/3dmodel.model").decode()
    assert trimesh.load(path, force="mesh").is_watertight


def test_a_glb_is_in_metres_with_y_up(tmp_path: Path) -> None:
    """A box of 10 x 20 x 30 mm stands 0.030 m high along y, its outside outside."""
    write_mesh(triangulate(box(), 0.1).mesh, tmp_path / "part.glb")
    again = trimesh.load(tmp_path / "part.glb", force="mesh")
    assert np.allclose(again.extents, [0.010, 0.030, 0.020])
    assert again.volume == pytest.approx(6000e-9, rel=1e-5)


def test_nothing_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(NotWritten, match="no triangles"):
        write_mesh(TriangleMesh(np.empty((0, 3)), np.empty((0, 3), dtype=int)), tmp_path / "part.stl")
    with pytest.raises(UnsupportedFormat):
        write_mesh(MESHES["box"], tmp_path / "part.obj")
    with pytest.raises(NotWritten, match="disk"):
        write_mesh(MESHES["box"], tmp_path / "nowhere" / "part.stl")


@pytest.mark.parametrize("ending", [".stl", ".3mf", ".glb"])
def test_an_open_mesh_far_from_the_origin_reads_back_the_same(tmp_path, ending):
    far = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [5, 5, 5]]) + 300.0
    assert write_mesh(TriangleMesh(far, [[0, 1, 2], [0, 3, 1], [1, 4, 2]]), tmp_path / f"open{ending}").same


def test_stl_is_written_in_the_millimetres_that_printing_programs_take_it_for(tmp_path: Path) -> None:
    header = FileHeader(unit=LengthUnit.METRE)
    assert write_mesh(MESHES["box"], tmp_path / "part.stl", header=header).same
    extent = np.ptp(trimesh.load(tmp_path / "part.stl").vertices, axis=0)
    np.testing.assert_allclose(extent, 1000.0 * np.ptp(MESHES["box"].vertices, axis=0), rtol=1e-6)


def test_glb_holds_the_colours_of_its_vertices(tmp_path: Path) -> None:
    mesh, path = MESHES["box"], tmp_path / "part.glb"
    colours = np.column_stack([np.arange(3 * mesh.n_vertices).reshape(-1, 3), np.full(mesh.n_vertices, 255)])
    assert write_mesh(mesh, path, colours=colours.astype(np.uint8)).same
    back = trimesh.load(path, force="mesh", process=False)
    np.testing.assert_array_equal(back.visual.vertex_colors, colours)


def test_formats_for_printing_leave_colours_away(tmp_path: Path) -> None:
    mesh = MESHES["box"]
    colours = np.zeros((mesh.n_vertices, 4), dtype=np.uint8)
    for ending in (".stl", ".3mf"):
        plain, coloured = tmp_path / f"plain{ending}", tmp_path / f"coloured{ending}"
        write_mesh(mesh, plain)
        assert write_mesh(mesh, coloured, colours=colours).same
        assert len(coloured.read_bytes()) == len(plain.read_bytes())
