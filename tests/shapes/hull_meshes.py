"""Triangle meshes made for the tests: irregular balls, discs with a border, tori."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, Delaunay

from recon.geometry.mesh import TriangleMesh

Floats = NDArray[np.float64]


def ball(n: int, seed: int) -> TriangleMesh:
    """Random points on the unit sphere, joined as their convex hull: valences from 3 up."""
    points = np.random.default_rng(seed).normal(size=(n, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces = ConvexHull(points).simplices.astype(np.int64)
    corners = points[faces]
    inward = (
        np.einsum("ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners[:, 0]) < 0
    )
    faces[inward] = faces[inward][:, ::-1]
    return TriangleMesh(points, faces, "ball")


def disc(n: int, seed: int) -> TriangleMesh:
    """Random points over a square, joined as their Delaunay triangles, with a wave for height."""
    plan = np.random.default_rng(seed).random((n, 2))
    faces = Delaunay(plan).simplices.astype(np.int64)
    a, b, c = plan[faces].transpose(1, 0, 2)
    clockwise = np.cross(np.pad(b - a, ((0, 0), (0, 1))), np.pad(c - a, ((0, 0), (0, 1))))[:, 2] < 0
    faces[clockwise] = faces[clockwise][:, ::-1]
    height = 0.2 * np.sin(3.0 * plan[:, 0]) * np.cos(2.0 * plan[:, 1])
    return TriangleMesh(np.column_stack([plan, height]), faces, "disc")


def bumpy_ball(n: int, *, height: float = 0.15) -> TriangleMesh:
    """A sphere with waves, about n points spread evenly (Fibonacci)."""
    k = np.arange(n) + 0.5
    z, turn = 1.0 - 2.0 * k / n, np.pi * (1.0 + np.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - z * z)
    unit = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
    faces = ConvexHull(unit).simplices.astype(np.int64)
    corners = unit[faces]
    inward = (
        np.einsum("ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners[:, 0]) < 0
    )
    faces[inward] = faces[inward][:, ::-1]
    radius = 1.0 + height * np.sin(4.0 * unit[:, 0]) * np.cos(3.0 * unit[:, 1]) * np.sin(2.0 * unit[:, 2] + 1.0)
    return TriangleMesh(unit * radius[:, None], faces, "bumpy ball")
