"""A scan becomes a solid with a hexagonal socket in its top, for a screw head or a stand."""

from pathlib import Path

import cadquery as cq
import numpy as np
from scipy.spatial import ConvexHull

from brep_export.app.extension import fit
from brep_export.app.pictures import draw, views_around
from brep_export.check import check
from recon import Tolerance

rng = np.random.default_rng(1)
unit = rng.normal(size=(3000, 3))
unit /= np.linalg.norm(unit, axis=1, keepdims=True)
faces = ConvexHull(unit).simplices
normals = np.cross(unit[faces[:, 1]] - unit[faces[:, 0]], unit[faces[:, 2]] - unit[faces[:, 0]])
inward = np.einsum("ij,ij->i", normals, unit[faces[:, 0]]) < 0
faces[inward] = faces[inward][:, ::-1]
scan = (unit * [20.0, 15.0, 12.0] * (1.0 + 0.05 * np.sin(3.0 * unit[:, :1])), faces)

solid = fit(scan)
top = solid.BoundingBox().zmax
part = cq.Workplane(solid).cut(cq.Workplane().workplane(offset=top - 8.0).polygon(6, 9.0).extrude(20.0))

report = check(part.val().wrapped, Tolerance(fit=0.05)).require()
cq.exporters.export(part, "socket.step")
draw(Path("socket.png"), views_around(report.triangles()))
print(f"{len(solid.Faces())} smooth faces before, {report.measures.faces} with the socket")
if "show_object" in globals():
    show_object(part, name="pebble with a socket")  # noqa: F821
