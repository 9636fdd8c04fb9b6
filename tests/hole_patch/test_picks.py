"""Picks are set on the wall, and those of no use are refused."""

import graph_walls as gw
import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.errors import BadOption
from recon.hole_patch.picks import snapped_picks

AROUND = np.array([[15.0, 0.0, 0.0], [-9.0, 12.0, 0.0], [-9.0, -12.0, 0.0]])


def on_plane(points):
    return np.column_stack([points[:, :2], gw.plane(points[:, 0], points[:, 1])])


def test_picks_move_to_the_nearest_vertex():
    wall = gw.graph_wall(gw.plane)
    points = snapped_picks(on_plane(AROUND) + 0.2, wall)
    away = np.linalg.norm(wall.plain.vertices[:, None] - points, axis=2).min(axis=0)
    assert_allclose(away, 0.0)
    assert np.linalg.norm(points - on_plane(AROUND), axis=1).max() < 1.0


@pytest.mark.parametrize(
    ("picks", "says"),
    [
        (on_plane(AROUND) + np.array([[0, 0, 0], [0, 0, 5.0], [0, 0, 0]]), "point 2 lies"),
        (on_plane(np.array([[-12.0, 15, 0], [0, 15, 0], [12, 15, 0]])), "on a line"),
        (on_plane(AROUND[[0, 0, 1]]), "on a line"),
        (on_plane(AROUND + np.array([12.0, 0.0, 0.0])), "does not surround"),
    ],
)
def test_picks_of_no_use_are_refused_with_the_reason(picks, says):
    with pytest.raises(BadOption, match=says):
        snapped_picks(picks, gw.graph_wall(gw.plane, half=36.0, steps=73))
