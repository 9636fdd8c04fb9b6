"""Three views to every solid they can mean: a puzzle with six answers, each as STEP, the first with a picture."""

from pathlib import Path

import numpy as np

from brep_export.app.pictures import draw, views_around
from brep_export.check import check
from brep_export.outputs import write_outputs
from brep_export.solids import polyhedron_solid
from recon import DrawnView, ThreeViews, Tolerance, all_polyhedra

square = [[0, 0, 40, 0], [40, 0, 40, 40], [40, 40, 0, 40], [0, 40, 0, 0]]


def view(*diagonals: list[int]) -> DrawnView:
    segments = np.array([*square, *diagonals], dtype=float).reshape(-1, 2, 2)
    return DrawnView(segments, np.zeros(len(segments), dtype=bool))


drawing = ThreeViews(front=view([0, 40, 40, 0]), top=view([0, 0, 40, 40]), side=view([0, 0, 40, 40]))

for number, polyhedron in enumerate(all_polyhedra(drawing), start=1):
    solid = polyhedron_solid(polyhedron)
    report = check(solid, Tolerance()).require()
    write_outputs(solid, report.triangles(), [f"solid_{number}.step"])
    print(f"solid {number}: {len(polyhedron.faces)} faces, {report.measures.volume:.0f} mm³")
    if number == 1:
        draw(Path("solid.png"), views_around(report.triangles()))
