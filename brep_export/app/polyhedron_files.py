"""A polyhedron as it is, without a kernel: vertices, edges and faces as OBJ or JSON text.

OBJ knows no holes in faces: there a face with holes is written in triangles.
"""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from recon.geometry.mesh import TriangleMesh
from recon.geometry.polyhedron import Polyhedron
from recon.version import __version__

__all__ = ["POLYHEDRON_ENDINGS", "polyhedron_writer"]

POLYHEDRON_ENDINGS = (".obj", ".json")


def polyhedron_writer(path: str | Path, solid: Polyhedron, mesh: TriangleMesh) -> Callable[[Path], None]:
    """What writes the polyhedron in the format of a path's ending; `mesh` are its triangles."""
    text = _json(solid) if Path(path).suffix.lower() == ".json" else _obj(solid, mesh)
    return lambda place: (place.write_text(text, encoding="utf-8"), None)[1]


def _edges(solid: Polyhedron) -> list[list[int]]:
    """Vertex pairs, each once, the smaller number first."""
    loops = [loop for face in solid.faces for loop in face.loops]
    pairs = {(min(a, b), max(a, b)) for loop in loops for a, b in zip(loop, (*loop[1:], loop[0]))}
    return [list(pair) for pair in sorted(pairs)]


def _json(solid: Polyhedron) -> str:
    content = {
        "made_by": f"recon-brep {__version__}",
        "vertices": solid.vertices.tolist(),
        "edges": _edges(solid),
        "faces": [{"outer": list(face.outer), "holes": [list(hole) for hole in face.holes]} for face in solid.faces],
        "bodies": [[list(shell) for shell in body] for body in solid.bodies],
    }
    return json.dumps(content) + "\n"


def _obj(solid: Polyhedron, mesh: TriangleMesh) -> str:
    lines = [f"# recon-brep {__version__}"]
    if any(face.holes for face in solid.faces):
        points, faces = mesh.vertices, [row.tolist() for row in mesh.face_vertices]
    else:
        points, faces = solid.vertices, [list(face.outer) for face in solid.faces]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in np.asarray(points).tolist()]
    lines += ["f " + " ".join(str(v + 1) for v in face) for face in faces]
    return "\n".join(lines) + "\n"
