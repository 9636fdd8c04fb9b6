"""glTF files: scenes of meshes placed by transformations, read by trimesh.

What trimesh passes over without a word (compressed, sparse, morphed or repeated meshes, triangle fans, cut-off
containers, whatever hangs on a camera) is looked for first.
"""

import io
import json
import logging
import struct
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from recon.errors import UnreadableFile
from recon.readers.polygons import PolygonSoup, together

__all__ = ["read_gltf"]

MILLIMETRES = 1000.0  # of the format's unit, the metre

COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
REPEATED = "EXT_mesh_gpu_instancing"
HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_", "KHR_mesh_quantization")
LARGEST_COUNT = 1 << 28  # rows of an accessor: one without a buffer is filled with zeros, as many as it says
FANS = 6
AGAIN = "Export or copy the file again"


def read_gltf(data: bytes, path: Path) -> PolygonSoup:
    """Triangles of all meshes in the scene of a GLB or glTF file, where it places them, in metres by definition.

    Raises  UnreadableFile when the container is cut off, or holds meshes as `_unread` says.
    """
    tree = _gltf_tree(data, path)
    counts = [accessor.get("count", 0) for accessor in _dicts(tree, "accessors")]
    if not all(isinstance(count, int) and 0 <= count <= LARGEST_COUNT for count in counts):
        raise UnreadableFile(str(path), "promises more numbers than any file holds", AGAIN)
    for what, instead in _unread(tree):
        raise UnreadableFile(str(path), f"holds {what}, which are not read here", instead)
    if any("camera" in node for node in _dicts(tree, "nodes")):
        data = _without_cameras(data, tree)
    return _soup(_load(data, path, "glb" if data[:4] == b"glTF" else "gltf"), str(path))


def _unread(tree: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """What a file holds that would be read as something else or left out, and how to export it."""
    required = {str(word) for word in _items(tree, "extensionsRequired")}
    used = {str(word) for word in _items(tree, "extensionsUsed")} | required
    for extension in sorted(used.intersection(COMPRESSED)):
        yield f"compressed meshes ({extension})", "Export it without compression"
    if REPEATED in used:
        yield f"meshes in many places ({REPEATED})", "Export each as a node of its own"
    for extension in sorted(word for word in required if not word.startswith(HARMLESS)):
        yield f"parts that need {extension[:60]}", "Export it as plain triangles"
    meshes = _dicts(tree, "meshes")
    primitives = [primitive for mesh in meshes for primitive in _dicts(mesh, "primitives")]
    if any(primitive.get("mode") == FANS for primitive in primitives):
        yield "triangle fans", "Export it in triangles"
    if any(any(_items(part, "weights")) for part in (*meshes, *_dicts(tree, "nodes"))):
        yield "morphed meshes", "Export them in the shape that they take"
    attributes = [a for primitive in primitives if isinstance(a := primitive.get("attributes"), dict)]
    named = {str(a.get("POSITION")) for a in attributes} | {str(p.get("indices")) for p in primitives}
    accessors = [a for k, a in enumerate(_items(tree, "accessors")) if isinstance(a, dict) and str(k) in named]
    if any("sparse" in accessor or accessor.get("normalized") for accessor in accessors):
        yield "sparse or quantized points", "Export it with all points as floats"


def _without_cameras(data: bytes, tree: dict[str, Any]) -> bytes:
    """The file again, with nodes that are no cameras: of one that is, trimesh leaves out its mesh and its children."""
    nodes = [{k: v for k, v in n.items() if k != "camera"} if isinstance(n, dict) else n for n in tree["nodes"]]
    text = json.dumps(tree | {"nodes": nodes}).encode()
    if data[:4] != b"glTF":
        return text
    text += b" " * (-len(text) % 4)
    rest = data[20 + int.from_bytes(data[12:16], "little") :]
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON") + text + rest


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


def _dicts(tree: dict[str, Any], key: str) -> list[dict[str, Any]]:
    return [item for item in _items(tree, key) if isinstance(item, dict)]


def _load(data: bytes, path: Path, kind: str) -> list[Any]:
    """The shapes that trimesh finds in a file, each where the scene places it, without noise."""
    import trimesh  # half a second: only for the formats that need it

    logging.getLogger("trimesh").addHandler(logging.NullHandler())
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            resolver = trimesh.resolvers.FilePathResolver(str(path))
            scene = trimesh.load_scene(
                io.BytesIO(data), file_type=kind, resolver=resolver, process=False, skip_materials=True
            )
            return list(scene.dump())
    except Exception as problem:
        detail = f"{type(problem).__name__}: {problem}".split("\n")[0][:120]
        raise UnreadableFile(str(path), f"cannot be read as {path.suffix[1:].upper()} ({detail})", AGAIN) from problem


def _soup(shapes: list[Any], name: str) -> PolygonSoup:
    """All meshes among the shapes; what is no mesh (lines, points) is counted in a note."""
    meshes = [shape for shape in shapes if hasattr(shape, "faces")]
    skipped = len(shapes) - len(meshes)
    bodies = [(np.asarray(m.vertices, dtype=np.float64), np.asarray(m.faces, dtype=np.int64)) for m in meshes]
    notes = (f"{skipped} sets of lines or points in the scene were left out",) if skipped else ()
    return together(bodies, name, millimetres=MILLIMETRES, notes=notes)
