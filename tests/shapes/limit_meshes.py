"""Control meshes of every kind that limit surfaces become solids of: valences, genus, borders, creases, by scheme."""

from collections.abc import Iterator

import numpy as np
from hull_meshes import ball
from numpy.typing import NDArray
from quad_meshes import drum, grid, shaken, with_handles

from recon.geometry.control_mesh import ControlMesh
from recon.subdivision.limit_surface import Scheme
from recon.subdivision.semi_sharp import mesh_edges

__all__ = [
    "all_kinds",
    "bipyramid",
    "crossed",
    "dual",
    "faces_of",
    "halved",
    "kinds_of",
    "opened",
    "prism",
    "ringed",
    "semi_sharp",
]

Ints = NDArray[np.int64]
SHARPNESS = (0.6, 1.3, 2.0)


def faces_of(mesh: ControlMesh) -> list[list[int]]:
    return [face.tolist() for face in np.split(mesh.face_corners, mesh.face_starts[1:-1])]


def bipyramid(n: int, *, layers: int = 2) -> ControlMesh:
    """A closed drum of triangles between two vertices of valence n."""
    turn = 2 * np.pi * np.arange(n) / n
    rings = [
        np.column_stack([np.cos(turn + k * np.pi / n), np.sin(turn + k * np.pi / n), np.full(n, z)])
        for k, z in enumerate(np.linspace(-0.6, 0.6, layers + 1))
    ]
    points = np.concatenate([*rings, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]])
    i, j = np.arange(n), (np.arange(n) + 1) % n
    ring = np.concatenate([np.column_stack([i, j, i + n]), np.column_stack([j, j + n, i + n])])
    top, low, high = n * layers, np.full(n, len(points) - 2), np.full(n, len(points) - 1)
    ends = [np.column_stack([j, i, low]), np.column_stack([i + top, j + top, high])]
    return ControlMesh.from_faces(points, np.concatenate([*(ring + n * k for k in range(layers)), *ends]))


def prism(n: int) -> ControlMesh:
    """n quadrilaterals between two faces of n corners."""
    turn = 2 * np.pi * np.arange(n) / n
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    points = np.concatenate([np.column_stack([ring, np.full(n, z)]) for z in (0.0, 1.0)])
    sides = [[a, (a + 1) % n, (a + 1) % n + n, a + n] for a in range(n)]
    return ControlMesh.from_faces(points, [*sides, list(range(n))[::-1], list(range(n, 2 * n))])


def dual(mesh: ControlMesh) -> ControlMesh:
    """A face for every vertex of a closed mesh, through the middles of its faces."""
    faces = faces_of(mesh)
    onward: list[dict[int, int]] = [{} for _ in range(mesh.n_vertices)]
    side_face = {(a, b): f for f, face in enumerate(faces) for a, b in zip(face, face[1:] + face[:1])}
    for (a, b), f in side_face.items():
        onward[a][side_face[b, a]] = f
    loops = []
    for turn in onward:
        loop = [next(iter(turn))]
        while turn[loop[-1]] != loop[0]:
            loop.append(turn[loop[-1]])
        loops.append(loop)
    return ControlMesh.from_faces([mesh.vertices[face].mean(axis=0) for face in faces], loops)


def halved(mesh: ControlMesh, seed: int) -> ControlMesh:
    """Every quadrilateral as two triangles, along either diagonal."""
    quads = mesh.faces_of(4)
    turned = (np.random.default_rng(seed).random(len(quads)) < 0.5)[:, None]
    one = np.where(turned, quads[:, [0, 1, 2]], quads[:, [1, 2, 3]])
    return ControlMesh.from_faces(
        mesh.vertices, np.concatenate([one, np.where(turned, quads[:, [0, 2, 3]], quads[:, [1, 3, 0]])])
    )


def opened(mesh: ControlMesh, vertex: int) -> ControlMesh:
    """Without the faces around a vertex."""
    kept = [face for face in faces_of(mesh) if vertex not in face]
    used, numbers = np.unique(np.concatenate(kept), return_inverse=True)
    starts = np.concatenate([[0], np.cumsum([len(face) for face in kept])])
    return ControlMesh(mesh.vertices[used], numbers, starts)


