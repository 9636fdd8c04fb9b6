"""Control meshes in files: OBJ, faces with as many corners as they have, creases as line elements."""

from pathlib import Path

import numpy as np

from recon.errors import NotWritten
from recon.geometry.control_mesh import ControlMesh

__all__ = ["CONTROL_MESH_ENDINGS", "write_control_mesh"]

CONTROL_MESH_ENDINGS = (".obj",)


def write_control_mesh(mesh: ControlMesh, path: str | Path, *, scheme: str) -> None:
    """Write a control mesh as OBJ, its scheme in a comment; coordinates with all their digits.

    Raises  NotWritten when the disk refuses.
    """
    lines = [f"# control mesh of a {scheme} subdivision surface"]
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    faces = np.split(mesh.face_corners + 1, mesh.face_starts[1:-1])
    lines += ["f " + " ".join(map(str, face.tolist())) for face in faces]
    lines += [f"l {a} {b}" for a, b in (mesh.crease_edges + 1).tolist()]
    try:
        Path(path).write_text("\n".join(lines) + "\n", encoding="ascii")
    except OSError as failure:
        raise NotWritten(str(path), f"the disk refuses it ({failure.strerror})") from failure
