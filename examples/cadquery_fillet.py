"""A bracket known as voxels alone gets its true faces back, and then what only true faces allow: fillets and a hole."""

from pathlib import Path

import cadquery as cq
import numpy as np

from brep_export.app.extension import voxels
from brep_export.app.pictures import draw, views_around
from brep_export.check import check
from recon import Tolerance

axis = np.arange(80) + 0.5
x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
foot = (x > 10) & (x < 70) & (y > 15) & (y < 65) & (z > 10) & (z < 25)
wall = (x > 10) & (x < 25) & (y > 15) & (y < 65) & (z > 10) & (z < 70)
drilled = (x - 50) ** 2 + (y - 40) ** 2 < 8**2

bracket = voxels((foot | wall) & ~drilled, analytic=True, snap=0.5, spacing=0.5)
part = cq.Workplane(bracket).edges("|Y").edges(cq.selectors.NearestToPointSelector((12.5, 20.0, 12.5))).fillet(4.0)
part = part.faces("<X").workplane(centerOption="CenterOfBoundBox").center(0.0, 6.0).hole(5.0)

report = check(part.val().wrapped, Tolerance(fit=0.01)).require()
cq.exporters.export(part, "bracket.step")
draw(Path("bracket.png"), views_around(report.triangles()))
print(f"{len(bracket.Faces())} true faces, {len(part.faces().vals())} with the fillet and the hole")
if "show_object" in globals():
    show_object(part, name="bracket")  # noqa: F821
