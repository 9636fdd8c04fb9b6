"""Wall or fracture, outer or inner; the walls as meshes."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.assembly import Assembly, assemble, steady_normals
from recon.hole_patch.axis import wheel_axis
from recon.hole_patch.fracture import mated_faces, wall_thickness
from recon.hole_patch.sample_vessel import BrokenVessel, VesselOptions, broken_vessel
from recon.hole_patch.surroundings import Axis
from recon.hole_patch.walls import FRACTURE, INNER, OUTER, fracture_faces, label_walls, spread, wall_mesh, wall_trust
from recon.numerics.distance import closest_points

OPTIONS = VesselOptions(edge=2.0, seed=3)


@cache
def vessel() -> BrokenVessel:
    return broken_vessel(OPTIONS)


@cache
def read() -> tuple[Assembly, np.ndarray, Axis, float]:
    """The sample vessel's faces, their steady normals, its axis and the thickness of its wall."""
    table = assemble(vessel().sherds)
    normals = steady_normals(table)
    axis = wheel_axis(table.centres, normals, table.areas)
    assert axis is not None
    return table, normals, axis, wall_thickness(table)


@cache
def labelled() -> tuple[Assembly, np.ndarray, np.ndarray]:
    """The sample vessel's faces, which of them have a neighbour's fracture against them, and their labels."""
    table, normals, axis, thickness = read()
    mated = mated_faces(table, normals, 0.4 * thickness)
    fracture, doubtful = fracture_faces(table, normals, axis, mated=mated, thickness=thickness)
    return table, mated, label_walls(table, normals, axis, fracture=fracture, doubtful=doubtful, thickness=thickness)


def grid(n: int) -> TriangleMesh:
    """A flat square of 2 n² triangles."""
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0), indexing="ij")
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    lower = np.stack([corner, corner + n + 1, corner + 1], axis=1)
    upper = np.stack([corner + 1, corner + n + 1, corner + n + 2], axis=1)
    return TriangleMesh(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), np.concatenate([lower, upper]))


def test_spreading_obeys_the_maximum_principle():
    table = assemble([grid(12)])
    chance = np.random.default_rng(4)
    guess = 0.2 + 0.5 * chance.random(table.n_faces)
    found = spread(table, table.normals, guess=guess, belief=np.full(table.n_faces, 0.01))
    assert found.min() >= guess.min() - 1e-3
    assert found.max() <= guess.max() + 1e-3


def test_spreading_leaves_a_constant_as_it_is():
    table = assemble([grid(6)])
    assert_allclose(spread(table, table.normals, guess=np.full(72, 0.7), belief=np.full(72, 0.1)), 0.7, atol=1e-9)


def test_a_guess_does_not_cross_a_crease():
    flat = grid(10)
    bent = flat.vertices.copy()
    beyond = bent[:, 0] > 5
    bent[beyond, 2], bent[beyond, 0] = bent[beyond, 0] - 5, 5.0
    table = assemble([TriangleMesh(bent, flat.face_vertices)])
    upright = np.abs(table.normals[:, 2]) < 0.5
    known = np.zeros(table.n_faces)
    known[np.flatnonzero(upright)[0]] = known[np.flatnonzero(~upright)[0]] = 0.5
    found = spread(table, table.normals, guess=upright.astype(float) * (known > 0), belief=known)
    assert found[upright].min() > 0.9
    assert found[~upright].max() < 0.1


def test_thickness_of_the_wall_is_found():
    table, _, labels = labelled()
    assert_allclose(wall_thickness(table, labels == FRACTURE), OPTIONS.thickness, rtol=0.1)


def test_faces_against_a_neighbour_are_fracture_but_for_wall_beside_the_crack():
    table, mated, labels = labelled()
    assert table.areas[mated & (labels == FRACTURE)].sum() > 0.8 * table.areas[mated].sum()
    beside = table.centres[mated & (labels != FRACTURE)]
    away = closest_points(beside, vessel().plain.vertices, vessel().plain.face_vertices).distances
    assert np.quantile(away, 0.9) < OPTIONS.relief + 3.0 * OPTIONS.misplacement


def test_walls_have_the_area_of_the_vessel_without_the_lost_sherd():
    table, _, labels = labelled()
    radius = np.hypot(table.centres[:, 0], table.centres[:, 1])
    outer, inner = (table.areas[labels == side].sum() for side in (OUTER, INNER))
    whole = np.linalg.norm(vessel().plain.area_vectors(), axis=1).sum()
    lost = 2.0 * vessel().lost.volume() / OPTIONS.thickness
    assert_allclose(outer + inner, whole - lost, rtol=0.05)  # cords add a few per cent
    assert inner < outer
    assert radius[labels == INNER].max() < radius[labels == OUTER].max()


def test_outer_wall_faces_away_from_the_axis_and_inner_towards_it():
    table, _, labels = labelled()
    upright = (np.abs(table.normals[:, 2]) < 0.5) & (table.centres[:, 2] < 60)
    out = (table.normals[:, :2] * table.centres[:, :2]).sum(axis=1) > 0
    for side, expected in ((OUTER, out), (INNER, ~out)):
        here = upright & (labels == side)
        assert table.areas[here & expected].sum() > 0.99 * table.areas[here].sum()


@pytest.mark.parametrize(("doubt", "expected"), [(True, INNER), (False, FRACTURE)])
def test_fracture_far_from_the_outer_wall_is_a_lump_where_it_is_doubtful(doubt: bool, expected: int) -> None:
    _, _, labels = labelled()
    table, normals, axis, thickness = read()
    seed = table.centres[np.argmin(np.linalg.norm(table.centres[:, :2], axis=1) + 1e3 * (labels != INNER))]
    patch = (labels == INNER) & (np.linalg.norm(table.centres - seed, axis=1) < 1.5 * thickness)
    fracture = (labels == FRACTURE) | patch
    again = label_walls(table, normals, axis, fracture=fracture, doubtful=patch & doubt, thickness=thickness)
    areas = table.areas[patch]
    assert areas[again[patch] == expected].sum() > 0.9 * areas.sum()


@pytest.mark.parametrize("turned", [False, True])
def test_two_fans_at_one_point_get_a_vertex_each(turned):
    bow_tie = TriangleMesh([[0, 0, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], [[0, 1, 2], [0, 3, 4]])
    wall, sherds = wall_mesh(assemble([bow_tie]), np.array([True, True]), turned=turned)
    assert wall.n_vertices == 6
    assert list(sherds) == [0] * 6
    assert_allclose(wall.area_vectors()[:, 2], -1.0 if turned else 1.0)


def test_a_whole_patch_keeps_its_vertices():
    table = assemble([grid(5)])
    wall, _ = wall_mesh(table, np.ones(table.n_faces, dtype=bool), turned=False)
    assert wall.n_vertices == 36


def test_trust_is_nothing_on_the_border_and_whole_far_from_it():
    flat = grid(10)
    trust = wall_trust(flat, reach=3.0)
    x, y = flat.vertices[:, :2].T
    inside = np.minimum(np.minimum(x, 10 - x), np.minimum(y, 10 - y))
    assert (trust[inside == 0] == 0).all()
    assert (trust[inside >= 3] == 1).all()
    assert (np.diff(trust[np.argsort(inside, kind="stable")]) >= -1e-12).all()
