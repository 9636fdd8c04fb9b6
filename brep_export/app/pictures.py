"""Pictures of results, rendered off screen, all in one style: what was measured in clay, what was made in blue.

Free edges are red, so that an open shell shows at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyvista
from numpy.typing import NDArray

from recon.errors import NotWritten
from recon.geometry.mesh import TriangleMesh

__all__ = ["CLAY", "MADE", "Mark", "Part", "View", "colours_of", "draw", "vessel_views", "views_around"]

Floats = NDArray[np.float64]

CLAY = ("#c8a27c", "#b98d66", "#d3b18c", "#ad8058", "#bf9871")
MADE = "#3b7dd8"
COLOURS = "viridis"  # dark where little is unknown; even in lightness, and for those who see few colours
FREE_EDGE = "#d62020"
_PANEL = (720, 720)


@dataclass(frozen=True)
class Part:
    """One mesh of a picture, in one colour; `lines` are polylines (n, 3) drawn in red.

    values  (V,) numbers of the vertices, shown by colours in place of the one, up to their 99th percentile; or None
    scale   what the numbers are, with their unit, for the bar that says which colour is which
    """

    mesh: TriangleMesh
    colour: str
    smooth: bool = True
    lines: tuple[Floats, ...] = field(default=())
    values: Floats | None = None
    scale: str = ""


@dataclass(frozen=True)
class Mark:
    """A closed line (n, 3) of a picture with a word at its middle, both in one colour."""

    line: Floats
    text: str
    colour: str


@dataclass(frozen=True)
class View:
    """One panel of a picture: its parts, the direction from which they are seen, and what is up."""

    title: str
    parts: tuple[Part, ...]
    toward: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    marks: tuple[Mark, ...] = field(default=())


def draw(path: Path, views: Sequence[View]) -> None:
    """Render the views side by side into a PNG file.

    Raises  NotWritten when nothing was rendered.
    """
    width, height = _PANEL
    plotter = pyvista.Plotter(
        off_screen=True, shape=(1, len(views)), window_size=(width * len(views), height), border=False
    )
    for column, view in enumerate(views):
        plotter.subplot(0, column)
        plotter.set_background("white", top="#dfe7ee")
        for part in view.parts:
            _add(plotter, part)
        for mark in view.marks:
            _add_mark(plotter, mark)
        plotter.add_text(view.title, position="lower_left", font_size=11, color="#333333")
        _aim(plotter, view)
    plotter.enable_anti_aliasing("ssaa")
    plotter.screenshot(str(path))
    plotter.close()
    if not path.is_file() or path.stat().st_size == 0:
        raise NotWritten(str(path), "the renderer made no picture")


def vessel_views(
    sherds: Sequence[TriangleMesh],
    piece: TriangleMesh,
    lines: Sequence[Floats] = (),
    expected: Floats | None = None,
) -> tuple[View, ...]:
    """The vessel open, the piece in place, the piece alone from its side, and what of it is invented.

    expected  (V,) error in millimetres that is to be expected at the piece's vertices, or None for no such panel
    """
    clay = tuple(Part(mesh, CLAY[i % len(CLAY)], smooth=False) for i, mesh in enumerate(sherds))
    made = Part(piece, MADE, lines=tuple(lines))
    centre = np.concatenate([mesh.vertices for mesh in sherds]).mean(axis=0)
    outward, up = _outward(piece, centre)
    beside = np.cross(up, outward) + 0.15 * outward + 0.2 * up
    views = (
        View("before", clay, _direction(outward + 0.35 * up), _direction(up)),
        View("the piece in place", (*clay, made), _direction(outward + 0.35 * up), _direction(up)),
        View("the piece from its side", (made,), _direction(beside), _direction(up)),
    )
    if expected is None:
        return views
    marked = Part(piece, MADE, values=expected, scale="expected error, mm")
    return (*views, View("what is invented", (marked,), _direction(outward + 0.35 * up), _direction(up)))


def colours_of(values: Floats) -> NDArray[np.uint8]:
    """(V, 4) red, green, blue and opacity of numbers (V,), as the pictures show them."""
    from matplotlib import colormaps

    low, high = _limits(values)
    return np.asarray(colormaps[COLOURS](np.clip((values - low) / (high - low), 0.0, 1.0), bytes=True), dtype=np.uint8)


def _limits(values: Floats) -> tuple[float, float]:
    return 0.0, max(float(np.quantile(values, 0.99)), 1e-300)


def views_around(mesh: TriangleMesh, lines: Sequence[Floats] = ()) -> tuple[View, ...]:
    """A shape from three corners, its free edges in red."""
    part = Part(mesh, MADE, smooth=False, lines=tuple(lines))
    return tuple(
        View(title, (part,), toward)
        for title, toward in (
            ("front", (1.0, -1.6, 0.9)),
            ("back", (-1.6, 1.0, 0.9)),
            ("from below", (1.0, -0.8, -1.6)),
        )
    )


def _outward(piece: TriangleMesh, centre: Floats) -> tuple[Floats, Floats]:
    """Unit direction from the vessel to the piece, and the vessel's up: the coordinate axis most across it."""
    away = piece.vertices.mean(axis=0) - centre
    up = np.eye(3)[2] if abs(away[2]) < 0.9 * np.linalg.norm(away) else np.eye(3)[1]
    outward = away - away @ up * up
    return outward / max(float(np.linalg.norm(outward)), 1e-12), up


def _direction(vector: Floats) -> tuple[float, float, float]:
    x, y, z = (float(c) for c in vector)
    return x, y, z


def _add(plotter: pyvista.Plotter, part: Part) -> None:
    counts = np.full((part.mesh.n_faces, 1), 3)
    surface = pyvista.PolyData(part.mesh.vertices, np.hstack([counts, part.mesh.face_vertices]).ravel())
    shown: dict[str, Any] = {"color": part.colour}
    if part.values is not None:
        shown = {"scalars": part.values, "cmap": COLOURS, "clim": _limits(part.values), "show_scalar_bar": True}
        shown["scalar_bar_args"] = {"title": part.scale, "color": "#333333", "fmt": "%.2g", "n_labels": 4}
    plotter.add_mesh(
        surface,
        **shown,
        smooth_shading=part.smooth,
        split_sharp_edges=part.smooth,
        specular=0.15,
        specular_power=12,
    )
    for line in part.lines:
        plotter.add_mesh(pyvista.lines_from_points(line), color=FREE_EDGE, line_width=4)


def _add_mark(plotter: pyvista.Plotter, mark: Mark) -> None:
    plotter.add_mesh(pyvista.lines_from_points(mark.line, close=True), color=mark.colour, line_width=6)
    plotter.add_point_labels(
        mark.line.mean(axis=0)[None],
        [mark.text],
        font_size=34,
        bold=True,
        text_color=mark.colour,
        shape_color="white",
        shape_opacity=0.85,
        show_points=False,
        always_visible=True,
    )


def _aim(plotter: pyvista.Plotter, view: View) -> None:
    points = np.concatenate([part.mesh.vertices for part in view.parts])
    low, high = points.min(axis=0), points.max(axis=0)
    centre, reach = (low + high) / 2, float(np.linalg.norm(high - low))
    toward = np.array(view.toward) / np.linalg.norm(view.toward)
    plotter.camera_position = [tuple(centre + 1.9 * reach * toward), tuple(centre), view.up]
    plotter.camera.view_angle = 30.0
    plotter.reset_camera_clipping_range()
