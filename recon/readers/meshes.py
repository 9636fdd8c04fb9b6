"""Mesh files into triangle meshes in millimetres, with a note on everything that was changed or looks odd.

A scan comes from any of a dozen programs, whole, cut off, in metres, as loose triangles; none of it may be misread
in silence. Every format is read into the same soup of polygons, and the soup is cleaned here:

    file -> polygons -> triangles -> equal points merged -> faces without three points dropped -> TriangleMesh
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, BadOption, UnreadableFile
from recon.geometry.mesh import TriangleMesh
from recon.numerics.equal_points import first_equal
from recon.readers.content import file_bytes
from recon.readers.polygons import PolygonSoup, triangulated

__all__ = ["MESH_ENDINGS", "MILLIMETRES", "Unit", "MeshFile", "read_mesh"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Unit = Literal["mm", "cm", "m", "inch"]

MILLIMETRES: dict[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}
MESH_ENDINGS = (".ply", ".stl", ".obj", ".off", ".3mf", ".glb", ".gltf")
OTHER_CONTENT = (
    (b"ply", "a PLY mesh"),
    (b"OFF", "an OFF mesh"),
    (b"glTF", "a GLB scene"),
    (b"PK\x03\x04", "a ZIP archive"),
    (b"%PDF", "a PDF document"),
    (b"\x89PNG", "a picture"),
    (b"version https://git-lfs", "a pointer to a file kept elsewhere"),
)


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh as read, in millimetres, and what its user should know.

    mesh      the triangles; several bodies stay in one mesh
    notes     sentences without a full stop: unit, merged and dropped parts, bodies, edges that belong to no surface
    n_bodies  pieces that hang together by edges
    """

    mesh: TriangleMesh
    notes: tuple[str, ...]
    n_bodies: int


def read_mesh(path: str | Path, *, unit: Unit | None = None) -> MeshFile:
    """Read a PLY, STL, OBJ, OFF, 3MF, GLB or glTF file.

    unit      unit of the file's numbers; None: the format's own (3MF says which, glTF is in metres), else millimetres
    Promises  vertices in millimetres, in their first order, no two of them equal, each used by a face; every change
              has its note.
    Raises    UnreadableFile, UnsupportedFormat, BadGeometry, BadOption; never anything else for a damaged file.
    """
    if unit is not None and unit not in MILLIMETRES:
        raise BadOption("unit", f"must be one of {', '.join(MILLIMETRES)}, not {unit!r}")
    file = Path(path)
    soup = _soup(file_bytes(file, MESH_ENDINGS), file)
    name = str(file)
    if len(soup.sizes) == 0:
        what = f"holds {len(soup.points)} points but no faces" if len(soup.points) else "holds no points and no faces"
        raise BadGeometry(name, f"{what}; export it as a mesh of triangles")
    faces = triangulated(soup, name)
    scale, unit_notes = _scale(soup, unit)
    points, faces, notes = _cleaned(soup.points, faces, name)
    points = points * scale
    n_bodies, shape_notes = _shape_notes(points, faces)
    if unit is None and soup.millimetres is None:
        notes += _size_notes(points)
    return MeshFile(TriangleMesh(points, faces, file.name), (*soup.notes, *unit_notes, *notes, *shape_notes), n_bodies)


def _soup(data: bytes, file: Path) -> PolygonSoup:
    """What the file holds, by the reader of its ending; a failure also says what the content looks like."""
    from recon.readers.obj import read_obj
    from recon.readers.off import read_off
    from recon.readers.ply import read_ply
    from recon.readers.scenes import read_gltf
    from recon.readers.stl import read_stl
    from recon.readers.threemf import read_3mf

    text_readers: dict[str, Callable[[bytes, str], PolygonSoup]] = {
        ".ply": read_ply,
        ".stl": read_stl,
        ".obj": read_obj,
        ".off": read_off,
    }
    ending = file.suffix.lower()
    try:
        if ending in text_readers:
            return text_readers[ending](data, str(file))
        return read_3mf(data, file) if ending == ".3mf" else read_gltf(data, file)
    except UnreadableFile as problem:
        other = _other_content(data, ending)
        if other is None:
            raise
        raise UnreadableFile(
            str(file), f"holds {other}, not what its ending {ending} says", "Name or export it rightly"
        ) from problem


