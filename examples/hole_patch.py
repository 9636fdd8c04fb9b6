"""The missing piece of a vessel: make one, break it, rebuild the lost sherd, write it as STEP with a picture."""

from pathlib import Path

from brep_export.app.pictures import draw, vessel_views
from brep_export.check import check
from brep_export.outputs import write_outputs
from brep_export.solids import thick_solid
from recon import Tolerance, patch_hole
from recon.hole_patch.sample_vessel import broken_vessel

vessel = broken_vessel()
piece = patch_hole(vessel.sherds)

tolerance = Tolerance(fit=0.05)
solid = thick_solid(piece.shape, tolerance)
report = check(solid, tolerance).require()

write_outputs(solid, report.triangles(), ["piece.step", "piece.stl"])
draw(Path("piece.png"), vessel_views(vessel.sherds, report.triangles()))
print(f"closed solid of {report.measures.volume:.0f} mm³; the lost sherd had {vessel.lost.volume():.0f} mm³")
