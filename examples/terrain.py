"""Contour lines of a made-up hill to a solid of smooth faces, as STEP, with a picture."""

from pathlib import Path

import numpy as np

from brep_export.app.pictures import draw, views_around
from brep_export.blocks import block_solid
from brep_export.check import check
from brep_export.file_header import FileHeader, LengthUnit
from brep_export.outputs import write_outputs
from recon.geometry.contour_map import HeightGrid
from recon.terrain.contouring import contour_grid
from recon.terrain.network import terrain_network
from recon.terrain.pipeline import terrain_surface
from recon.tolerance import Tolerance

x, y = np.arange(0.0, 310.0, 10.0), np.arange(0.0, 210.0, 10.0)
px, py = np.meshgrid(x, y)
heights = 5 + 0.04 * px + 60 * np.exp(-(((px - 120) / 70) ** 2) - ((py - 100) / 50) ** 2)

contours = contour_grid(HeightGrid(x, y, heights), interval=10.0)
ground = terrain_surface(contours)
solid = block_solid(terrain_network(ground), -20.0, Tolerance())
report = check(solid, Tolerance()).require()
header = FileHeader(name="hill", unit=LengthUnit("M"))
write_outputs(solid, report.triangles(), ["hill.step"], header=header)
draw(Path("hill.png"), views_around(report.triangles()))
print(f"{contours.n_points} contour points, {ground.n_patches} faces, {report.measures.volume:.0f} m³")
