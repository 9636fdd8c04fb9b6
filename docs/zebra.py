"""Zebra stripes on the faces of a limit surface: where tangent planes agree, no stripe breaks at an edge.

Lights in long rows are mirrored in the surface; a stripe is where the mirrored ray goes. Stripes are drawn from each
face's own normals, so a break of the tangent plane would show as a step.
"""

from pathlib import Path

import numpy as np
import pyvista
from numpy.typing import NDArray

from recon.geometry.bspline import BSplineSurface
from recon.geometry.control_mesh import ControlMesh
from recon.subdivision.limit_faces import limit_faces
from recon.subdivision.limit_surface import Scheme

Floats = NDArray[np.float64]

TOWARD = np.array([0.45, -0.8, 0.55])
STRIPES, SAMPLES = 9.0, 40  # over half a turn of the mirrored ray, and samples a unit span
CUBES = np.array([[1, 1, 1, 1, 1], [1, 0, 1, 0, 1], [1, 1, 1, 1, 1]])  # two openings
TOWERS = [(0, 0), (2, 4), (1, 2)]  # cubes that stand on others


def cubes() -> ControlMesh:
    """The boundary of some cubes: vertices with three to six faces, two handles."""
    solid = np.zeros((2, *CUBES.shape), dtype=bool)
    solid[0] = CUBES
    solid[(1, *np.array(TOWERS).T)] = solid[0][tuple(np.array(TOWERS).T)]
    padded = np.pad(solid, 1)
    corners: dict[tuple[int, ...], int] = {}
    quads: list[list[tuple[int, ...]]] = []
    for axis in range(3):
        along = np.eye(3, dtype=int)[[axis, (axis + 1) % 3, (axis + 2) % 3]]
        for cell in np.argwhere(padded & ~np.roll(padded, -1, axis)):
            quads.append(
                [tuple(cell + along[0] + a * along[1] + b * along[2]) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
            )
        for cell in np.argwhere(padded & ~np.roll(padded, 1, axis)):
            quads.append([tuple(cell + a * along[1] + b * along[2]) for a, b in ((0, 0), (0, 1), (1, 1), (1, 0))])
    faces = [[corners.setdefault(point, len(corners)) for point in quad] for quad in quads]
    points = np.array(list(corners))[:, ::-1] * 1.0
    return ControlMesh.from_faces(points, np.array(faces)[:, ::-1])


def sampled(patch: BSplineSurface) -> tuple[pyvista.StructuredGrid, Floats]:
    """A face as a grid of points, and how far round the ray that it mirrors toward the eye goes."""
    u, v = (np.linspace(*ends, round(SAMPLES * (ends[1] - ends[0])) + 1) for ends in patch.domain)
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    normal = np.cross(patch.derivative(uv, 1, 0), patch.derivative(uv, 0, 1))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    eye = TOWARD / np.linalg.norm(TOWARD)
    mirrored = 2.0 * (normal @ eye)[:, None] * normal - eye
    x, y, z = patch.point(uv).reshape(len(u), len(v), 3).transpose(2, 0, 1)
    grid = pyvista.StructuredGrid(x, y, z)
    return grid, np.arccos(np.clip(mirrored[:, 2], -1.0, 1.0)).reshape(len(u), len(v)).ravel(order="F")


def draw_zebra(path: Path) -> None:
    """The faces, each in a grey of its own, and the stripes over them."""
    faces = limit_faces(cubes(), Scheme.CATMULL_CLARK).mosaic.patches
    plotter = pyvista.Plotter(off_screen=True, shape=(1, 2), window_size=(1800, 560), border=False)
    plotter.set_background("white")
    for number, patch in enumerate(faces):
        grid, turn = sampled(patch)
        plotter.subplot(0, 0)
        grey = 0.55 + 0.4 * (number * 0.618 % 1.0)
        plotter.add_mesh(grid.extract_surface(algorithm=None), color=(grey, grey, 0.95), smooth_shading=True)
        plotter.add_mesh(_outline(grid), color="black", line_width=2)
        plotter.subplot(0, 1)
        grid["dark"] = np.clip(0.5 + 6.0 * np.sin(STRIPES * turn), 0.0, 1.0)
        plotter.add_mesh(
            grid.extract_surface(algorithm=None), scalars="dark", cmap="gray", lighting=False, show_scalar_bar=False
        )
    for number in range(2):
        plotter.subplot(0, number)
        plotter.camera.position = TOWARD
        plotter.camera.focal_point = (0.0, 0.0, 0.0)
        plotter.camera.up = (0.0, 0.0, 1.0)
        plotter.reset_camera()
        plotter.camera.zoom(1.35)
    plotter.screenshot(path)
    plotter.close()


def _outline(grid: pyvista.StructuredGrid) -> pyvista.PolyData:
    x, y, z = grid.x[:, :, 0], grid.y[:, :, 0], grid.z[:, :, 0]
    ring = [np.concatenate([a[:, 0], a[-1, 1:], a[-2::-1, -1], a[0, -2::-1]]) for a in (x, y, z)]
    return pyvista.lines_from_points(np.column_stack(ring))
