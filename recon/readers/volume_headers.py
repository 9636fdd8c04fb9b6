"""NRRD, MetaImage and NIfTI: a header that says type, size and place, then a block of numbers, first axis fastest."""

import math
import mmap
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.errors import UnreadableFile
from recon.geometry.voxel_grid import Volume
from recon.readers.content import file_bytes
from recon.readers.numbers import typed_numbers
from recon.readers.unpacking import unbzip2, unzip

__all__ = ["read_metaimage", "read_nifti", "read_nrrd"]

Floats = NDArray[np.float64]
Content = Callable[[Path], bytes | mmap.mmap]

_NRRD_TYPES = {
    **dict.fromkeys(("signed char", "int8", "int8_t"), "i1"),
    **dict.fromkeys(("uchar", "unsigned char", "uint8", "uint8_t"), "u1"),
    **dict.fromkeys(("short", "short int", "signed short", "signed short int", "int16", "int16_t"), "i2"),
    **dict.fromkeys(("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"), "u2"),
    **dict.fromkeys(("int", "signed int", "int32", "int32_t"), "i4"),
    **dict.fromkeys(("uint", "unsigned int", "uint32", "uint32_t"), "u4"),
    **dict.fromkeys(("longlong", "long long", "long long int", "int64", "int64_t"), "i8"),
    **dict.fromkeys(("ulonglong", "unsigned long long", "uint64", "uint64_t"), "u8"),
    "float": "f4",
    "double": "f8",
}
_META_TYPES = {
    "MET_CHAR": "i1",
    "MET_UCHAR": "u1",
    "MET_SHORT": "i2",
    "MET_USHORT": "u2",
    "MET_INT": "i4",
    "MET_UINT": "u4",
    "MET_LONG_LONG": "i8",
    "MET_ULONG_LONG": "u8",
    "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}
NIFTI_HEADER = 352
_NIFTI_TYPES = {2: "u1", 4: "i2", 8: "i4", 16: "f4", 64: "f8", 256: "i1", 512: "u2", 768: "u4", 1024: "i8", 1280: "u8"}


def read_nrrd(file: Path, *, content: Content = file_bytes) -> Volume:
    """Volume of an NRRD file, data within or in the file that it names.

    content  gives the bytes of a file, or a map of it, in which the values then stay where nothing packed them
    """
    data = content(file)
    if data[:4] != b"NRRD":
        raise UnreadableFile(str(file), "is no NRRD file")
    lines, body = _text_header(data)
    fields = dict(_pair(line, ":") for line in lines[1:] if ":" in line and not line.startswith("#"))
    if int(fields["dimension"]) != 3:
        raise UnreadableFile(str(file), f"has {fields['dimension']} axes", "Store one volume of three axes")
    shape = [int(n) for n in fields["sizes"].split()]
    if "data file" in fields or "datafile" in fields:
        body = memoryview(content(file.parent / fields.get("data file", fields.get("datafile", ""))))
    kind = _NRRD_TYPES[fields["type"]]
    raw = _unpacked(body, fields.get("encoding", "raw").lower(), kind, _bytes_of(shape, kind), str(file))
    values = _shaped(raw, _endian(kind, fields.get("endian", "little") == "big"), shape, file)
    axes = _nrrd_axes(fields)
    spacing = np.linalg.norm(axes, axis=0)
    origin = _vector(fields["space origin"]) if "space origin" in fields else np.zeros(3)
    return Volume(spacing, origin, axes / spacing, file.name, values)


def _nrrd_axes(fields: dict[str, str]) -> Floats:
    """(3, 3) step of every axis as a column."""
    if "space directions" in fields:
        return np.stack([_vector(v) for v in fields["space directions"].split(")") if v.strip()], axis=1)
    steps = [float(s) for s in fields.get("spacings", "1 1 1").split()]
    return np.diag([s if np.isfinite(s) and s > 0 else 1.0 for s in steps])


def _vector(text: str) -> Floats:
    return np.array([float(x) for x in text.strip(" ()").split(",")])


def _unpacked(body: memoryview, encoding: str, kind: str, needed: int, name: str) -> bytes | memoryview:
    if encoding in ("gzip", "gz"):
        return unzip(bytes(body), needed, name)
    if encoding in ("bzip2", "bz2"):
        return unbzip2(bytes(body), needed, name)
    if encoding in ("ascii", "txt", "text"):
        return typed_numbers(bytes(body).split(), "<" + kind, name).tobytes()
    return body


def read_metaimage(file: Path, *, content: Content = file_bytes) -> Volume:
    """Volume of a MetaImage file, .mha with its data, .mhd with the name of their file; content as in `read_nrrd`."""
    data = content(file)
    end = data.find(b"ElementDataFile")
    if end < 0:
        raise UnreadableFile(str(file), "is no MetaImage file")
    stop = data.find(b"\n", end) + 1
    if stop == 0:
        raise UnreadableFile(str(file), "ends in its header")
    fields = dict(_pair(line, "=") for line in data[:stop].decode("latin-1").splitlines() if "=" in line)
    shape = [int(n) for n in fields["dimsize"].split()]
    if len(shape) != 3 or int(fields.get("elementnumberofchannels", "1")) != 1:
        raise UnreadableFile(str(file), "is no single volume of three axes")
    source = fields["elementdatafile"]
    local = source.upper() == "LOCAL"
    body: bytes | memoryview = memoryview(data)[stop:] if local else memoryview(content(file.parent / source))
    if fields.get("compresseddata", "false").lower() == "true":
        body = unzip(bytes(body), _bytes_of(shape, _META_TYPES[fields["elementtype"].upper()]), str(file))
    big = fields.get("binarydatabyteordermsb", fields.get("elementbyteordermsb", "false")).lower() == "true"
    values = _shaped(body, _endian(_META_TYPES[fields["elementtype"].upper()], big), shape, file)
    spacing = np.array(fields.get("elementspacing", "1 1 1").split(), dtype=np.float64)
    origin = fields.get("offset", fields.get("position", fields.get("origin", "0 0 0"))).split()
    turn = fields.get("transformmatrix", fields.get("orientation", "1 0 0 0 1 0 0 0 1")).split()
    direction = np.array(turn, dtype=np.float64).reshape(3, 3).T
    return Volume(spacing, np.array(origin, dtype=np.float64), direction, file.name, values)


def read_nifti(file: Path, *, content: Content = file_bytes) -> Volume:
    """Volume of a NIfTI-1 file; of its two affine maps the s-form wins, as its authors advise.

    content  as in `read_nrrd`
    """
    data = content(file)
    packed = bytes(data) if data[:2] == b"\x1f\x8b" else b""
    data = _gzip_start(packed, NIFTI_HEADER) if packed else data
    order = "<" if struct.unpack("<i", data[:4])[0] == 348 else ">"
    if struct.unpack(order + "i", data[:4])[0] != 348 or data[344:347] != b"n+1":
        raise UnreadableFile(str(file), "is no NIfTI-1 file with its data")
    dims = struct.unpack(order + "8h", data[40:56])
    if dims[0] < 3 or any(n > 1 for n in dims[4 : dims[0] + 1]):
        raise UnreadableFile(str(file), f"has {dims[0]} axes", "Store one volume of three axes")
    kind = _NIFTI_TYPES[struct.unpack(order + "h", data[70:72])[0]]
    pixdim = struct.unpack(order + "8f", data[76:108])
    start, slope, shift = struct.unpack(order + "3f", data[108:120])
    if packed:
        data = unzip(packed, int(start) + _bytes_of(list(dims[1:4]), kind), str(file))
    values = _shaped(memoryview(data)[int(start) :], order + kind, list(dims[1:4]), file)
    if (np.isfinite(slope) and slope not in (0.0, 1.0)) or shift != 0.0:
        values = values.astype(np.float64) * (slope or 1.0) + shift
    axes, origin = _nifti_affine(data, order, pixdim)
    spacing = np.linalg.norm(axes, axis=0)
    return Volume(spacing, origin, axes / spacing, file.name, values)


def _gzip_start(packed: bytes, size: int) -> bytes:
    return zlib.decompressobj(31).decompress(packed, size)


def _nifti_affine(data: bytes | mmap.mmap, order: str, pixdim: tuple[float, ...]) -> tuple[Floats, Floats]:
    q_code, s_code = struct.unpack(order + "2h", data[252:256])
    if s_code > 0:
        rows = np.array(struct.unpack(order + "12f", data[280:328])).reshape(3, 4)
        return rows[:, :3], rows[:, 3]
    spacing = np.array(pixdim[1:4])
    if q_code <= 0:
        return np.diag(spacing), np.zeros(3)
    b, c, d, x, y, z = struct.unpack(order + "6f", data[256:280])
    a = np.sqrt(max(0.0, 1.0 - b * b - c * c - d * d))
    turn = np.array(
        [
            [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - b * b - c * c],
        ]
    )
    turn[:, 2] *= -1.0 if pixdim[0] < 0 else 1.0
    return turn * spacing, np.array([x, y, z])


def _text_header(data: bytes | mmap.mmap) -> tuple[list[str], memoryview]:
    """Lines up to the empty one, and what follows it."""
    ends = [(data.find(mark), len(mark)) for mark in (b"\n\n", b"\r\n\r\n")]
    end, size = min(((e, n) for e, n in ends if e >= 0), default=(len(data), 0))
    return data[:end].decode("latin-1").splitlines(), memoryview(data)[end + size :]


def _pair(line: str, sign: str) -> tuple[str, str]:
    key, _, value = line.partition(sign)
    return key.strip().lower(), value.lstrip("=").strip()


def _endian(kind: str, big: bool) -> str:
    return (">" if big else "<") + kind


def _bytes_of(shape: list[int], kind: str) -> int:
    return math.prod(shape) * np.dtype(kind).itemsize


def _shaped(raw: bytes | memoryview, kind: str, shape: list[int], file: Path) -> NDArray[np.generic]:
    """The numbers as an array (X, Y, Z) of the machine's own byte order."""
    count, size = math.prod(shape), np.dtype(kind).itemsize
    if min(shape) < 1:
        raise UnreadableFile(str(file), f"has the size {shape}", "Copy or export the file again")
    if len(raw) < count * size:
        raise UnreadableFile(
            str(file), f"holds {len(raw) // size} values where its size needs {count}", "Copy or export the file again"
        )
    values = np.frombuffer(raw, dtype=kind, count=count).reshape(shape[::-1]).transpose(2, 1, 0)
    return values.astype(values.dtype.newbyteorder("="), copy=False)
