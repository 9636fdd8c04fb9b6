"""Voxels to a CAD solid: a turned block with a hole, known as a grid only, gets its planes and its cylinder back."""

from pathlib import Path

import numpy as np

from brep_export.analytic import analytic_solid, face_kinds
from brep_export.app.pictures import draw, views_around
from brep_export.check import check
from brep_export.outputs import write_outputs
from recon import Tolerance
from recon.geometry.voxel_grid import VoxelGrid
from recon.voxel_mesh.analytic_part import analytic_part
from recon.voxel_mesh.revoxelise import wrong_side

turn = np.linalg.qr(np.array([[3.0, 1.0, 0.5], [-1.0, 3.0, 1.0], [0.2, -1.0, 3.0]]))[0]
axis = np.arange(-40, 40) + 0.137
x = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1) @ turn
block = (np.abs(x) < [28.0, 20.0, 16.0]).all(axis=-1)
hole = (x[..., 0] - 8.0) ** 2 + x[..., 2] ** 2 < 9.0**2
grid = VoxelGrid(spacing=np.full(3, 0.5), solid=block & ~hole, name="block")

part = analytic_part(grid)
solid, _ = analytic_solid(part.surfaces, part.blends, box=part.box, voxel=grid.voxel, is_solid=part.vote())
report = check(solid, Tolerance()).require()
write_outputs(solid, report.triangles(), ["block.step"])
draw(Path("block.png"), views_around(report.triangles()))
print(face_kinds(solid), f"{report.measures.volume:.0f} mm³,", wrong_side(grid, report.triangles()))
