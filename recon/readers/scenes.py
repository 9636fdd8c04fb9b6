"""3MF and glTF files: scenes of meshes placed by transformations, read by trimesh.

What trimesh passes over without a word (compressed meshes, triangle fans, cut-off containers) is looked for first.
"""

import io
import json
import logging
import lzma
import struct
import warnings
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from recon.errors import UnreadableFile
from recon.readers.polygons import PolygonSoup
from recon.readers.unpacking import require_plausible_size

__all__ = ["read_3mf", "read_gltf"]

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
COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
LARGEST_COUNT = 1 << 28  # rows of an accessor: one without a buffer is filled with zeros, as many as it says
FANS = 6
DAMAGED_ARCHIVE = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error),
    *(EOFError, NotImplementedError, RuntimeError, ValueError, OSError, KeyError),
)
AGAIN = "Export or copy the file again"


def read_3mf(data: bytes, path: Path) -> PolygonSoup:
    """Triangles of all objects that a 3MF file builds, where it builds them, with its unit.

    Raises  UnreadableFile when the archive or the model in it is damaged, or its unit is unknown.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            parts = archive.infolist()
            damaged = None if sum(part.file_size for part in parts) > LARGEST_PART else archive.testzip()
    except DAMAGED_ARCHIVE as problem:
        raise UnreadableFile(str(path), "is not a whole 3MF archive", AGAIN) from problem
    if sum(part.file_size for part in parts) > LARGEST_PART:
        raise UnreadableFile(str(path), "would unpack to more than four gigabytes", AGAIN)
    require_plausible_size(str(path), len(data), sum(part.file_size for part in parts))
    if damaged is not None or not any("3d/3dmodel.model" in part.filename.lower() for part in parts):
        raise UnreadableFile(str(path), "has no undamaged 3D model in its archive", AGAIN)
    shapes, unit = _load(data, path, "3mf")
    if unit not in MILLIMETRES:
        raise UnreadableFile(str(path), f"names the unknown unit {unit[:20]!r}", f"Use one of {', '.join(MILLIMETRES)}")
    return _soup(shapes, MILLIMETRES[unit])


def read_gltf(data: bytes, path: Path) -> PolygonSoup:
    """Triangles of all meshes in the scene of a GLB or glTF file, where it places them, in metres by definition.

    Raises  UnreadableFile when the container is cut off, or a mesh is compressed or made of triangle fans.
    """
    tree = _gltf_tree(data, path)
    used = {str(word) for key in ("extensionsUsed", "extensionsRequired") for word in _items(tree, key)}
    for extension in COMPRESSED:
        if extension in used:
            raise UnreadableFile(str(path), f"holds compressed meshes ({extension})", "Export it without compression")
    if any(isinstance(a, dict) and not 0 <= a.get("count", 0) <= LARGEST_COUNT for a in _items(tree, "accessors")):
        raise UnreadableFile(str(path), "promises more numbers than any file holds", AGAIN)
    primitives = [p for mesh in _items(tree, "meshes") if isinstance(mesh, dict) for p in _items(mesh, "primitives")]
    if any(isinstance(p, dict) and p.get("mode") == FANS for p in primitives):
        raise UnreadableFile(str(path), "holds triangle fans, which are not read here", "Export it in triangles")
    shapes, _ = _load(data, path, "glb" if data[:4] == b"glTF" else "gltf")
    return _soup(shapes, 1000.0)


def _gltf_tree(data: bytes, path: Path) -> dict[str, Any]:
    """The JSON part, after a check that a binary container is as long as it says."""
    text = data
    if data[:4] == b"glTF":
        if len(data) < 20 or int.from_bytes(data[8:12], "little") > len(data):
            raise UnreadableFile(str(path), "is shorter than its header says", AGAIN)
        text = data[20 : 20 + int.from_bytes(data[12:16], "little")]
    elif path.suffix.lower() == ".glb":
        raise UnreadableFile(str(path), "is not a GLB file: it does not begin with glTF", AGAIN)
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as problem:
        raise UnreadableFile(str(path), "is not a glTF file: its JSON part cannot be read", AGAIN) from problem
    if not isinstance(tree, dict) or "asset" not in tree:
        raise UnreadableFile(str(path), "is not a glTF file: it has no asset entry", AGAIN)
    return tree


def _items(tree: dict[str, Any], key: str) -> list[Any]:
    found = tree.get(key)
    return found if isinstance(found, list) else []


def _load(data: bytes, path: Path, kind: str) -> tuple[list[Any], str]:
    """The shapes that trimesh finds in a file, each where the scene places it, and their unit, without noise."""
    import trimesh  # half a second: only for the formats that need it

    logging.getLogger("trimesh").addHandler(logging.NullHandler())
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            resolver = trimesh.resolvers.FilePathResolver(str(path))
            scene = trimesh.load_scene(
                io.BytesIO(data), file_type=kind, resolver=resolver, process=False, skip_materials=True
            )
            return list(scene.dump()), str(scene.metadata.get("units", "millimeter"))
    except Exception as problem:
        detail = f"{type(problem).__name__}: {problem}".split("\n")[0][:120]
        raise UnreadableFile(str(path), f"cannot be read as {path.suffix[1:].upper()} ({detail})", AGAIN) from problem


def _soup(shapes: list[Any], millimetres: float) -> PolygonSoup:
    """All meshes among the shapes; what is no mesh (lines, points) is counted in a note."""
    points, faces, first, skipped = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], 0, 0
    for shape in shapes:
        if not hasattr(shape, "faces"):
            skipped += 1
            continue
        points.append(np.asarray(shape.vertices, dtype=np.float64))
        faces.append(np.asarray(shape.faces, dtype=np.int64) + first)
        first += len(points[-1])
    corners = np.concatenate(faces)
    notes = (f"{skipped} sets of lines or points in the scene were left out",) if skipped else ()
    return PolygonSoup(np.concatenate(points), corners.ravel(), np.full(len(corners), 3), notes, millimetres)
