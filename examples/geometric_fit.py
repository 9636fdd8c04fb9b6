"""A scan to a subdivision surface: make one, fit a control mesh, write its limit surface as STEP with a picture."""

from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from brep_export.app.pictures import CLAY, MADE, Part, View, draw
from brep_export.check import check
from brep_export.control_mesh_files import write_control_mesh
from brep_export.outputs import write_outputs
from brep_export.solids import network_solid
from recon import Tolerance
from recon.geometric_fit.options import FitOptions
from recon.geometric_fit.pipeline import fit_surface
from recon.geometry.mesh import TriangleMesh
from recon.subdivision.limit_surface import limit_patches, tessellate
from recon.subdivision.patch_network import limit_network

rng = np.random.default_rng(1)
unit = rng.normal(size=(4000, 3))
unit /= np.linalg.norm(unit, axis=1, keepdims=True)
faces = ConvexHull(unit).simplices
outward = np.einsum("ij,ij->i", np.cross(*(unit[faces[:, k]] - unit[faces[:, 0]] for k in (1, 2))), unit[faces[:, 0]])
faces[outward < 0] = faces[outward < 0][:, ::-1]
height = 1.0 + 0.08 * np.sin(3.0 * unit[:, :1]) * np.cos(2.0 * unit[:, 1:2])
scan = TriangleMesh(20.0 * unit * height, faces.astype(np.int64), "pebble")

fit = fit_surface(scan, FitOptions(control_points=60))
network, _ = limit_network(fit.mesh, limit_patches(fit.mesh))
tolerance = Tolerance(fit=0.01)
solid = network_solid(network, tolerance)
report = check(solid, tolerance).require()

write_control_mesh(fit.mesh, "pebble.obj", scheme=str(fit.scheme))
write_outputs(solid, report.triangles(), ["pebble.step"])
meshes = ((scan, CLAY[0]), (fit.mesh.triangle_mesh(), MADE), (tessellate(fit.mesh), MADE))
views = zip(("scan", "control mesh", "limit surface"), meshes)
draw(Path("pebble.png"), tuple(View(name, (Part(*part, smooth=False),), (1, -2, 1)) for name, part in views))
print(f"{fit.mesh.n_vertices} control points: rms {fit.errors.rms:.3f} %, at most {fit.errors.maximum:.3f} % off")
