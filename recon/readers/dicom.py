"""DICOM series: a folder of slices, one file each, read by SimpleITK (extra `volumes`).

The library reads what it can and leaves out the rest without a word: of a folder with one damaged slice it makes a
volume with the others moved together; and it asks for as much memory as an element says that it is long. So the slices
are looked at first.

    128 bytes, DICM, then elements:   group 2 | element 2 | VR 2 | length 2, or 0 0 and 4 | value       explicit VR
                                      group 2 | element 2 |        length 4               | value       implicit VR
"""

import math
import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.errors import UnreadableFile
from recon.geometry.voxel_grid import Volume
from recon.readers.unpacking import require_plausible_size

__all__ = ["read_dicom"]

Floats = NDArray[np.float64]

MAGIC, MAGIC_AT = b"DICM", 128
ENDINGS = (".dcm", ".dicom", ".ima")
LONG = (
    b"OB",
    b"OD",
    b"OF",
    b"OL",
    b"OV",
    b"OW",
    b"SQ",
    b"SV",
    b"UC",
    b"UN",
    b"UR",
    b"UT",
    b"UV",
)  # VRs of 4 bytes' length
META = 0x0002  # the group that is always explicit
TRANSFER_SYNTAX, IMPLICIT, BIG_ENDIAN = (META, 0x0010), b"1.2.840.10008.1.2", b"1.2.840.10008.1.2.2"
UNKNOWN = 0xFFFFFFFF
UNEVEN = 0.02  # of the distance between slices, by which distances may differ; positions are rounded


class _Slice(NamedTuple):
    """What the header of a slice says of it."""

    name: str
    size: tuple[int, ...]
    spacing: tuple[float, ...]
    position: Floats
    direction: Floats


def read_dicom(folder: Path) -> Volume:
    """The volume of a folder with one DICOM series.

    Raises  UnreadableFile for none or several, for slices that are damaged, missing or unlike each other, and without
            SimpleITK.
    """
    try:
        import SimpleITK as sitk
    except ImportError as problem:
        raise UnreadableFile(str(folder), "needs SimpleITK", "Install recon-brep[volumes]") from problem
    slices = sorted(file for file in folder.iterdir() if _looks_like_slice(file))
    for file in slices:
        _require_whole(file)
    series = sitk.ImageSeriesReader.GetGDCMSeriesIDs(str(folder))
    if len(series) != 1:
        advice = "Put each series into a folder of its own" if series else "Name a folder of DICOM slices"
        raise UnreadableFile(str(folder), f"holds {len(series)} DICOM series", advice)
    files = [Path(name) for name in sitk.ImageSeriesReader.GetGDCMSeriesFileNames(str(folder), series[0])]
    _require_all(folder, slices, files)
    _require_even(folder, [_looked_at(sitk, file) for file in files])
    try:
        image = sitk.ReadImage([str(file) for file in files])
    except RuntimeError as problem:
        raise UnreadableFile(str(folder), "its DICOM slices make no volume") from problem
    direction = np.array(image.GetDirection()).reshape(3, 3)
    values = sitk.GetArrayFromImage(image).transpose(2, 1, 0)
    return Volume(np.array(image.GetSpacing()), np.array(image.GetOrigin()), direction, folder.name, values)


def _require_all(folder: Path, slices: list[Path], files: list[Path]) -> None:
    """Refuse a folder in which a file that looks like a slice is none of the series."""
    known = {file.name for file in files}
    left_out = [file.name for file in slices if file.name not in known]
    if left_out:
        more = "" if len(left_out) == 1 else f" and {len(left_out) - 1} more"
        what = f"holds {left_out[0]}{more}, which cannot be read as a slice of its series"
        raise UnreadableFile(str(folder), what, "Copy the series again, or move what does not belong to it elsewhere")


def _require_whole(file: Path) -> None:
    """Refuse a slice with an element that is longer than what is left of the file.

    Elements within sequences are not looked at, nor what follows the first of unknown length.
    """
    size, implicit = file.stat().st_size, False
    with file.open("rb") as content:
        at = MAGIC_AT + len(MAGIC)
        while at + 8 <= size:
            content.seek(at)
            head = content.read(12).ljust(12, b"\0")
            group, element, kind, short, long = struct.unpack("<HH2sHI", head)
            bare = implicit and group != META
            at += 12 if not bare and kind in LONG else 8
            length = struct.unpack("<I", head[4:8])[0] if bare else long if kind in LONG else short
            if length == UNKNOWN:
                return
            if at + length > size:
                what = f"its element ({group:04x},{element:04x}) is longer than the file"
                raise UnreadableFile(str(file), what, "Copy the series again")
            if (group, element) == TRANSFER_SYNTAX:
                content.seek(at)
                syntax = content.read(length).rstrip(b"\0 ")
                implicit = syntax == IMPLICIT
                if syntax == BIG_ENDIAN:
                    return
            at += length


def _looks_like_slice(file: Path) -> bool:
    if not file.is_file() or file.name.upper() == "DICOMDIR":
        return False
    if file.suffix.lower() in ENDINGS:
        return True
    with file.open("rb") as content:
        content.seek(MAGIC_AT)
        return content.read(len(MAGIC)) == MAGIC


def _looked_at(sitk: Any, file: Path) -> _Slice:
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(file))
    try:
        reader.ReadImageInformation()
    except RuntimeError as problem:
        raise UnreadableFile(str(file), "is damaged: its header makes no sense") from problem
    size = reader.GetSize()
    require_plausible_size(str(file), file.stat().st_size, math.prod(size) * reader.GetNumberOfComponents())
    origin, direction = np.array(reader.GetOrigin()), np.array(reader.GetDirection())
    return _Slice(file.name, size, reader.GetSpacing(), origin, direction)


def _require_even(folder: Path, slices: list[_Slice]) -> None:
    """Refuse slices that are unlike the first, or leave gaps between them."""
    first = slices[0]
    for slice_ in slices:
        alike = slice_.size == first.size and np.allclose(slice_.spacing[:2], first.spacing[:2], rtol=1e-3)
        if not alike or not np.allclose(slice_.direction, first.direction, atol=1e-3):
            what = f"its slices {first.name} and {slice_.name} differ in size, spacing or direction"
            raise UnreadableFile(str(folder), what, "Put each series into a folder of its own")
    steps = np.linalg.norm(np.diff([slice_.position for slice_ in slices], axis=0), axis=1)
    usual = np.median(steps) if len(steps) else 0.0
    uneven = np.flatnonzero(np.abs(steps - usual) > UNEVEN * usual)
    if len(uneven):
        k = int(uneven[0])
        names = f"{slices[k].name} and {slices[k + 1].name}"
        what = f"its slices {names} are {steps[k]:.4g} mm apart, others {usual:.4g}"
        raise UnreadableFile(str(folder), what, "Add the missing slices, or resample the series to even distances")
