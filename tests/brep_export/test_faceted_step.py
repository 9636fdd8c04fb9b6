"""STEP written from arrays: the kernel, and one that is not OCCT, read the same solids back."""

import numpy as np
import pytest

from brep_export.check import check
from brep_export.faceted_step import faceted_step_size, write_faceted_step
from brep_export.file_header import FileHeader, LengthUnit
from brep_export.measures import measure
from brep_export.read_back import read_cad
from brep_export.solids import polyhedron_solid
from recon.geometry.mesh import TriangleMesh
from recon.geometry.polyhedron import PlanarFace, Polyhedron, merge_coplanar, mesh_bodies
from recon.geometry.voxel_grid import VoxelGrid
from recon.tolerance import Tolerance
from recon.voxel_mesh.marching_cubes import marching_cubes


def blocks() -> TriangleMesh:
    """A block with a void, a frame with a hole, far from the origin."""
    solid = np.zeros((20, 14, 12), dtype=bool)
    solid[2:9, 2:12, 2:10] = True
    solid[4:7, 5:9, 4:8] = False
    solid[11:18, 2:12, 2:10] = True
    solid[13:16, :, 4:8] = False
    grid = VoxelGrid(np.array([1.0, 0.5, 2.0]), np.array([100.0, -20.0, 3.0]), np.eye(3), "blocks", solid)
    s = marching_cubes(grid)
    return grid.placed(s.vertices, s.face_vertices)


def triangles(mesh: TriangleMesh) -> Polyhedron:
    faces = tuple(PlanarFace(tuple(row)) for row in mesh.face_vertices.tolist())
    bodies = tuple(tuple(tuple(shell.tolist()) for shell in body) for body in mesh_bodies(mesh))
    return Polyhedron(mesh.vertices, faces, bodies)


@pytest.mark.parametrize("make", [triangles, lambda mesh: merge_coplanar(mesh, 1e-6)], ids=["triangles", "polygons"])
@pytest.mark.parametrize("unit", [LengthUnit.MILLIMETRE, LengthUnit.METRE])
def test_solids_voids_and_holes_come_back_the_same(tmp_path, make, unit):
    polyhedron = make(blocks())
    shape = polyhedron_solid(polyhedron)
    path = tmp_path / "part.step"
    back = write_faceted_step(polyhedron, path, header=FileHeader(name="o'part", unit=unit), measures=measure(shape))
    assert back.same, [str(d) for d in back.defects]
    assert back.volume_change == pytest.approx(0.0, abs=1e-9)
    assert check(read_cad(path, unit=str(unit)), Tolerance()).passed
    assert 0.5 < faceted_step_size(polyhedron) / path.stat().st_size < 2.0