def ringed(mesh: ControlMesh, vertex: int) -> ControlMesh:
    """With a crease all around the faces around a vertex."""
    near = [face for face in faces_of(mesh) if vertex in face]
    sides = [(a, b) for face in near for a, b in zip(face, face[1:] + face[:1]) if vertex not in (a, b)]
    return ControlMesh(mesh.vertices, mesh.face_corners, mesh.face_starts, np.array(sides))


def semi_sharp(mesh: ControlMesh, sharpness: float, seed: int) -> ControlMesh:
    """With a sixth of its edges and one vertex as sharp as that, give or take a half."""
    rng = np.random.default_rng(seed)
    ends = mesh_edges(mesh).ends
    edges = ends[rng.choice(len(ends), len(ends) // 6, replace=False)]
    marks = {"crease_edges": edges, "crease_sharpness": sharpness * rng.uniform(0.5, 1.5, len(edges))}
    return ControlMesh.from_faces(
        mesh.vertices, faces_of(mesh), **marks, corner_vertices=[0], corner_sharpness=[sharpness]
    )


def kinds_of(name: str, mesh: ControlMesh, *, semi: bool) -> Iterator[tuple[str, ControlMesh]]:
    """The closed mesh as it is, with a hole, with a crease, with both, and with semi-sharp creases."""
    last = mesh.n_vertices - 1
    yield name, mesh
    yield f"{name}, open", opened(mesh, last)
    yield f"{name}, crease", ringed(mesh, last)
    if mesh.n_faces > 40:
        yield f"{name}, open, crease", ringed(opened(mesh, last), 0)
    if semi:
        for k, sharpness in enumerate(SHARPNESS):
            yield f"{name}, sharpness {sharpness}", semi_sharp(mesh, sharpness, k)


def all_kinds() -> Iterator[tuple[Scheme, str, ControlMesh]]:
    """Every case: valences 3 to 8, genus 0 to 3, and faces of any size for the two schemes that take them."""
    quads = {f"valence {n}": shaken(drum(n, layers=3), 0.04, n) for n in range(3, 9)}
    quads |= {f"genus {g}": shaken(with_handles(g), 0.05, g) for g in range(4)}
    triangles = {f"valence {n}": shaken(bipyramid(n, layers=3), 0.02, n) for n in range(3, 9)}
    triangles |= {f"genus {g}": shaken(halved(with_handles(g), g), 0.05, g) for g in range(4)}
    triangles |= {f"hull {n}": _triangles(n) for n in (16, 40)}
    polygons = {f"prism {n}": prism(n) for n in (3, 5, 8)} | {"dual": dual(_triangles(24)), "triangles": _triangles(20)}
    for scheme, families in (
        (Scheme.CATMULL_CLARK, (quads, polygons)),
        (Scheme.DOO_SABIN, (quads, polygons)),
        (Scheme.LOOP, (triangles,)),
    ):
        for family in families:
            for name, mesh in family.items():
                for kind, made in kinds_of(name, mesh, semi=scheme != Scheme.DOO_SABIN):
                    yield scheme, kind, made
        yield scheme, "crease from border to border", crossed(scheme)


def _triangles(n: int) -> ControlMesh:
    return ControlMesh.from_faces(ball(n, n).vertices, ball(n, n).face_vertices)


def crossed(scheme: Scheme) -> ControlMesh:
    """A sheet with a crease across, and one that ends on it from the side."""
    sheet = grid(6, 6)
    through = [[7 * i + 3, 7 * i + 10] for i in range(6)]
    ending = [[21 + j, 22 + j] for j in range(3)]
    mesh = halved(sheet, 0) if scheme == Scheme.LOOP else sheet
    flat = mesh.vertices * [1.0, 1.0, 0.0] + np.column_stack(
        [np.zeros((49, 2)), 0.3 * np.abs(mesh.vertices[:, 1] - 3.0)]
    )
    edges = through + ending if scheme != Scheme.LOOP else through
    return ControlMesh.from_faces(flat, faces_of(mesh), crease_edges=edges)
