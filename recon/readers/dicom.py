"""DICOM series: a folder of slices, one file each, read by SimpleITK (extra `volumes`).

The library reads what it can and leaves out the rest without a word: of a folder with one damaged slice it makes a
volume with the others moved together; and it asks for as much memory as an element says that it is long. So the slices
are looked at first.

    128 bytes, DICM, then elements:   group 2 | element 2 | VR 2 | length 2, or 0 0 and 4 | value       explicit VR
                                      group 2 | element 2 |        length 4               | value       implicit VR

The value of a sequence is items, each an element of group fffe whose value is elements again.  So sequences are walked
through without a look at where they end: an item's head is passed, and the next element is the first within it.
"""

import math
import struct
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.errors import UnreadableFile
from recon.geometry.voxel_grid import Volume
from recon.readers.unpacking import require_plausible_size

__all__ = ["read_dicom"]

Floats = NDArray[np.float64]

MAGIC, MAGIC_AT, FIRST = b"DICM", 128, 132  # and where the first element stands
ENDINGS = (".dcm", ".dicom", ".ima")
LONG = frozenset(b"OB OD OF OL OV OW SQ SV UC UN UR UT UV".split())  # VRs whose length takes four bytes
SHORT = frozenset(b"AE AS AT CS DA DS DT FD FL IS LO LT PN SH SL SS ST TM UI UL US".split())
META = 0x0002  # the group that is always explicit
TRANSFER_SYNTAX, IMPLICIT, BIG_ENDIAN = (META, 0x0010), b"1.2.840.10008.1.2", b"1.2.840.10008.1.2.2"
DEFLATED = b"1.2.840.10008.1.2.1.99"
PIXELS, ITEM, SEQUENCE_END = (0x7FE0, 0x0010), (0xFFFE, 0xE000), (0xFFFE, 0xE0DD)
UNKNOWN = 0xFFFFFFFF
UNEVEN = 0.02  # of the distance between slices, by which distances may differ; positions are rounded


class _Element(NamedTuple):
    """An element's head: its type, empty where none is told, where its value begins, and how many bytes it has."""

    tag: tuple[int, int]
    kind: bytes
    at: int
    length: int


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
    files = _series(sitk, folder)
    _require_all(folder, slices, files)
    looked_at = [_looked_at(sitk, file) for file in files]
    _require_even(folder, looked_at)
    try:
        image = sitk.ReadImage([str(file) for file in files])
    except RuntimeError as problem:
        raise UnreadableFile(str(folder), "its DICOM slices make no volume") from problem
    if looked_at[0].size[1] == 1:
        raise UnreadableFile(str(folder), "its slices have one row", "Export the volume in another format")
    direction = np.array(image.GetDirection()).reshape(3, 3)
    values = sitk.GetArrayFromImage(image).transpose(2, 1, 0)
    return Volume(np.array(image.GetSpacing()), np.array(image.GetOrigin()), direction, folder.name, values)


def _series(sitk: Any, folder: Path) -> list[Path]:
    """The files of the one series of a folder, in the order of their places."""
    try:
        series = sitk.ImageSeriesReader.GetGDCMSeriesIDs(str(folder))
        if len(series) == 1:
            return [Path(name) for name in sitk.ImageSeriesReader.GetGDCMSeriesFileNames(str(folder), series[0])]
    except RuntimeError as problem:
        raise UnreadableFile(str(folder), "holds damaged DICOM slices", "Copy the series again") from problem
    advice = "Put each series into a folder of its own" if series else "Name a folder of DICOM slices"
    raise UnreadableFile(str(folder), f"holds {len(series)} DICOM series", advice)


def _require_all(folder: Path, slices: list[Path], files: list[Path]) -> None:
    """Refuse a folder in which a file that looks like a slice is none of the series."""
    known = {file.name for file in files}
    left_out = [file.name for file in slices if file.name not in known]
    if left_out:
        more = "" if len(left_out) == 1 else f" and {len(left_out) - 1} more"
        what = f"holds {left_out[0]}{more}, which cannot be read as a slice of its series"
        raise UnreadableFile(str(folder), what, "Copy the series again, or move what does not belong to it elsewhere")


