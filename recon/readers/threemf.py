"""3MF packages: bodies of triangles, and objects made of other objects, placed where the package builds them.

3D/3dmodel.model     object 1: mesh    object 2: components 1, 1    build: items 2, 1, each with its transform
3D/Objects/a.model   object 1: mesh    numbers count within their model, and a component names the other by its path

x y z 1  times  the twelve numbers of a transform, row by row as (4, 3)  =  the place of a point one level up
"""

import io
import lzma
import struct
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import UnreadableFile
from recon.readers.polygons import PolygonSoup, together
from recon.readers.unpacking import require_plausible_size

__all__ = ["read_3mf"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Name = tuple[str, str]  # of an object: its model, its number there

MILLIMETRES = {
    "micron": 1e-3,
    "microns": 1e-3,
    "micrometer": 1e-3,
    "micrometers": 1e-3,
    "millimeter": 1.0,
    "millimeters": 1.0,
    "centimeter": 10.0,
    "centimeters": 10.0,
    "inch": 25.4,
    "inches": 25.4,
    "foot": 304.8,
    "feet": 304.8,
    "meter": 1000.0,
    "meters": 1000.0,
}
LARGEST_PART = 1 << 32  # bytes unpacked: a few kilobytes of archive can claim any size
MOST_TRIANGLES = 20_000_000  # objects within objects unfold to any number out of a small file
MOST_BODIES = 200_000
DEEPEST = 100
DAMAGED_ARCHIVE = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error),
    *(EOFError, NotImplementedError, RuntimeError, ValueError, OSError, KeyError),
)
AGAIN = "Export or copy the file again"
HARMLESS = ("/material/", "/production/", "/trianglesets/")  # extensions that change no triangle


@dataclass(frozen=True, eq=False)
class _Object:
    """A mesh, points (n, 3) and faces (m, 3), and further objects, each with its transform (4, 3)."""

    points: Floats
    faces: Ints
    parts: tuple[tuple[Name, Floats], ...]


@dataclass(frozen=True, eq=False)
class _Model:
    """What one model of a package holds: its unit, its objects, and what it builds."""

    unit: str
    objects: dict[Name, _Object]
    built: tuple[tuple[Name, Floats], ...]


def read_3mf(data: bytes, path: Path) -> PolygonSoup:
    """Triangles of all objects that a 3MF file builds, where it builds them, with its unit.

    Raises  UnreadableFile when the archive or a model in it is damaged, its unit is unknown, its objects hold each
            other or unfold without end, or it needs an extension that is not read here.
    """
    models = _models(data, path)
    main = next(name for name in models if name.endswith("3d/3dmodel.model"))
    try:
        model = _model(models, main, str(path))
        objects = dict(model.objects)
        for other in _named_models(model) - {main}:
            objects |= _model(models, other, str(path)).objects
        with np.errstate(all="ignore"):  # what is no number is told of where the bodies are put together
            bodies = list(_placed(objects, model, str(path)))
    except (KeyError, ValueError, TypeError, OverflowError, SyntaxError) as problem:
        detail = f"{type(problem).__name__}: {problem}".split("\n")[0][:120]
        raise UnreadableFile(str(path), f"cannot be read as 3MF ({detail})", AGAIN) from problem
    if model.unit not in MILLIMETRES:
        known = f"Use one of {', '.join(MILLIMETRES)}"
        raise UnreadableFile(str(path), f"names the unknown unit {model.unit[:20]!r}", known)
    return together(bodies, str(path), millimetres=MILLIMETRES[model.unit])


