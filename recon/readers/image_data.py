"""VTK image data (.vti): XML with its numbers as text, in base64, or appended; plain or compressed with zlib."""

import base64
import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.errors import UnreadableFile
from recon.geometry.voxel_grid import Volume
from recon.readers.content import file_bytes
from recon.readers.numbers import typed_numbers
from recon.readers.unpacking import unzip

__all__ = ["read_vti"]

_TYPES = {
    "Int8": "i1",
    "UInt8": "u1",
    "Int16": "i2",
    "UInt16": "u2",
    "Int32": "i4",
    "UInt32": "u4",
    "Int64": "i8",
    "UInt64": "u8",
    "Float32": "f4",
    "Float64": "f8",
}


def read_vti(file: Path) -> Volume:
    """Volume of the first array of one value a point, or a cell, of an image data file in one piece."""
    data = file_bytes(file)
    xml, appended = _parted(data)
    root = ElementTree.fromstring(xml)
    image, piece = root.find("ImageData"), root.find("ImageData/Piece")
    if image is None or piece is None:
        raise UnreadableFile(str(file), "is no VTK image data")
    low, high = np.array(image.attrib["WholeExtent"].split(), dtype=np.int64).reshape(3, 2).T
    spacing = np.array(image.attrib.get("Spacing", "1 1 1").split(), dtype=np.float64)
    origin = np.array(image.attrib.get("Origin", "0 0 0").split(), dtype=np.float64)
    direction = np.array(image.attrib.get("Direction", "1 0 0 0 1 0 0 0 1").split(), dtype=np.float64).reshape(3, 3)
    for where, at_points in (("PointData", True), ("CellData", False)):
        for array in piece.iterfind(f"{where}/DataArray"):
            if int(array.attrib.get("NumberOfComponents", "1")) == 1:
                shape = high - low + at_points
                values = (
                    _values(array, root, (appended, math.prod(shape.tolist()), file.name))
                    .reshape(shape[::-1])
                    .transpose(2, 1, 0)
                )
                first = low + (0.0 if at_points else 0.5)
                return Volume(spacing, origin + direction @ (spacing * first), direction, file.name, values)
    raise UnreadableFile(str(file), "holds no array of one value a point or a cell")


def _parted(data: bytes) -> tuple[bytes, bytes]:
    """The XML without its appended block, and that block from behind the underscore."""
    start = data.find(b"<AppendedData")
    if start < 0:
        return data, b""
    mark = data.index(b"_", data.index(b">", start)) + 1
    closing = b"</AppendedData></VTKFile>"
    return data[: data.index(b">", start) + 1] + closing, data[mark:]


def _values(
    array: ElementTree.Element, root: ElementTree.Element, source: tuple[bytes, int, str]
) -> NDArray[np.generic]:
    """Numbers of an array; the source is the appended block, how many numbers are needed, and the file's name."""
    appended, count, name = source
    order = ">" if root.attrib.get("byte_order") == "BigEndian" else "<"
    kind = order + _TYPES[array.attrib["type"]]
    form = array.attrib.get("format", "ascii")
    if form == "ascii":
        return typed_numbers((array.text or "").encode().split(), kind, name)
    head = order + _TYPES[root.attrib.get("header_type", "UInt32")]
    packed = _Packed(count * np.dtype(kind).itemsize, name) if "compressor" in root.attrib else None
    if form == "binary":
        raw = _from_text((array.text or "").strip().encode(), head, packed=packed)
    else:
        block = appended[int(array.attrib["offset"]) :]
        node = root.find("AppendedData")
        is_text = node is not None and node.attrib.get("encoding") == "base64"
        raw = _from_text(block, head, packed=packed) if is_text else _from_bytes(block, head, packed=packed)
    return np.frombuffer(raw, dtype=kind)


@dataclass(frozen=True)
class _Packed:
    """Of packed numbers: the bytes that are needed, and the name of their file."""

    needed: int
    name: str


def _from_bytes(block: bytes, head: str, *, packed: _Packed | None) -> bytes:
    size = np.dtype(head).itemsize
    if packed is None:
        return block[size : size + int(np.frombuffer(block, head, 1)[0])]
    n = int(np.frombuffer(block, head, 1)[0])
    lengths = np.frombuffer(block, head, 3 + n)[3:].astype(np.int64)
    ends = (3 + n) * size + np.cumsum(lengths)
    parts, left = [], packed.needed
    for end, length in zip(ends.tolist(), lengths.tolist()):
        parts.append(unzip(block[end - length : end], left, packed.name))
        left -= len(parts[-1])
    return b"".join(parts)


def _from_text(block: bytes, head: str, *, packed: _Packed | None) -> bytes:
    """Base64 closes the header of compressed data before the data begin."""
    size = np.dtype(head).itemsize
    if packed is None:
        length = int(np.frombuffer(base64.b64decode(block[: _coded(size)]), head, 1)[0])
        return base64.b64decode(block[: _coded(size + length)])[size : size + length]
    n = int(np.frombuffer(base64.b64decode(block[: _coded(size)]), head, 1)[0])
    first = _coded((3 + n) * size)
    header = base64.b64decode(block[:first])
    total = int(np.frombuffer(header, head, 3 + n)[3:].sum())
    return _from_bytes(header + base64.b64decode(block[first : first + _coded(total)]), head, packed=packed)


def _coded(n: int) -> int:
    """Characters that n bytes take in base64."""
    return -(-n // 3) * 4
