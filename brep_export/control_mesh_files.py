"""Control meshes in files: OBJ, faces with as many corners as they have, creases as line elements.

Semi-sharp creases and all corners are tags, as OpenSubdiv writes them; these count points from 0.
"""

from pathlib import Path

import numpy as np

from recon.errors import NotWritten
from recon.geometry.control_mesh import ControlMesh

__all__ = ["CONTROL_MESH_ENDINGS", "write_control_mesh"]

CONTROL_MESH_ENDINGS = (".obj",)
FOR_EVER = 10.0  # sharpness that never ends


def write_control_mesh(mesh: ControlMesh, path: str | Path, *, scheme: str) -> None:
    """Write a control mesh as OBJ, its scheme in a comment; coordinates with all their digits.

    Raises  NotWritten when the disk refuses.
    """
    lines = [f"# control mesh of a {scheme} subdivision surface"]
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    faces = np.split(mesh.face_corners + 1, mesh.face_starts[1:-1])
    lines += ["f " + " ".join(map(str, face.tolist())) for face in faces]
    firm = np.isinf(mesh.crease_sharpness)
    lines += [f"l {a} {b}" for a, b in (mesh.crease_edges[firm] + 1).tolist()]
    semi_sharp = zip(mesh.crease_edges[~firm].tolist(), mesh.crease_sharpness[~firm].tolist())
    lines += [f"t crease 2/1/0 {a} {b} {s!r}" for (a, b), s in semi_sharp]
    corners = zip(mesh.corner_vertices.tolist(), np.minimum(mesh.corner_sharpness, FOR_EVER).tolist())
    lines += [f"t corner 1/1/0 {vertex} {s!r}" for vertex, s in corners]
    try:
        Path(path).write_text("\n".join(lines) + "\n", encoding="ascii")
    except OSError as failure:
        raise NotWritten(str(path), f"the disk refuses it ({failure.strerror})") from failure
