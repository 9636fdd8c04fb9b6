import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from recon.errors import NotManifold
from recon.numerics.closed_mesh import nested_shells, opposite_halfedges, shell_volumes, winding_number

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
CORNERS = POINTS[FACES]


def test_the_opposite_of_the_opposite_is_the_half_edge_itself_and_runs_the_other_way():
    twin = opposite_halfedges(POINTS, FACES)
    start, end = FACES.ravel(), np.roll(FACES, -1, axis=1).ravel()
    assert_array_equal(twin[twin], np.arange(12))
    assert_array_equal(start[twin], end)
    assert (twin // 3 != np.arange(12) // 3).all()


@pytest.mark.parametrize(
    ("faces", "problem"),
    [
        (FACES[:3], "open"),
        (np.concatenate([FACES, FACES[:1]]), "3 faces"),
        (np.concatenate([FACES[:3], FACES[3:, ::-1]]), "same direction"),
    ],
)
def test_what_is_no_closed_surface_is_refused_with_a_place(faces, problem):
    with pytest.raises(NotManifold, match=problem) as refusal:
        opposite_halfedges(POINTS, faces)
    assert refusal.value.where is not None


@pytest.mark.parametrize(("point", "expected"), [((0.1, 0.1, 0.1), 1), ((1, 1, 1), 0), ((-0.1, 0.2, 0.2), 0)])
def test_the_winding_number_tells_inside_from_outside(point, expected):
    assert_allclose(winding_number(np.array(point), CORNERS), expected, atol=1e-12)
    assert_allclose(winding_number(np.array(point), CORNERS[:, ::-1]), -expected, atol=1e-12)


@pytest.mark.parametrize("point", [(0.2, 0.3, 1e-9), (1e-9, 1e-9, 1e-9), (0.3, 1e-9, 1e-9)])
def test_the_winding_number_is_one_right_up_to_a_face_a_corner_and_an_edge(point):
    assert_allclose(winding_number(np.array(point), CORNERS), 1, atol=1e-7)


def test_volumes_of_shells_are_signed():
    both = np.concatenate([CORNERS, 0.5 * CORNERS[:, ::-1] + 5])
    assert_allclose(shell_volumes(both, np.repeat([0, 1], 4)), [1 / 6, -1 / 48], rtol=1e-12)


def nest(*scales_and_turns):
    """Tetrahedra of growing smallness about one point, some turned inside out."""
    centre = np.array([0.2, 0.2, 0.2])
    shells = [((CORNERS - centre) * scale + centre)[:, ::way] for scale, way in scales_and_turns]
    return np.concatenate(shells), np.repeat(np.arange(len(shells)), 4)


def test_shells_nest_body_void_body_void():
    assert nested_shells(*nest((8, 1), (4, -1), (2, 1), (1, -1))) == [(0, 1), (2, 3)]


def test_a_body_may_have_several_voids_and_come_after_them():
    corners, shell = nest((1, -1), (20, 1))
    other = CORNERS[:, ::-1] + [3, 0.5, 0.5]
    corners, shell = np.concatenate([corners, other]), np.append(shell, [2] * 4)
    assert nested_shells(corners, shell) == [(1, 0, 2)]


@pytest.mark.parametrize(
    ("shells", "problem"),
    [(((1, -1),), "inside out"), (((4, 1), (1, 1)), "material of another"), (((8, 1), (4, -1), (2, -1)), "inside out")],
)
def test_shells_that_make_no_bodies_are_refused(shells, problem):
    with pytest.raises(NotManifold, match=problem):
        nested_shells(*nest(*shells))
