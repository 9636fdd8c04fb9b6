"""Triangles in files: STL and 3MF for printing, GLB for looking at.

STL   binary, 32-bit coordinates; it names no unit, and printing programs take its numbers for millimetres: so they are
3MF   a zip package with the unit inside; millimetres, or what the header says
GLB   in metres and with +Y up, as its specification wants [gltf2]: (x, y, z) -> (x, z, -y), scaled from the unit
"""

import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from brep_export.file_header import ORIGIN, FileHeader, LengthUnit
from brep_export.read_back import ReadBack
from recon.errors import NotWritten, UnsupportedFormat
from recon.geometry.mesh import TriangleMesh
from recon.geometry.promises import Defect

__all__ = ["MESH_ENDINGS", "write_mesh"]

_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_MIRROR_FREE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # a turn, so that outside stays outside


def write_mesh(
    mesh: TriangleMesh,
    path: str | Path,
    *,
    header: FileHeader = FileHeader(),  # noqa: B008  (frozen)
    colours: NDArray[np.uint8] | None = None,
) -> ReadBack:
    """Write triangles to exactly this path in the format of its ending, read them again, and compare.

    colours   (V, 4) red, green, blue and opacity of the vertices, which GLB alone holds; or None
    Promises  the number of triangles and, for a closed mesh, the volume are the same but for 32-bit rounding.
    Raises    UnsupportedFormat for another ending; NotWritten when there is no triangle or the disk refuses.
    """
    path = Path(path)
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise UnsupportedFormat(str(path), MESH_ENDINGS)
    if mesh.n_faces == 0:
        raise NotWritten(str(path), "there are no triangles to write")
    try:
        scale = writer(mesh, path, header) if colours is None else _write_coloured(mesh, path, header, colours)
    except OSError as failure:
        raise NotWritten(str(path), f"the disk refuses it ({failure.strerror})") from failure
    return _read_again(mesh, path, scale)


def _write_stl(mesh: TriangleMesh, path: Path, header: FileHeader) -> float:
    records = np.zeros(mesh.n_faces, dtype=_RECORD)
    normals = mesh.area_vectors()
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    records["normal"] = normals / np.where(length > 0.0, length, 1.0)
    scale = 1000.0 * header.unit.in_metres
    records["corners"] = scale * mesh.corners()
    # a header that begins with `solid` is taken for the text form
    title = f"{ORIGIN} {header.name}".encode("ascii", "replace")[:80].ljust(80)
    path.write_bytes(title + np.uint32(mesh.n_faces).tobytes() + records.tobytes())
    return scale


_THREE_MF_UNITS = {LengthUnit.MILLIMETRE: "millimeter", LengthUnit.METRE: "meter", LengthUnit.INCH: "inch"}

_CONTENT_TYPES = """<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>"""

_RELATIONSHIPS = """<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Id="rel0" Target="/3D/3dmodel.model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>"""


def _write_3mf(mesh: TriangleMesh, path: Path, header: FileHeader) -> float:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as package:
        _put(package, "[Content_Types].xml", _CONTENT_TYPES)
        _put(package, "_rels/.rels", _RELATIONSHIPS)
        _put(package, "3D/3dmodel.model", _three_mf_model(mesh, header))
    return 1.0


def _put(package: zipfile.ZipFile, name: str, text: str) -> None:
    """A part without the time of its writing, which would make other bytes of the same mesh."""
    part = zipfile.ZipInfo(name)  # of 1980
    part.external_attr = 0o644 << 16
    package.writestr(part, text, zipfile.ZIP_DEFLATED)


def _three_mf_model(mesh: TriangleMesh, header: FileHeader) -> str:
    vertices = "\n".join(f'<vertex x="{x:.10g}" y="{y:.10g}" z="{z:.10g}"/>' for x, y, z in mesh.vertices.tolist())
    triangles = "\n".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in mesh.face_vertices.tolist())
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<model unit="{_THREE_MF_UNITS[header.unit]}" xml:lang="en" \
xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">
<metadata name="Application">{ORIGIN}</metadata>
<resources><object id="1" type="model" name={quoteattr(header.name)}><mesh>
<vertices>
{vertices}
</vertices>
<triangles>
{triangles}
</triangles>
</mesh></object></resources>
<build><item objectid="1"/></build>
</model>"""


def _write_coloured(mesh: TriangleMesh, path: Path, header: FileHeader, colours: NDArray[np.uint8]) -> float:
    writer = _WRITERS[path.suffix.lower()]
    return _write_glb(mesh, path, header, colours) if writer is _write_glb else writer(mesh, path, header)


def _write_glb(mesh: TriangleMesh, path: Path, header: FileHeader, colours: NDArray[np.uint8] | None = None) -> float:
    import trimesh

    scale = header.unit.in_metres
    turned = scale * mesh.vertices @ _MIRROR_FREE.T
    scene = trimesh.Scene()
    body = trimesh.Trimesh(turned, mesh.face_vertices, vertex_colors=colours, process=False)
    scene.add_geometry(body, geom_name=header.name)
    path.write_bytes(scene.export(file_type="glb"))
    return scale


_WRITERS: dict[str, Callable[[TriangleMesh, Path, FileHeader], float]] = {
    ".stl": _write_stl,
    ".3mf": _write_3mf,
    ".glb": _write_glb,
}
MESH_ENDINGS = tuple(_WRITERS)


def _read_again(mesh: TriangleMesh, path: Path, scale: float) -> ReadBack:
    import trimesh

    back = trimesh.load(path, force="mesh", process=False)
    defects = []
    if len(back.faces) != mesh.n_faces:
        what = "the number of triangles is another after reading"
        defects.append(Defect("read-back-count", what, None, float(len(back.faces)), float(mesh.n_faces)))
    written, read = _volume(mesh.corners()), _volume(np.asarray(back.triangles, dtype=np.float64)) / scale**3
    if abs(read - written) > _rounding(mesh):
        defects.append(Defect("read-back-volume", "the volume is another after reading", None, read, written))
    return ReadBack(not defects, abs(read - written) / max(abs(written), 1e-300), tuple(defects))


def _volume(corners: NDArray[np.float64]) -> float:
    """Volume between (F, 3, 3) triangles and their mean corner: of an open mesh too it stays when the mesh moves."""
    a, b, c = (corners - corners.mean(axis=(0, 1))).transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def _rounding(mesh: TriangleMesh) -> float:
    """The largest change of volume that 32-bit coordinates can make: area times half a step of the largest one."""
    area = float(np.linalg.norm(mesh.area_vectors(), axis=1).sum())
    return 4.0 * area * float(np.abs(mesh.vertices).max()) * 2.0**-23
