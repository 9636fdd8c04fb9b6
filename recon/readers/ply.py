"""PLY files, text or binary of either byte order, with polygons, triangle strips, or both.

A header names elements (vertex, face, tristrips), their counts and their properties; the rows follow, one element
after the other. Text is turned into rows of 8-byte numbers first, so that both kinds are read by the same code.

    element face 2                        properties of a row: plain numbers, or lists with their length in front
    property list uchar int vertex_indices
    3 0 1 2                               rows of equal length are read as one table, others one by one
    4 1 2 3 4
"""

import mmap
import re
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, UnreadableFile
from recon.readers.numbers import integers, number_array
from recon.readers.polygons import PolygonSoup, strip_triangles

__all__ = ["mapped_triangles", "read_ply"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

KINDS = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
BYTE_ORDER: dict[str, Literal["<", ">"]] = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
LONGEST_HEADER = 1 << 20
NO_POINT = 0xFFFFFFFF  # how the -1 that ends a strip reads as an unsigned number
INDICES = ("vertex_indices", "vertex_index")
AGAIN = "Export or copy the file again"


@dataclass(frozen=True)
class _Property:
    """A number, or a list of numbers when `counter`, the type of its length, is given."""

    name: str
    kind: np.dtype
    counter: np.dtype | None


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: tuple[_Property, ...]

    @property
    def shortest_row(self) -> int:
        """Bytes of a row whose lists are all empty."""
        return sum((p.counter or p.kind).itemsize for p in self.properties)


# Values of a property, one row after the other, and how many of them each row has.
_Columns = dict[str, tuple[Floats, Ints]]


def read_ply(data: bytes, name: str) -> PolygonSoup:
    """Polygons and strips of a PLY file.

    Raises  UnreadableFile when the header makes no sense or promises more than the file holds;
            BadGeometry when it has points only.
    """
    encoding, elements, start = _header(data, name)
    counts = {element.name: element.count for element in elements}
    if not counts.get("face") and not counts.get("tristrips") and counts.get("vertex"):
        raise BadGeometry(name, f"holds {counts['vertex']} points but no faces; export it as a mesh of triangles")
    body = data[start:]
    if encoding == "ascii":
        body = number_array(body.split(), name).astype("<f8").tobytes()
    rows = _Rows(body, name)
    columns = {element.name: rows.read(element) for element in elements}
    notes = rows.notes(encoding == "ascii")
    points = _points(columns.get("vertex", {}), name)
    corners, sizes = _lists(columns.get("face", {}), name)
    strip, lengths = _lists(columns.get("tristrips", {}), name)
    if len(strip):
        strip = np.insert(np.where(strip == NO_POINT, -1, strip), np.cumsum(lengths)[:-1], -1)
        triangles = strip_triangles(strip)
        notes.append(f"{len(triangles)} triangles were read from triangle strips")
        corners = np.concatenate([corners, triangles.ravel()])
        sizes = np.concatenate([sizes, np.full(len(triangles), 3)])
    return PolygonSoup(points, corners, sizes, tuple(notes))


def mapped_triangles(data: mmap.mmap, name: str) -> tuple[NDArray[Any], NDArray[Any]] | None:
    """Rows of the points, with fields x, y and z, and rows of the triangles, with the fields count and corners (3,),
    where they lie in a binary file; None where it holds other elements, or faces of other lists.

    Raises  UnreadableFile when the header makes no sense, or promises more than the file holds.
    """
    encoding, elements, start = _header(data, name)
    if encoding == "ascii" or [element.name for element in elements] != ["vertex", "face"]:
        return None
    vertex, face = elements
    lists = [p for p in face.properties if p.counter is not None]
    if len(lists) != 1 or lists[0].name not in INDICES or any(p.counter is not None for p in vertex.properties):
        return None
    if not {"x", "y", "z"} <= {p.name for p in vertex.properties}:
        return None
    fields: list[Any] = []
    for p in face.properties:
        fields += [(p.name, p.kind)] if p.counter is None else [("count", p.counter), ("corners", p.kind, (3,))]
    tables = np.dtype([(p.name, p.kind) for p in vertex.properties]), np.dtype(fields)
    if start + vertex.count * tables[0].itemsize + face.count * tables[1].itemsize != len(data):
        return None
    points = np.frombuffer(data, tables[0], vertex.count, start)
    return points, np.frombuffer(data, tables[1], face.count, start + points.nbytes)


def _header(data: bytes | mmap.mmap, name: str) -> tuple[str, list[_Element], int]:
    """Encoding, elements and the place where the rows begin."""
    if re.match(rb"ply[ \t]*[\r\n]", data) is None:
        raise UnreadableFile(name, "is not a PLY file: it does not begin with the word ply", AGAIN)
    end = re.compile(rb"[\r\n]end_header[ \t]*(\r\n|\n|\r)").search(data, 0, LONGEST_HEADER)
    if end is None:
        raise UnreadableFile(name, "its PLY header has no end", AGAIN)
    encoding, elements = "", []
    for line in data[: end.start()].decode("latin-1").splitlines()[1:]:
        match line.split():
            case ["format", word, *_]:
                encoding = word
            case ["element", word, count] if count.isdecimal():
                elements.append(_Element(word, int(count), ()))
            case ["property", *words] if elements:
                last = elements[-1]
                elements[-1] = _Element(last.name, last.count, (*last.properties, _property(words, line, name)))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise UnreadableFile(name, f"its PLY header has a line that makes no sense, {line[:60]!r}", AGAIN)
    if encoding not in BYTE_ORDER:
        raise UnreadableFile(
            name, f"its PLY header names the format {encoding!r}", f"Use one of {', '.join(BYTE_ORDER)}"
        )
    return encoding, [_typed(element, encoding) for element in elements], end.end()


def _property(words: list[str], line: str, name: str) -> _Property:
    match words:
        case ["list", counter, kind, word] if counter in KINDS and kind in KINDS:
            return _Property(word, np.dtype(KINDS[kind]), np.dtype(KINDS[counter]))
        case [kind, word] if kind in KINDS:
            return _Property(word, np.dtype(KINDS[kind]), None)
    raise UnreadableFile(name, f"its PLY header has a property of unknown type, {line[:60]!r}", AGAIN)


def _typed(element: _Element, encoding: str) -> _Element:
    """The element with the types its rows have in memory: 8-byte numbers for text, else those of the file."""

    def stored(kind: np.dtype) -> np.dtype:
        return np.dtype("<f8") if encoding == "ascii" else kind.newbyteorder(BYTE_ORDER[encoding])

    return _Element(
        element.name,
        element.count,
        tuple(_Property(p.name, stored(p.kind), p.counter and stored(p.counter)) for p in element.properties),
    )


class _Rows:
    """The rows after the header, read element by element."""

    def __init__(self, body: bytes, name: str) -> None:
        self._body, self._name, self._at = body, name, 0

    def read(self, element: _Element) -> _Columns:
        """All rows of the next element; raises UnreadableFile when the file ends before they do."""
        # Before anything is allocated: a damaged count may ask for more memory than there is.
        if element.count * element.shortest_row > len(self._body) - self._at:
            raise self._too_short(element)
        if element.count == 0 or not element.properties:
            return {}
        lengths = [size for p, (_, size) in zip(element.properties, self._row(element, self._at)) if p.counter]
        return self._equal_rows(element, lengths) or self._uneven_rows(element)

    def notes(self, is_text: bool) -> list[str]:
        """What is left over is said; in text it means that the rows hold other columns than the header names."""
        rest = len(self._body) - self._at
        if rest and is_text:
            raise UnreadableFile(self._name, f"its rows hold {rest // 8} numbers more than its header names", AGAIN)
        return [f"{rest} bytes after the last element were left unread"] if rest else []

    def _equal_rows(self, element: _Element, lengths: list[int]) -> _Columns | None:
        """The rows as one table, if every row has lists of the same lengths as the first."""
        length = iter(lengths)
        fields: list[tuple[str, np.dtype, tuple[int, ...]]] = []
        for i, p in enumerate(element.properties):
            if p.counter is not None:
                fields.append((f"count {i}", p.counter, ()))
            fields.append((f"value {i}", p.kind, () if p.counter is None else (next(length),)))
        table = np.dtype(fields)
        if element.count * table.itemsize > len(self._body) - self._at:
            return None
        rows = np.frombuffer(self._body, table, element.count, self._at)
        for i, p in enumerate(element.properties):
            if p.counter is not None and (rows[f"count {i}"] != rows[f"count {i}"][0]).any():
                return None
        self._at += rows.nbytes
        values = [rows[f"value {i}"].reshape(element.count, -1) for i in range(len(element.properties))]
        return {
            p.name: (v.ravel().astype(np.float64), np.full(element.count, v.shape[1]))
            for p, v in zip(element.properties, values)
        }

    def _uneven_rows(self, element: _Element) -> _Columns:
        pieces: list[list[bytes]] = [[] for _ in element.properties]
        sizes: list[list[int]] = [[] for _ in element.properties]
        for _ in range(element.count):
            for i, (place, size) in enumerate(self._row(element, self._at)):
                self._at = place + size * element.properties[i].kind.itemsize
                pieces[i].append(self._body[place : self._at])
                sizes[i].append(size)
        return {
            p.name: (np.frombuffer(b"".join(pieces[i]), p.kind).astype(np.float64), np.array(sizes[i]))
            for i, p in enumerate(element.properties)
        }

    def _row(self, element: _Element, at: int) -> list[tuple[int, int]]:
        """Place and number of the values of every property in the row that begins at `at`."""
        found = []
        for p in element.properties:
            size = 1
            if p.counter is not None:
                if at + p.counter.itemsize > len(self._body):
                    raise self._too_short(element)
                size = self._list_length(p.counter, at, element)
                at += p.counter.itemsize
            found.append((at, size))
            at += size * p.kind.itemsize
            if at > len(self._body):
                raise self._too_short(element)
        return found

    def _list_length(self, counter: np.dtype, at: int, element: _Element) -> int:
        number = float(np.frombuffer(self._body, counter, 1, at)[0])
        if not (number >= 0 and number.is_integer()):
            raise UnreadableFile(self._name, f"a list in its element {element.name} has the length {number:g}", AGAIN)
        return int(number)

    def _too_short(self, element: _Element) -> UnreadableFile:
        return UnreadableFile(
            self._name, f"its header promises {element.count} of {element.name}, but the file ends before", AGAIN
        )


def _points(vertex: _Columns, name: str) -> Floats:
    if not vertex:
        return np.empty((0, 3))
    if any(axis not in vertex or (vertex[axis][1] != 1).any() for axis in "xyz"):
        raise UnreadableFile(name, "its vertices have no properties x, y and z", AGAIN)
    return np.stack([vertex[axis][0] for axis in "xyz"], axis=1)


def _lists(columns: _Columns, name: str) -> tuple[Ints, Ints]:
    """(c,) point numbers of all faces or strips, and (m,) how many each has."""
    if not columns:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    named = [word for word in INDICES if word in columns]
    if not named:
        raise UnreadableFile(name, "its faces have no property vertex_indices", AGAIN)
    values, sizes = columns[named[0]]
    return integers(values, name), sizes.astype(np.int64)
