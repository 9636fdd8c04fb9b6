"""The paper's own patches over generated mountains."""

import numpy as np
import pytest
from generated_mountains import mountain_contours
from test_terrain_surface import INTERVAL, SEEDS, largest_angle

from brep_export.app.terrain_job import lowest_place
from recon.errors import BadOption
from recon.geometry.bspline import BSplineSurface
from recon.geometry.patches import connect
from recon.numerics.gregory import gregory_nets
from recon.numerics.rows import unit_vectors
from recon.terrain.evaluation import distances_between, edge_angles, elevations
from recon.terrain.gregory import GregoryPatches
from recon.terrain.network import terrain_network
from recon.terrain.pipeline import PatchKind, Terrain, TerrainOptions, terrain_surface
from recon.terrain.sections import contours_at

GREGORY = TerrainOptions(patches=PatchKind.GREGORY)


@pytest.fixture(scope="module")
def grounds() -> dict[int, Terrain]:
    return {seed: terrain_surface(mountain_contours(seed, INTERVAL), GREGORY) for seed in SEEDS}


@pytest.mark.parametrize("seed", SEEDS)
def test_patches_meet_in_tangent_planes(grounds, seed):
    assert edge_angles(grounds[seed]).max() < 1e-9


@pytest.mark.parametrize("seed", SEEDS)
def test_their_splines_keep_the_promised_angle(grounds, seed):
    t = np.concatenate([[0.001, 0.004], np.linspace(0.01, 0.99, 33), [0.996, 0.999]])
    assert largest_angle(terrain_network(grounds[seed]), t) < 0.1


def test_a_smaller_angle_takes_more_control_points():
    angles, sizes = (1.0, 0.02), []
    for angle in angles:
        ground = terrain_surface(mountain_contours(1, INTERVAL), TerrainOptions(patches=PatchKind.GREGORY, angle=angle))
        network = terrain_network(ground)
        assert largest_angle(network, np.linspace(0.01, 0.99, 25)) < angle
        sizes.append(sum(patch.control_net[..., 0].size for patch in network.patches))
    assert sizes[0] < sizes[1]


def test_heights_are_those_of_the_splines_that_the_kernel_gets(grounds):
    ground = grounds[2]
    inside = np.random.default_rng(0).uniform([10, 10], [590, 430], (400, 2))
    heights, _ = elevations(ground, inside)
    places = [
        patch.point(np.random.default_rng(p).uniform(0.1, 0.9, (3, 2)))
        for p, patch in enumerate(terrain_network(ground).patches)
    ]
    points = np.concatenate(places)
    found, _ = elevations(ground, points[:, :2] + ground.origin)
    assert np.isfinite(heights).all()
    assert np.nanmax(np.abs(found - points[:, 2])) < 0.02 * INTERVAL


def test_contours_of_the_ground_run_where_they_were_given(grounds):
    given = mountain_contours(2, INTERVAL)
    level = float(np.unique(given.heights)[2])
    found = contours_at(grounds[2], [level])
    assert distances_between(found, given).max() < 6.0


def _triangle(slopes: list[list[float]]) -> GregoryPatches:
    """A triangle of St Helens, 42 m long and a few decimetres wide, with these slopes at its corners (3, 2)."""
    plan = np.array([[0.285, 41.975], [0.236, 42.755], [0.0, 0.0]])
    height, slope = np.array([9.453, 9.453, 0.0]), np.array(slopes)

    def edge(i: int, j: int) -> np.ndarray:
        curve = np.linspace(0.0, 1.0, 4)[:, None] * np.r_[plan[j] - plan[i], 0.0] + np.r_[plan[i], 0.0]
        rise = (plan[j] - plan[i]) @ slope[[i, j]].T / 3
        curve[:, 2] = height[i], height[i] + rise[0], height[j] - rise[1], height[j]
        return curve[None]

    apex = np.broadcast_to(np.r_[plan[2], height[2]], (1, 4, 3))
    normals = unit_vectors(np.column_stack([-slope, np.ones(3)]))[[0, 1, 2, 2]][None]
    nets = gregory_nets((edge(0, 1), edge(1, 2), apex, edge(0, 2)), normals, np.array([0.0, 0.0, 1.0]))
    return GregoryPatches(np.arange(1), nets, np.zeros(1, dtype=np.int64), np.zeros((1, 4)))


def test_a_narrow_patch_folds_where_it_is_steep_alone():
    assert _triangle([[1.13, 0.09], [0.0, 0.0], [0.8, 0.24]]).folded()[0]
    assert not _triangle([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]).folded()[0]


@pytest.mark.parametrize("seed", SEEDS)
def test_no_patch_folds(grounds, seed):
    assert not any(part.folded().any() for part in grounds[seed].nets)


@pytest.mark.parametrize("angle", [0.0, -1.0, np.nan, 91.0])
def test_an_angle_has_to_be_one(angle):
    with pytest.raises(BadOption, match="--angle"):
        TerrainOptions(patches=PatchKind.GREGORY, angle=angle)


def test_the_lowest_place_is_found_on_splines_with_inner_knots():
    knots = np.array([0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 1.0])
    net = np.zeros((5, 5, 3))
    net[..., :2] = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0), indexing="ij"), axis=2)
    net[2, 2, 2] = -1.0
    pit = BSplineSurface(3, 3, knots, knots, net)
    assert lowest_place(connect([pit], 1e-9)) == pytest.approx(pit.point([[0.5, 0.5]])[0, 2])
