"""Volumes that need not be in memory: their axes are known, their values are read by windows.

low     o o o o o      a window holds the voxels from `low` to below `stop`; of a solid source it may reach
        o o o o o      beyond the grid, and what lies there is empty
                 stop
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, BadOption
from recon.geometry.arrays import frozen_ints
from recon.geometry.voxel_grid import PlacedGrid, Volume, VoxelGrid

__all__ = ["SolidSource", "VolumeSource", "Window", "solid_source", "source_labels"]

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Window = tuple[slice, slice, slice]

LOOKED_THROUGH = 256  # voxels along each axis that are looked through at once


@dataclass(frozen=True, eq=False)
class VolumeSource(PlacedGrid):
    """Where the values of a volume come from.

    shape  voxels along each axis
    read   gives the values of a window
    is_windowed  whether they come from a file each time, so that the source is light and may travel to other machines
    Raises  BadGeometry as a `Volume`.
    """

    shape: tuple[int, int, int] = (0, 0, 0)
    read: Callable[[Window], NDArray[Any]] = field(default=lambda window: np.zeros((0, 0, 0)))
    is_windowed: bool = False

    def __post_init__(self) -> None:
        shape = frozen_ints(self.shape, (3,), f"{self.name}: shape")
        if shape.min() < 1:
            raise BadGeometry(self.name, f"has shape {tuple(shape.tolist())} where a grid of three axes is needed")
        object.__setattr__(self, "shape", tuple(shape.tolist()))
        self._lock_place()

    @classmethod
    def of(cls, volume: Volume) -> "VolumeSource":
        """A volume that is in memory."""
        shape = tuple(volume.values.shape)
        return cls(volume.spacing, volume.origin, volume.direction, volume.name, shape, volume.values.__getitem__)


@dataclass(frozen=True, eq=False)
class SolidSource(PlacedGrid):
    """Which voxels are solid: those whose value is `value`, or, where `from_on`, at least that."""

    source: VolumeSource = field(default_factory=lambda: VolumeSource(shape=(1, 1, 1)))
    value: float = 1.0
    from_on: bool = False

    @property
    def shape(self) -> tuple[int, int, int]:
        return self.source.shape

    def window(self, low: Ints, stop: Ints) -> Bools:
        """Solid voxels from `low` (3,) to below `stop` (3,), either of which may lie beyond the grid."""
        inner = [slice(max(int(a), 0), min(int(b), n)) for a, b, n in zip(low, stop, self.shape)]
        solid = np.zeros(np.asarray(stop) - low, dtype=bool)
        if all(part.start < part.stop for part in inner):
            values = self.source.read((inner[0], inner[1], inner[2]))
            there = tuple(slice(part.start - int(a), part.stop - int(a)) for part, a in zip(inner, low))
            solid[there] = values >= self.value if self.from_on else values == self.value
        return solid

    def whole(self) -> VoxelGrid:
        """The grid in memory; raises BadGeometry when no voxel is solid, or every one."""
        solid = self.window(np.zeros(3, dtype=np.int64), np.array(self.shape))
        return VoxelGrid(self.spacing, self.origin, self.direction, self.name, solid)


def solid_source(source: VolumeSource, *, threshold: float | None = None, label: float | None = None) -> SolidSource:
    """The solid voxels of a volume, told as `binary_grid` tells them; where neither is given its values are read once.

    Raises  BadOption when both are given, or neither and the volume has more than two values.
    """
    if threshold is not None and label is not None:
        raise BadOption("--label", "give a threshold or a label, not both")
    value, from_on = (threshold, True) if threshold is not None else (label, False)
    if value is None:
        low, high = _two_values(source)
        value, from_on = (high, False) if low != high or high != 0 else (1.0, False)
    return SolidSource(source.spacing, source.origin, source.direction, source.name, source, float(value), from_on)


def source_labels(source: VolumeSource) -> list[float]:
    """The values other than zero that a labelled volume holds, in order."""
    found: set[float] = set()
    for window in _windows(source.shape):
        found |= set(np.unique(source.read(window)).tolist())
    return sorted(found - {0})


def _two_values(source: VolumeSource) -> tuple[float, float]:
    """The lower and the higher value of a binary volume."""
    ends: set[float] = set()
    binary = True
    for window in _windows(source.shape):
        values = source.read(window)
        low, high = values.min(), values.max()
        ends |= {float(low), float(high)}
        binary = binary and bool(((values == low) | (values == high)).all())
    if len(ends) > 2 or not binary:
        raise BadOption(
            "--threshold",
            f"{source.name} is not binary, its values run from {min(ends):g} to {max(ends):g};"
            " say from which value on a voxel is solid, or which --label is",
        )
    return min(ends), max(ends)


def _windows(shape: tuple[int, int, int]) -> list[Window]:
    spans = [[slice(a, min(a + LOOKED_THROUGH, n)) for a in range(0, n, LOOKED_THROUGH)] for n in shape]
    return list(product(*spans))
