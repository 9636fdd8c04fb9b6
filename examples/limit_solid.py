"""A control mesh to a CAD solid: exact spline faces, smooth caps around irregular vertices, one STEP file out."""

from pathlib import Path

import numpy as np

from brep_export.app.pictures import CLAY, MADE, Part, View, draw
from brep_export.check import check
from brep_export.file_header import FileHeader
from brep_export.mosaics import mosaic_shape
from brep_export.step import write_step
from recon.geometry.control_mesh import ControlMesh
from recon.subdivision.limit_faces import limit_faces
from recon.subdivision.limit_surface import Scheme
from recon.tolerance import Tolerance

# an L of three cubes, its faces as quadrilaterals: vertices with three, four and five faces
points = np.array(
    [[x, y, z] for z in (0, 1) for x, y in [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (0, 2), (1, 2)]]
)
plan = [[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6]]
rim = [0, 1, 2, 5, 4, 7, 6, 3]
floor = [face[::-1] for face in plan]
roof = [[v + 8 for v in face] for face in plan]
walls = [[a, b, b + 8, a + 8] for a, b in zip(rim, rim[1:] + rim[:1])]
mesh = ControlMesh.from_faces(points, floor + roof + walls)

tolerance = Tolerance(merge=1e-7, fit=1e-5)
faces = limit_faces(mesh, Scheme.CATMULL_CLARK)
solid = mosaic_shape(faces.mosaic, tolerance)
report = check(solid, tolerance).require()
write_step(solid, "limit_solid.step", header=FileHeader(name="limit solid"))
views = ("control mesh", Part(mesh.triangle_mesh(), CLAY[0], smooth=False)), ("solid", Part(report.triangles(), MADE))
draw(Path("limit_solid.png"), tuple(View(name, (part,), (1, -2, 1)) for name, part in views))
print(f"{len(faces.mosaic.patches)} faces, {faces.n_exact} exact, volume {report.measures.volume:.6f}")
