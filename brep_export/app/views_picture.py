"""Pictures of what a drawing can mean: the three views on the left, the solids beside them."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyvista
from numpy.typing import NDArray

from brep_export.app.pictures import MADE
from recon.errors import NotWritten
from recon.geometry.mesh import TriangleMesh
from recon.geometry.polyhedron import Polyhedron
from recon.geometry.views import DrawnView, ThreeViews

__all__ = ["draw_solids"]

Floats = NDArray[np.float64]

SHOWN = 7  # solids in one picture
PANEL = 480
TOWARD = np.array([1.0, -1.6, 0.9])
DASHES = 60  # dashes along the sheet's longest side


def draw_solids(path: Path, drawing: ThreeViews, solids: Sequence[tuple[Polyhedron, TriangleMesh]]) -> None:
    """Render the drawing and the first few solids, given with their triangles, into a PNG file.

    Raises  NotWritten when nothing was rendered.
    """
    shown = list(solids[:SHOWN])
    columns = min(len(shown) + 1, 4)
    rows = -(-(len(shown) + 1) // columns)
    plotter = pyvista.Plotter(
        off_screen=True, shape=(rows, columns), window_size=(PANEL * columns, PANEL * rows), border=False
    )
    for place in np.ndindex(rows, columns):
        plotter.subplot(*place)
        plotter.set_background("white")
        number = place[0] * columns + place[1]
        if number == 0:
            _add_drawing(plotter, drawing)
        elif number <= len(shown):
            _add_solid(plotter, *shown[number - 1])
            plotter.add_text(f"{number}", position="lower_left", font_size=11, color="#333333")
    plotter.enable_anti_aliasing("ssaa")
    plotter.screenshot(str(path))
    plotter.close()
    if not path.is_file() or path.stat().st_size == 0:
        raise NotWritten(str(path), "the renderer made no picture")


def _add_drawing(plotter: pyvista.Plotter, drawing: ThreeViews) -> None:
    """The views as on a sheet in third angle."""
    size = drawing.extent()
    corner = {p.name: v.segments.reshape(-1, 2).min(axis=0) for p, v in drawing}
    reach = {p.name: np.ptp(v.segments.reshape(-1, 2), axis=0) for p, v in drawing}
    moved = {
        "front": np.zeros(2),
        "top": np.array([0.0, reach["front"][1] + 0.2 * size]),
        "side": np.array([reach["front"][0] + 0.2 * size, 0.0]),
    }
    points = []
    for projection, view in drawing:
        for piece, width in _strokes(view, size / DASHES):
            flat = np.column_stack([piece - corner[projection.name] + moved[projection.name], np.zeros(2)])
            plotter.add_mesh(pyvista.lines_from_points(flat), color="black", line_width=width)
            points.append(flat)
    low, high = np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)
    centre = (low + high) / 2
    plotter.camera_position = [(*centre[:2], 10 * size), tuple(centre), (0.0, 1.0, 0.0)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.55 * float(max(high - low))


def _strokes(view: DrawnView, dash: float) -> Iterator[tuple[Floats, float]]:
    """Lines drawn through as they are, hidden ones as dashes; with their widths."""
    for ends, hidden in zip(view.segments, view.hidden):
        if not hidden:
            yield ends, 3.0
            continue
        pieces = max(1, round(float(np.linalg.norm(ends[1] - ends[0])) / dash / 2))
        for k in range(pieces):
            share = np.array([[k + 0.2], [k + 0.8]]) / pieces
            yield ends[0] + share * (ends[1] - ends[0]), 1.5


def _add_solid(plotter: pyvista.Plotter, solid: Polyhedron, mesh: TriangleMesh) -> None:
    counts = np.full((mesh.n_faces, 1), 3)
    plotter.add_mesh(
        pyvista.PolyData(mesh.vertices, np.hstack([counts, mesh.face_vertices]).ravel()), color=MADE, specular=0.1
    )
    for face in solid.faces:
        for loop in face.loops:
            ring = solid.vertices[[*loop, loop[0]]]
            plotter.add_mesh(pyvista.lines_from_points(ring), color="black", line_width=2)
    low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
    centre, reach = (low + high) / 2, float(np.linalg.norm(high - low))
    away = TOWARD / np.linalg.norm(TOWARD)
    plotter.camera_position = [tuple(centre + 2.2 * reach * away), tuple(centre), (0.0, 0.0, 1.0)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.55 * reach
    plotter.reset_camera_clipping_range()
