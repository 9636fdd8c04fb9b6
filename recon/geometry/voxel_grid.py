"""Volumes on a regular grid: values as measured, and the binary grid of what is solid.

values[i, j, k]   value at the centre of voxel (i, j, k)
origin            place of the centre of voxel (0, 0, 0)
direction         (3, 3), column a is the unit vector along which index a grows

    place of (i, j, k) = origin + direction @ (spacing * (i, j, k))
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, BadOption
from recon.geometry.arrays import frozen_bools, frozen_floats, plain_array
from recon.geometry.mesh import TriangleMesh

__all__ = ["PlacedGrid", "Volume", "VoxelGrid", "binary_grid", "volume_labels"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class PlacedGrid:
    """Where the voxels of a grid lie."""

    spacing: Floats = field(default_factory=lambda: np.ones(3))
    origin: Floats = field(default_factory=lambda: np.zeros(3))
    direction: Floats = field(default_factory=lambda: np.eye(3))
    name: str = "volume"

    def _lock_place(self) -> None:
        for key, shape in (("spacing", (3,)), ("origin", (3,)), ("direction", (3, 3))):
            object.__setattr__(self, key, frozen_floats(getattr(self, key), shape, f"{self.name}: {key}"))
        if not (self.spacing > 0).all():
            raise BadGeometry(self.name, f"spacing {self.spacing.tolist()} must be positive")
        if np.abs(self.direction.T @ self.direction - np.eye(3)).max() > 1e-3:
            raise BadGeometry(self.name, "the directions of its axes are not at right angles")

    @property
    def voxel(self) -> float:
        """The length that is called one voxel: the smallest spacing."""
        return float(self.spacing.min())

    @property
    def proportions(self) -> Floats:
        """(3,) spacing in voxels: ones for cubes."""
        return np.asarray(self.spacing / self.voxel)

    def place(self, points: Floats) -> Floats:
        """Places in model units of points (n, 3) that are given in voxels along the grid's axes."""
        return np.asarray(self.origin + points * self.voxel @ self.direction.T)

    def placed(self, points: Floats, face_vertices: NDArray[np.int64]) -> TriangleMesh:
        """Mesh in model units of one in voxels; outside stays outside where the axes are left-handed."""
        left_handed = np.linalg.det(self.direction) < 0
        faces = face_vertices[:, ::-1] if left_handed else face_vertices
        return TriangleMesh(self.place(points), faces, self.name)


@dataclass(frozen=True, eq=False)
class Volume(PlacedGrid):
    """Values of a scan or a segmentation; values (X, Y, Z) of any number type.

    Raises  BadGeometry when there are not three axes, or the spacing or the directions make no grid.
    """

    values: NDArray[Any] = field(default_factory=lambda: np.zeros((0, 0, 0)))

    def __post_init__(self) -> None:
        values = plain_array(self.values, self.name)
        if values.ndim != 3 or 0 in values.shape:
            raise BadGeometry(self.name, f"has shape {values.shape} where a grid of three axes is needed")
        if values.dtype.kind not in "biuf":
            raise BadGeometry(self.name, f"holds values of type {values.dtype}, and numbers are needed")
        object.__setattr__(self, "values", values)
        self._lock_place()


@dataclass(frozen=True, eq=False)
class VoxelGrid(PlacedGrid):
    """Which voxels are solid; solid (X, Y, Z) bool, locked.

    Raises  BadGeometry as `Volume`, and when no voxel is solid, or every one.
    """

    solid: Bools = field(default_factory=lambda: np.zeros((0, 0, 0), dtype=bool))

    def __post_init__(self) -> None:
        solid = frozen_bools(self.solid, (None, None, None), self.name)
        if not solid.any():
            raise BadGeometry(self.name, "no voxel is solid; check the threshold or the label")
        if solid.all():
            raise BadGeometry(self.name, "every voxel is solid, so nothing bounds it; check the threshold or the label")
        object.__setattr__(self, "solid", solid)
        self._lock_place()

    def with_solid(self, solid: Bools) -> "VoxelGrid":
        """The same grid with other solid voxels."""
        return VoxelGrid(self.spacing, self.origin, self.direction, self.name, solid)


def volume_labels(volume: Volume) -> NDArray[Any]:
    """The values other than zero that a labelled volume holds, in order."""
    labels = np.unique(volume.values)
    return labels[labels != 0]


def binary_grid(volume: Volume, *, threshold: float | None = None, label: float | None = None) -> VoxelGrid:
    """The solid voxels of a volume: those at or above a threshold, those of a label, or those of a binary volume.

    Raises  BadOption when both are given, when the volume has more than two values and neither is, or when no voxel has
            the label; BadGeometry when no voxel is solid, or every one.
    """
    values = volume.values
    if threshold is not None and label is not None:
        raise BadOption("--label", "give a threshold or a label, not both")
    if threshold is not None:
        solid = values >= threshold
    elif label is not None:
        solid = values == label
        if not solid.any():
            raise BadOption("--label", f"no voxel of {volume.name} has the label {label:g}")
    else:
        low, high = values.min(), values.max()
        solid = values == high if low != high else values != 0
        if not (solid | (values == low)).all():
            raise BadOption(
                "--threshold",
                f"{volume.name} is not binary, its values run from {low:g} to {high:g};"
                " say from which value on a voxel is solid, or which --label is",
            )
    return VoxelGrid(volume.spacing, volume.origin, volume.direction, volume.name, solid)
