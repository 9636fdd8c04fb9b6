"""Triangle meshes and point sets.

face_vertices (F, 3)   vertex numbers of each triangle, counter-clockwise seen from outside
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry
from recon.geometry.arrays import frozen_floats, frozen_ints

__all__ = ["PointSet", "TriangleMesh"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PIECE = 1 << 15  # faces worked on at once


@dataclass(frozen=True, eq=False)
class PointSet:
    """Measured points without connection; points (N, 3) in model units."""

    points: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen_floats(self.points, (None, 3), "points"))


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A surface of triangles, open or closed, as measured.

    vertices       (V, 3) in model units, finite
    face_vertices  (F, 3) vertex numbers, three different ones a face
    name           where it came from, for messages
    Raises  BadGeometry when a number is out of range or a face repeats a vertex.
    """

    vertices: Floats
    face_vertices: Ints
    name: str = field(default="mesh")

    def __post_init__(self) -> None:
        vertices = frozen_floats(self.vertices, (None, 3), f"{self.name}: vertices")
        faces = frozen_ints(self.face_vertices, (None, 3), f"{self.name}: face_vertices")
        if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
            row = int(np.argwhere((faces < 0) | (faces >= len(vertices)))[0][0])
            raise BadGeometry(self.name, f"face {row} names a vertex outside 0 to {len(vertices) - 1}")
        repeats = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
        if repeats.any():
            raise BadGeometry(self.name, f"face {int(np.argmax(repeats))} names the same vertex twice")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "face_vertices", faces)

    @property
    def n_vertices(self) -> int:
        return len(self.vertices)

    @property
    def n_faces(self) -> int:
        return len(self.face_vertices)

    def corners(self) -> Floats:
        """(F, 3, 3) the three corner points of every face."""
        return self.vertices[self.face_vertices]

    def area_vectors(self) -> Floats:
        """(F, 3) normal of every face, its length the face's area."""
        out = np.empty((self.n_faces, 3))
        # piece by piece: the corners of all faces at once are six times the vertices
        for first in range(0, self.n_faces, PIECE):
            a, b, c = self.vertices[self.face_vertices[first : first + PIECE]].transpose(1, 0, 2)
            out[first : first + PIECE] = 0.5 * np.cross(b - a, c - a)
        return out

    def volume(self) -> float:
        """Signed volume by the divergence theorem; means something for closed meshes only."""
        a, b, c = (self.corners() - self.vertices.mean(axis=0)).transpose(1, 0, 2)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    def moved(self, matrix: Floats) -> "TriangleMesh":
        """The mesh under a (4, 4) affine matrix."""
        return TriangleMesh(self.vertices @ matrix[:3, :3].T + matrix[:3, 3], self.face_vertices, self.name)

    def part(self, faces: NDArray[np.bool_] | Ints) -> "TriangleMesh":
        """The given faces alone, vertices renumbered in their old order."""
        kept = self.face_vertices[faces]
        used, renumbered = np.unique(kept, return_inverse=True)
        return TriangleMesh(self.vertices[used], renumbered.reshape(-1, 3), self.name)
