"""Solids of true faces and triangles with common edges."""

from dataclasses import replace

import cadquery as cq
import numpy as np
import pytest

from brep_export.check import ShapeKind, check
from brep_export.mixed import RefusedFaces, mixed_solid
from recon.errors import NotManifold
from recon.geometry.analytic import Cylinder, Plane, Sphere
from recon.geometry.mixed import MixedBoundary, MixedEdge, MixedFace
from recon.tolerance import Tolerance

UP = np.array([0.0, 0.0, 1.0])
RADIUS, HEIGHT, N = 5.0, 7.0, 48


def ring(n: int, z: float) -> np.ndarray:
    angle = 2.0 * np.pi * np.arange(n) / n
    return np.column_stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), np.full(n, z)])


def can(*, first_loop_twice: bool = False) -> MixedBoundary:
    """A cylinder under a plane with a true circle between; its bottom is a fan of triangles."""
    vertices = np.concatenate([ring(N, 0.0), [[0.0, 0.0, 0.0]], [[RADIUS, 0.0, HEIGHT]]])
    circle = ring(60, HEIGHT)
    chords = [MixedEdge(k, (k + 1) % N) for k in range(N)]
    spokes = [MixedEdge(k, N) for k in range(N)]
    edges = [*chords, *spokes, MixedEdge(N + 1, N + 1, np.concatenate([circle, circle[:1]]))]
    around = tuple((k, True) for k in range(N))
    loops = (around, around) if first_loop_twice else (around, ((2 * N, False),))
    fan = [MixedFace(None, 1.0, (((k, False), (N + k, True), (N + (k + 1) % N, False)),), 0.0, 2) for k in range(N)]
    wall = MixedFace(1, 1.0, loops, 2.0 * np.pi * RADIUS * HEIGHT, 1)
    top = MixedFace(0, 1.0, (((2 * N, True),),), np.pi * RADIUS**2, 0)
    surfaces = (Plane(UP, HEIGHT), Cylinder(np.zeros(3), UP, RADIUS))
    faces = (top, wall, *fan)
    return MixedBoundary(vertices, surfaces, tuple(edges), faces, ((tuple(range(len(faces))),),), 0.02)


def test_a_wall_between_a_true_circle_and_chords_closes_a_solid():
    report = check(mixed_solid(can()), Tolerance(merge=1e-3, fit=0.05), expect=ShapeKind.SOLID)
    assert report.passed, report.defects
    polygon = 0.5 * N * RADIUS**2 * np.sin(2.0 * np.pi / N)
    assert polygon * HEIGHT < report.measures.volume < np.pi * RADIUS**2 * HEIGHT
    assert report.as_json()["faces"] == N + 2


def tube_with_a_window(middle: float) -> MixedBoundary:
    """The can with a window of four triangles in its wall, at an angle about its axis."""
    lower = can()
    angle, height = np.array([-0.3, 0.3, 0.3, -0.3]) / RADIUS + middle, np.array([3.0, 3.0, 4.0, 4.0])
    corners = np.column_stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), height])
    v, e = len(lower.vertices), len(lower.edges)
    tip = 0.9 * corners.mean(axis=0) * [1.0, 1.0, 1.0 / 0.9]
    frame = [MixedEdge(v + k, v + (k + 1) % 4) for k in range(4)]
    ribs = [MixedEdge(v + k, v + 4) for k in range(4)]
    around = tuple((e + k, False) for k in (3, 2, 1, 0))
    panes = [
        MixedFace(None, 1.0, (((e + k, True), (e + 4 + (k + 1) % 4, True), (e + 4 + k, False)),), 0.0, 3)
        for k in range(4)
    ]
    top, wall, *fan = lower.faces
    faces = (top, replace(wall, loops=(*wall.loops, around)), *fan, *panes)
    return replace(
        lower,
        vertices=np.vstack([lower.vertices, corners, tip]),
        edges=(*lower.edges, *frame, *ribs),
        faces=faces,
        bodies=((tuple(range(len(faces))),),),
    )


@pytest.mark.parametrize("degrees", [0.0, 90.0, 180.0, 270.0])
def test_a_wall_has_its_seam_beside_its_windows(degrees):
    solid = mixed_solid(tube_with_a_window(np.radians(degrees)))
    report = check(solid, Tolerance(merge=1e-3, fit=0.05), expect=ShapeKind.SOLID)
    assert report.passed, report.defects
    half = cq.Workplane(cq.Shape.cast(solid)).cut(cq.Workplane().box(20, 20, 2))
    assert half.val().isValid()


def inside_out(boundary: MixedBoundary) -> MixedBoundary:
    faces = tuple(
        replace(
            face,
            outside=face.outside if face.surface is None else -face.outside,
            loops=tuple(tuple((edge, not way) for edge, way in loop[::-1]) for loop in face.loops),
        )
        for face in boundary.faces
    )
    return replace(boundary, faces=faces)


def test_a_boundary_that_is_turned_inside_out_is_refused():
    with pytest.raises(NotManifold, match="inside out"):
        mixed_solid(inside_out(can()))


def test_a_whole_sphere_needs_no_edge():
    sphere = MixedFace(0, 1.0, (), 4.0 * np.pi * RADIUS**2, 0)
    ball = MixedBoundary(np.zeros((0, 3)), (Sphere(np.ones(3), RADIUS),), (), (sphere,), (((0,),),), 0.02)
    report = check(mixed_solid(ball), Tolerance(merge=1e-3, fit=0.05), expect=ShapeKind.SOLID)
    assert report.passed, report.defects
    assert report.measures.volume == pytest.approx(4.0 / 3.0 * np.pi * RADIUS**3)


def test_loops_that_bound_no_face_are_refused_with_their_surface():
    with pytest.raises(RefusedFaces) as refused:
        mixed_solid(can(first_loop_twice=True))
    assert refused.value.surfaces == (1,)
