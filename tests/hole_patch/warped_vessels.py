"""Broken vessels that are not, or not wholly, round: a made vessel whose space is bent."""

from collections.abc import Callable, Sequence
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.sample_vessel import VesselOptions, _profile

Floats = NDArray[np.float64]
Map = Callable[[Floats], Floats]


def warped(meshes: Sequence[TriangleMesh], bend: Map) -> list[TriangleMesh]:
    return [TriangleMesh(bend(mesh.vertices), mesh.face_vertices, mesh.name) for mesh in meshes]


def squashed(share: float) -> Map:
    """An ellipse whose axes differ by a share of their mean."""
    return lambda v: np.asarray(v * [1 + share / 2, 1 - share / 2, 1])


def three_sided(share: float) -> Map:
    """Radii that swell and shrink by a share three times around the turn."""
    return lambda v: _swollen(v, 1 + share * np.cos(3 * np.arctan2(v[:, 1], v[:, 0])))


def squared(power: float) -> Map:
    """|x|^p + |y|^p in place of x² + y²."""

    def bend(v: Floats) -> Floats:
        angle = np.arctan2(v[:, 1], v[:, 0])
        return _swollen(v, (np.abs(np.cos(angle)) ** power + np.abs(np.sin(angle)) ** power) ** (-1 / power))

    return bend


def spouted(v: Floats) -> Floats:
    """A spout drawn out of the wall around θ = 0, at 45 mm."""
    bulge = np.exp(-((np.arctan2(v[:, 1], v[:, 0]) / 0.4) ** 2) - ((v[:, 2] - 45) / 14) ** 2)
    return _swollen(v, 1 + 0.5 * bulge)


class Side(Enum):
    """Of the wall that swells; between its two sides the fracture goes from one to the other."""

    OUTER = 0
    INNER = 1
    BOTH = 2


def swollen(
    sherd: TriangleMesh, options: VesselOptions, place: Floats, *, outward: float, wide: float, on: Side
) -> TriangleMesh:
    """A sherd of a made vessel with a side of its wall moved away from the axis around a place."""
    vertices = sherd.vertices.copy()
    section = np.stack([np.hypot(vertices[:, 0], vertices[:, 1]), vertices[:, 2]], axis=1)
    off = outward * np.exp(-(((vertices - place) ** 2).sum(axis=1) / wide**2))
    if on is not Side.BOTH:
        away = [cKDTree(side).query(section)[0] for side in _profile(options)]
        off = off * away[1 - on.value] / (away[0] + away[1])
    vertices[:, :2] *= (1.0 + off / section[:, 0])[:, None]
    return TriangleMesh(vertices, sherd.face_vertices, sherd.name)


def _swollen(v: Floats, share: Floats) -> Floats:
    return np.column_stack([v[:, :2] * share[:, None], v[:, 2]])
