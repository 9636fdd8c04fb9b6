"""Parts for the benchmarks of three views, made by chance: machined blocks, with slanted cuts, turned out of the axes.

upright   a block with slots, pockets and bosses along the axes
slanted   besides, corners and edges cut off by slanted planes
turned    a block with cuts, the whole turned about one axis or about two
"""

from collections.abc import Callable

import manifold3d
import numpy as np

from recon.geometry.mesh import TriangleMesh
from recon.geometry.polyhedron import Polyhedron, merge_coplanar
from recon.geometry.views import DrawnView, ThreeViews

__all__ = ["KINDS", "changed", "part", "plate", "solid_volume"]

Generator = np.random.Generator


def part(kind: str, seed: int, n_features: int = 5) -> Polyhedron:
    """A part of one kind."""
    rng = np.random.default_rng(seed)
    body = KINDS[kind](rng, n_features)
    return _polyhedron(max(body.decompose(), key=lambda piece: piece.volume()))


def _upright(rng: Generator, n: int) -> manifold3d.Manifold:
    size = 5.0 * rng.integers(6, 17, 3)
    body = manifold3d.Manifold.cube(size.tolist())
    for _ in range(n):
        low = np.floor(rng.uniform(-0.3, 0.8, 3) * size / 2.5) * 2.5
        tool = manifold3d.Manifold.cube((2.5 * rng.integers(2, 9, 3)).tolist()).translate(low.tolist())
        body = body + tool if rng.random() < 0.3 and (low >= 0).any() else body - tool
    return body


def _slanted(rng: Generator, n: int) -> manifold3d.Manifold:
    body = _upright(rng, max(1, n // 2))
    low, high = np.array(body.bounding_box()).reshape(2, 3)
    for _ in range(n - n // 2):
        normal = rng.integers(-2, 3, 3).astype(float)
        if np.count_nonzero(normal) < 2:
            normal = np.array([1.0, 1.0, 2.0]) * rng.choice([-1, 1], 3)
        corner = np.where(normal > 0, high, low)
        depth = 2.5 * rng.integers(2, 6)
        body = body.trim_by_plane((-normal).tolist(), float(-(normal @ corner - depth) / np.linalg.norm(normal)))
    return body


def _turned(rng: Generator, n: int) -> manifold3d.Manifold:
    angles = rng.uniform(10, 80, 3) * (rng.random(3) < 0.6)
    if not angles.any():
        angles[2] = 30.0
    return _upright(rng, max(1, n - 2)).rotate(angles.tolist())


KINDS: dict[str, Callable[[Generator, int], manifold3d.Manifold]] = {
    "upright": _upright,
    "slanted": _slanted,
    "turned": _turned,
}


def plate(n: int, seed: int) -> Polyhedron:
    """A plate with n x n square pockets and bosses of mixed depth."""
    rng = np.random.default_rng(seed)
    body = manifold3d.Manifold.cube([20.0 * n, 20.0 * n, 30.0])
    for i, j in np.ndindex(n, n):
        depth = 5.0 * rng.integers(1, 5)
        block = manifold3d.Manifold.cube([10.0, 10.0, depth]).translate([20.0 * i + 5, 20.0 * j + 5, 0.0])
        body = (
            body + block.translate([0, 0, 30.0]) if rng.random() < 0.5 else body - block.translate([0, 0, 30 - depth])
        )
    return _polyhedron(body)


def _polyhedron(body: manifold3d.Manifold) -> Polyhedron:
    mesh = body.to_mesh64()
    points = np.asarray(mesh.vert_properties)[:, :3]
    triangles = TriangleMesh(points, np.asarray(mesh.tri_verts), "part")
    return merge_coplanar(triangles, 1e-6 * float(np.ptp(points, axis=0).max()))


def changed(drawing: ThreeViews, change: Callable[[np.ndarray], np.ndarray]) -> ThreeViews:
    """The drawing with all coordinates, (n, 2, 2) a view, changed."""
    return ThreeViews(*(DrawnView(change(view.segments), view.hidden) for _, view in drawing))


def solid_volume(solid: Polyhedron) -> float:
    """Volume by the divergence theorem."""
    total = 0.0
    origin = solid.vertices.mean(axis=0)
    for face in solid.faces:
        for loop in face.loops:
            rest = solid.vertices[list(loop)] - origin
            area = np.cross(rest[1:-1] - rest[0], rest[2:] - rest[0]).sum(axis=0)
            total += float(area @ rest[0]) / 6
    return total
