"""The missing piece of a vessel gets a pin, which holds it in a hole drilled into its neighbour."""

from pathlib import Path

import cadquery as cq

from brep_export.app.extension import patch
from brep_export.app.pictures import draw, views_around
from brep_export.check import check
from brep_export.repair import repair
from recon import Tolerance
from recon.hole_patch.sample_vessel import broken_vessel

vessel = broken_vessel()
piece = patch(vessel.sherds)

fractures = sorted(piece.Faces(), key=lambda face: face.Area())[:-2]  # all but the outer and the inner wall
points, triangles = max(fractures, key=lambda face: face.Area()).tessellate(0.1)
corners = [[points[i] for i in triangle] for triangle in triangles]
middle = sum(points, cq.Vector()) / len(points)
a, b, c = min(corners, key=lambda corner: (sum(corner, cq.Vector()) / 3 - middle).Length)
outward = (b - a).cross(c - a).normalized()
pin = cq.Solid.makeCylinder(0.6, 6.0, (a + b + c) / 3 - 2.0 * outward, outward)
pinned = cq.Workplane(piece).union(cq.Workplane(pin))
tolerance = Tolerance(fit=0.05)
mended, changes = repair(pinned.val().wrapped, tolerance)  # the kernel's union forgets how wide some edges are

report = check(mended, tolerance).require()
cq.exporters.export(cq.Workplane(cq.Shape.cast(mended)), "pinned.step")
draw(Path("pinned.png"), views_around(report.triangles()))
print(f"{report.measures.solids} solid of {report.measures.volume:.0f} mm³; mended: {', '.join(map(str, changes))}")
if "show_object" in globals():
    show_object(cq.Shape.cast(mended), name="pinned piece")  # noqa: F821