def _other_content(data: bytes, ending: str) -> str | None:
    """What the first bytes give away, where they do not fit the ending."""
    start = data[:512].lstrip()
    if start.lower().startswith((b"<!doctype html", b"<html")):
        return "a web page"
    own = {".ply": b"ply", ".off": b"OFF", ".glb": b"glTF", ".gltf": b"glTF", ".3mf": b"PK\x03\x04"}.get(ending)
    return next((what for magic, what in OTHER_CONTENT if magic != own and start.startswith(magic)), None)


def _scale(soup: PolygonSoup, unit: Unit | None) -> tuple[float, tuple[str, ...]]:
    """Millimetres for one unit of the file, and what was decided."""
    own = soup.millimetres
    if unit is None:
        scale = 1.0 if own is None else own
        return scale, () if scale == 1.0 else (f"the file's unit is {scale:g} mm; the mesh was scaled to millimetres",)
    scale = MILLIMETRES[unit]
    if own is not None and own != scale:
        return scale, (f"the file says that its unit is {own:g} mm, but {unit} was asked for and taken",)
    return scale, () if scale == 1.0 else (f"the mesh was scaled from {unit} to millimetres",)


def _cleaned(points: Floats, faces: Ints, name: str) -> tuple[Floats, Ints, tuple[str, ...]]:
    """Equal points merged, faces that name a point twice dropped, points without faces dropped; each with a count."""
    counted = []
    used, compact = np.unique(faces, return_inverse=True)
    lonely = len(points) - len(used)
    representative = first_equal(points[used])
    merged = int(np.count_nonzero(representative != np.arange(len(used))))
    faces = representative[compact.reshape(-1, 3)]
    repeats = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    if repeats.all():
        raise BadGeometry(name, "none of its faces has three different points")
    kept, renumbered = np.unique(faces[~repeats], return_inverse=True)
    if merged:
        counted.append(f"{merged} points that equal another were merged with it")
    if lonely:
        counted.append(f"{lonely} points that no face uses were left out")
    if repeats.any():
        counted.append(f"{np.count_nonzero(repeats)} faces with two corners in the same point were dropped")
    # Adding zero turns -0.0 into 0.0, so that equal points stay equal when they are printed.
    return points[used][kept] + 0.0, renumbered.reshape(-1, 3), tuple(counted)


def _size_notes(points: Floats) -> tuple[str, ...]:
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    if diagonal >= 1.0:
        return ()
    return (f"the mesh measures {diagonal:.3g} mm across, so its numbers are probably metres; if so, state the unit m",)


def _shape_notes(points: Floats, faces: Ints) -> tuple[int, tuple[str, ...]]:
    """Number of bodies, and what keeps the mesh from being one oriented surface."""
    from recon.numerics.halfedges import connected_components, edge_table

    table = edge_table(faces)
    n_bodies = int(connected_components(faces, table).max()) + 1
    overused, disputed = len(table.overused()), len(table.misoriented())
    a, b, c = points[faces].transpose(1, 0, 2)
    doubled_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    flat = int(np.count_nonzero(doubled_area <= 1e-12 * np.square([b - a, c - a]).sum(axis=(0, 2))))
    notes = []
    if flat:
        notes.append(f"{flat} faces have no area; they were kept, since dropping them would open the surface")
    if n_bodies > 1:
        notes.append(f"the mesh has {n_bodies} bodies, which were kept together")
    if overused:
        notes.append(f"{overused} edges belong to three faces or more")
    if disputed:
        notes.append(f"{disputed} edges lie between faces that disagree about which side is outside")
    return n_bodies, tuple(notes)
