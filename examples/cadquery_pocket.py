"""A mountain from contour lines gets a level place for a building, and the building on it."""

from pathlib import Path

import cadquery as cq
import numpy as np

from brep_export.app.extension import terrain
from brep_export.app.pictures import CLAY, MADE, Part, View, draw
from brep_export.check import check
from brep_export.file_header import FileHeader, LengthUnit
from brep_export.outputs import write_outputs
from recon import Tolerance
from recon.geometry.contour_map import HeightGrid

x, y = np.arange(0.0, 310.0, 10.0), np.arange(0.0, 210.0, 10.0)
px, py = np.meshgrid(x, y)
heights = 5 + 0.04 * px + 60 * np.exp(-(((px - 120) / 70) ** 2) - ((py - 100) / 50) ** 2)

mountain = terrain(HeightGrid(x, y, heights), base_depth=20.0, interval=10.0)
middle = mountain.BoundingBox().center
site = cq.Workplane("XY", origin=(middle.x + 40.0, middle.y, 20.0))
pocket = cq.Workplane(mountain).cut(site.rect(40.0, 30.0).extrude(100.0))
building = site.rect(24.0, 14.0).extrude(9.0).faces(">Z").edges("|X").chamfer(5.0, 6.5)

reports = [check(part.val().wrapped, Tolerance(fit=0.01)).require() for part in (pocket, building)]
header = FileHeader(name="building site", unit=LengthUnit("M"))
write_outputs(pocket.val().wrapped, reports[0].triangles(), ["site.step"], header=header)
parts = [Part(report.triangles(), colour, smooth=False) for report, colour in zip(reports, (CLAY[0], MADE))]
draw(Path("site.png"), [View("the site", tuple(parts), (1.0, -1.0, 1.2))])
print(f"{mountain.Volume() - pocket.val().Volume():.0f} m³ to dig")
if "show_object" in globals():
    show_object(pocket, name="mountain"), show_object(building, name="building")  # noqa: F821
