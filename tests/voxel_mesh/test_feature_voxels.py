"""Feature voxels against the definition, written out by brute force."""

import numpy as np
import pytest
from scipy import ndimage

from recon.geometry.voxel_grid import VoxelGrid
from recon.voxel_mesh.feature_voxels import closed, feature_voxels, opened


def ball(radius, proportions):
    reach = np.floor(radius / np.asarray(proportions)).astype(int)
    axes = np.meshgrid(*[np.arange(-r, r + 1) * p for r, p in zip(reach, proportions)], indexing="ij")
    return sum(a**2 for a in axes) <= radius**2


@pytest.mark.parametrize("proportions", [(1.0, 1.0, 1.0), (1.0, 1.0, 1.6)])
@pytest.mark.parametrize("radius", [2.0, 3.0])
def test_opening_and_closing_are_those_of_the_digital_ball(radius, proportions):
    rng = np.random.default_rng(5)
    mask = np.pad(ndimage.binary_dilation(rng.random((22, 20, 18)) < 0.01, iterations=4), 6)
    proportions = np.array(proportions)
    element = ball(radius, proportions)
    assert (opened(mask, radius, proportions) == ndimage.binary_opening(mask, element)).all()
    assert (closed(mask, radius, proportions) == ndimage.binary_closing(mask, element)).all()


def test_the_corners_of_a_cube_are_convex_features_and_nothing_flat_is():
    solid = np.zeros((24, 24, 24), dtype=bool)
    solid[4:20, 4:20, 4:20] = True
    found = feature_voxels(VoxelGrid(solid=solid))
    corners = [(a, b, c) for a in (4, 19) for b in (4, 19) for c in (4, 19)]
    assert all(found.convex[corner] for corner in corners)
    assert not found.convex[8:16, 8:16, :].any()
    assert not found.concave.any()


def test_the_bottom_of_a_notch_is_a_concave_feature():
    solid = np.zeros((24, 24, 24), dtype=bool)
    solid[3:21, 3:21, 3:12] = solid[3:12, 3:21, 3:21] = True
    found = feature_voxels(VoxelGrid(solid=solid))
    assert found.concave[11:13, 8:16, 11:13].any()
    assert (found.concave <= solid).all()


def test_all_of_a_body_thinner_than_the_ball_is_a_feature():
    solid = np.zeros((20, 20, 20), dtype=bool)
    solid[5:15, 5:15, 9:11] = True
    assert (feature_voxels(VoxelGrid(solid=solid)).convex == solid).all()
