"""What two closed meshes have in common, and points spread over a mesh with the face that each lies on.

Whether one solid cuts into another is asked twice here: exactly, by the boolean product of two meshes, where both are
closed; and by points, where thousands of positions have to be tried.

V, F    numbers of vertices and faces
"""

from typing import Any, NamedTuple

import manifold3d
import numpy as np
from numpy.typing import NDArray

__all__ = ["FacePoints", "Solid", "face_points", "solid"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Solid:
    """The inside of a closed mesh; `solid` makes one and says when a mesh has no inside."""

    def __init__(self, manifold: Any) -> None:
        self._manifold = manifold

    @property
    def volume(self) -> float:
        return float(self._manifold.volume())

    def moved(self, shift: Floats) -> "Solid":
        """The solid moved by a vector (3,)."""
        return Solid(self._manifold.translate([float(x) for x in shift]))

    def common(self, other: "Solid") -> "Solid":
        """What both contain; its volume is zero where they only touch."""
        return Solid(self._manifold ^ other._manifold)

    def mesh(self) -> tuple[Floats, Ints]:
        """(V, 3) vertices and (F, 3) faces of its surface, counter-clockwise seen from outside."""
        raw = self._manifold.to_mesh64()
        return np.array(raw.vert_properties)[:, :3], np.array(raw.tri_verts).astype(np.int64)


def solid(vertices: Floats, faces: Ints) -> Solid | None:
    """The inside of a mesh, or None where the mesh is open, not manifold or inside out, and bounds none.

    Corners at equal places are joined first where the faces alone do not close the mesh.
    """
    if len(faces) == 0:
        return None
    mesh = manifold3d.Mesh64(np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.uint64))
    made = manifold3d.Manifold(mesh)
    if made.status() != manifold3d.Error.NoError and mesh.merge():
        made = manifold3d.Manifold(mesh)
    return Solid(made) if made.status() == manifold3d.Error.NoError and made.volume() > 0.0 else None


class FacePoints(NamedTuple):
    """Points on the faces of a mesh: (n, 3) places, (n, 3) unit normals of their faces, (n,) numbers of the faces, and
    (n,) areas that they stand for.
    """

    places: Floats
    normals: Floats
    faces: Ints
    areas: Floats

    def of(self, which: NDArray[np.bool_] | Ints) -> "FacePoints":
        return FacePoints(self.places[which], self.normals[which], self.faces[which], self.areas[which])


def face_points(vertices: Floats, faces: Ints, spacing: float) -> FacePoints:
    """Points on every face with area, about `spacing` apart on the large ones, and one at least on the small ones.

    Within a face they are an additive recurrence [roberts2018], the same every time.
    """
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    twice = np.linalg.norm(normal, axis=1)
    longest = np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2).max(axis=1)
    # a sliver has no area to speak of, but a length
    count = np.ceil(np.maximum(twice / (2.0 * spacing**2), longest / (2.0 * spacing))).astype(np.int64)
    face = np.repeat(np.arange(len(faces)), np.where(twice > 0.0, np.maximum(count, 1), 0))
    first = np.searchsorted(face, face)
    step = np.arange(len(face)) - first + 0.5
    r, s = (step * 0.7548776662466927) % 1.0, (step * 0.5698402909980532) % 1.0
    folded = r + s > 1.0
    r, s = np.where(folded, 1.0 - r, r)[:, None], np.where(folded, 1.0 - s, s)[:, None]
    unit = normal[face] / twice[face, None]
    areas = 0.5 * twice[face] / count[face]
    return FacePoints((1.0 - r - s) * a[face] + r * b[face] + s * c[face], unit, face, areas)