def _models(data: bytes, path: Path) -> dict[str, bytes]:
    """The models of the package by name, small letters and no slash before."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            parts = archive.infolist()
            size = sum(part.file_size for part in parts)
            if size > LARGEST_PART:
                raise UnreadableFile(str(path), "would unpack to more than four gigabytes", AGAIN)
            require_plausible_size(str(path), len(data), size)
            damaged = archive.testzip()
            named = {part.filename.strip("/").lower(): part for part in parts}
            models = {name: archive.read(part) for name, part in named.items() if name.endswith(".model")}
    except DAMAGED_ARCHIVE as problem:
        raise UnreadableFile(str(path), "is not a whole 3MF archive", AGAIN) from problem
    if damaged is not None or not any(name.endswith("3d/3dmodel.model") for name in models):
        raise UnreadableFile(str(path), "has no undamaged 3D model in its archive", AGAIN)
    return models


def _model(models: dict[str, bytes], name: str, file: str) -> _Model:
    from lxml import etree

    if name not in models:
        raise UnreadableFile(file, f"has no part {name[:80]!r}, which its model names", AGAIN)
    root = etree.fromstring(models[name], etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True))
    for prefix in root.get("requiredextensions", "").split():
        extension = root.nsmap.get(prefix) or prefix
        if not any(word in extension for word in HARMLESS):
            raise UnreadableFile(file, f"needs the extension {extension[:80]}", "Export it as plain triangles")
    objects = {(name, element.attrib["id"]): _object(element, name) for element in root.iter("{*}object")}
    built = tuple(_used(item, name) for item in root.iterfind("{*}build/{*}item"))
    return _Model(root.get("unit", "millimeter"), objects, built)


def _object(element: Any, model: str) -> _Object:
    vertices = element.iterfind("{*}mesh/{*}vertices/{*}vertex")
    triangles = element.iterfind("{*}mesh/{*}triangles/{*}triangle")
    points = np.array([[float(v.get(axis)) for axis in "xyz"] for v in vertices], dtype=np.float64)
    faces = np.array([[int(t.get(key)) for key in ("v1", "v2", "v3")] for t in triangles], dtype=np.int64)
    parts = tuple(_used(part, model) for part in element.iterfind("{*}components/{*}component"))
    return _Object(points.reshape(-1, 3), faces.reshape(-1, 3), parts)


def _used(element: Any, model: str) -> tuple[Name, Floats]:
    """The object that an item or a component names, and its transform."""
    elsewhere = next((text for key, text in element.attrib.items() if key.rpartition("}")[2] == "path"), None)
    matrix = np.array(element.get("transform", "1 0 0 0 1 0 0 0 1 0 0 0").split(), dtype=np.float64).reshape(4, 3)
    return (model if elsewhere is None else elsewhere.strip("/").lower(), element.attrib["objectid"]), matrix


def _named_models(model: _Model) -> set[str]:
    """Of all models whose objects a model uses; one that is named there alone may use none of a third."""
    used = [*model.built, *(part for found in model.objects.values() for part in found.parts)]
    return {name for (name, _), _ in used}


def _placed(objects: dict[Name, _Object], model: _Model, file: str) -> Iterator[tuple[Floats, Ints]]:
    """Points and faces of every body that is built, in the package's unit; faces turned over where it is mirrored."""
    n_bodies, n_triangles = 0, 0
    waiting = [(name, matrix, 0) for name, matrix in reversed(model.built)]
    while waiting:
        name, matrix, depth = waiting.pop()
        if name not in objects:
            raise UnreadableFile(file, f"builds object {name[1][:20]!r}, which it does not hold", AGAIN)
        found = objects[name]
        n_bodies, n_triangles = n_bodies + 1, n_triangles + len(found.faces)
        if depth > DEEPEST or n_bodies > MOST_BODIES or n_triangles > MOST_TRIANGLES:
            raise UnreadableFile(file, "its objects hold each other, or unfold without end", AGAIN)
        if len(found.faces):
            mirrored = np.linalg.det(matrix[:3]) < 0
            yield found.points @ matrix[:3] + matrix[3], found.faces[:, ::-1] if mirrored else found.faces
        waiting += [(part, _combined(within, matrix), depth + 1) for part, within in reversed(found.parts)]


def _combined(within: Floats, matrix: Floats) -> Floats:
    """The transform that does first what is within, then what is around it."""
    return np.vstack([within[:3] @ matrix[:3], within[3] @ matrix[:3] + matrix[3]])