def _require_whole(file: Path) -> None:
    """Refuse a slice that does not begin with elements of the group META, or has an element that is longer than what is
    left of the file, or of a type that there is not.

    Not looked at are slices packed as a whole, and, where types are not told, sequences that tell their length.
    """
    size, at, syntax, is_packed = file.stat().st_size, FIRST, b"", False
    with file.open("rb") as content:
        while at + 8 <= size:
            part = _element(content, at, syntax)
            if at == FIRST and part.tag[0] != META:
                raise UnreadableFile(str(file), "does not begin as DICOM files do", "Copy the series again")
            what, at = "its element ({:04x},{:04x})".format(*part.tag), part.at
            if syntax == DEFLATED and part.tag[0] != META:
                return
            if part.kind and part.kind not in LONG | SHORT:
                raise UnreadableFile(str(file), f"{what} is of no type that DICOM has", "Copy the series again")
            if part.kind == b"UN" and part.length == UNKNOWN:
                return  # a sequence whose elements tell no types, whatever those of the file do
            is_packed = (is_packed or (part.tag == PIXELS and part.length == UNKNOWN)) and part.tag != SEQUENCE_END
            if part.length == UNKNOWN or part.kind == b"SQ" or (part.tag == ITEM and not is_packed):
                continue
            if at + part.length > size:
                raise UnreadableFile(str(file), f"{what} is longer than the file", "Copy the series again")
            if part.tag == TRANSFER_SYNTAX:
                content.seek(at)
                syntax = content.read(part.length).rstrip(b"\0 ")
            at += part.length


def _element(content: BinaryIO, at: int, syntax: bytes) -> _Element:
    content.seek(at)
    head = content.read(12).ljust(12, b"\0")
    is_meta = head[:2] == struct.pack("<H", META)
    order = ">" if syntax == BIG_ENDIAN and not is_meta else "<"
    group, element = struct.unpack(order + "HH", head[:4])
    kind = head[4:6]
    if group == ITEM[0] or (syntax == IMPLICIT and not is_meta):
        return _Element((group, element), b"", at + 8, *struct.unpack(order + "I", head[4:8]))
    if kind in LONG:
        return _Element((group, element), kind, at + 12, *struct.unpack(order + "I", head[8:]))
    return _Element((group, element), kind, at + 8, *struct.unpack(order + "H", head[6:8]))


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
    """Refuse slices that are unlike the first, leave gaps between them, or are shifted sideways, as by a tilted gantry:
    the library would put them straight above each other.
    """
    first = slices[0]
    for slice_ in slices:
        alike = slice_.size == first.size and np.allclose(slice_.spacing[:2], first.spacing[:2], rtol=1e-3)
        if not alike or not np.allclose(slice_.direction, first.direction, atol=1e-3):
            what = f"its slices {first.name} and {slice_.name} differ in size, spacing or direction"
            raise UnreadableFile(str(folder), what, "Put each series into a folder of its own")
    ways = np.diff([slice_.position for slice_ in slices], axis=0).reshape(-1, 3)
    steps = np.linalg.norm(ways, axis=1)
    usual = np.median(steps) if len(steps) else 0.0
    normal = first.direction.reshape(3, 3)[:, 2]
    sideways = np.linalg.norm(ways - np.outer(ways @ normal, normal), axis=1)
    for k in range(len(steps)):
        names = f"its slices {slices[k].name} and {slices[k + 1].name}"
        if abs(steps[k] - usual) > UNEVEN * usual:
            what = f"{names} are {steps[k]:.4g} mm apart, others {usual:.4g}"
            raise UnreadableFile(str(folder), what, "Add the missing slices, or resample the series to even distances")
        if sideways[k] > UNEVEN * usual:
            what = f"{names} are shifted sideways by {sideways[k]:.3g} mm"
            raise UnreadableFile(str(folder), what, "Resample the series to slices straight above each other")
