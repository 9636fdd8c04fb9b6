"""Volumes from files window by window, where the file lets a part be read alone: raw numbers, and TIFF stacks.

Numpy arrays, and NRRD, MetaImage and NIfTI whose numbers are neither packed nor scaled, are mapped for as long as a
window is copied, so that no page of them stays.  Of a TIFF stack the pages of the window are read.  All others are read
as a whole.
"""

import mmap
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import UnreadableFile
from recon.geometry.volume_source import VolumeSource, Window
from recon.geometry.voxel_grid import Volume
from recon.readers.content import mapped_bytes, require_plain_file
from recon.readers.volume_headers import read_metaimage, read_nifti, read_nrrd
from recon.readers.volumes import (
    Floats,
    page_numbers,
    read_volume,
    require_pages,
    told_of,
    volume_ending,
    with_spacing,
)

__all__ = ["open_volume", "volume_shape"]

_MAPPED = {".nrrd": read_nrrd, ".nhdr": read_nrrd, ".nii": read_nifti, ".mha": read_metaimage, ".mhd": read_metaimage}


def open_volume(path: str | Path, *, spacing: Floats | None = None) -> VolumeSource:
    """Volume of a file, or of a folder with one DICOM series, read window by window where its format allows.

    spacing  (3,) in model units, in place of what the file says
    Raises   as `read_volume`; UnreadableFile for a faulty part once that is read.
    """
    file = Path(path)
    ending = "" if file.is_dir() else volume_ending(file)
    if ending in (".tif", ".tiff"):
        require_plain_file(file)
        source = VolumeSource(name=file.name, shape=told_of(_stack_shape, file), read=_Pages(file), is_windowed=True)
        return with_spacing(source, spacing)
    if ending == ".npy" or ending in _MAPPED:
        require_plain_file(file)
        volume = with_spacing(told_of(_mapped, file), spacing)
        if _is_mapped(volume.values):
            return replace(VolumeSource.of(volume), read=_Mapped(file), is_windowed=True)
        return VolumeSource.of(volume)
    return VolumeSource.of(read_volume(path, spacing=spacing))


def volume_shape(path: str | Path) -> tuple[int, int, int] | None:
    """Voxels along each axis of a file that is read window by window; None of others, which tell only when read.

    Raises  as `open_volume`.
    """
    file = Path(path)
    ending = "" if file.is_dir() else volume_ending(file)
    if ending not in (".npy", ".tif", ".tiff", *_MAPPED):
        return None
    require_plain_file(file)
    if ending in (".tif", ".tiff"):
        return told_of(_stack_shape, file)
    x, y, z = told_of(_mapped, file).values.shape
    return x, y, z


def _is_mapped(values: NDArray[Any]) -> bool:
    """Whether an array lies in a file, and is not in memory."""
    below: Any = values
    while isinstance(below, np.ndarray):
        below = below.base
    return isinstance(below.obj if isinstance(below, memoryview) else below, mmap.mmap)


def _mapped(file: Path) -> Volume:
    """The volume with its values where they are in the file, as far as that may be."""
    if volume_ending(file) != ".npy":
        return _MAPPED[volume_ending(file)](file, content=mapped_bytes)
    if bytes(mapped_bytes(file)[:6]) != b"\x93NUMPY":
        raise UnreadableFile(str(file), "is no .npy array")
    return Volume(name=file.name, values=np.load(file, allow_pickle=False, mmap_mode="r"))


@dataclass(frozen=True)
class _Mapped:
    """Copies a window out of a file; nothing of the file is held between two windows."""

    file: Path

    def __call__(self, window: Window) -> NDArray[Any]:
        return np.array(told_of(_mapped, self.file).values[window])


def _stack_shape(file: Path) -> tuple[int, int, int]:
    from PIL import Image

    with Image.open(file) as image:
        return (*image.size, int(getattr(image, "n_frames", 1)))


@dataclass(frozen=True)
class _Pages:
    """Copies a window out of a TIFF stack, whose pages are slices along the third axis."""

    file: Path

    def __call__(self, window: Window) -> NDArray[Any]:
        return told_of(partial(_page_window, window=window), self.file)


def _page_window(file: Path, window: Window) -> NDArray[Any]:
    from PIL import Image

    pages = []
    with Image.open(file) as image:
        for number in range(window[2].start, window[2].stop):
            image.seek(number)
            page = page_numbers(image)
            require_pages([page], file)
            pages.append(page.T[window[0], window[1]].copy())
    return np.stack(pages, axis=2)
