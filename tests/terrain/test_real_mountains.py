"""What is promised of measured mountains, where they lie beside the checkout."""

from pathlib import Path

import numpy as np
import pytest

from recon.geometry.contour_map import ContourMap
from recon.readers.height_grids import read_height_grid
from recon.terrain.contouring import contour_grid
from recon.terrain.evaluation import distances_between, edge_angles
from recon.terrain.ground import Terrain
from recon.terrain.levels import levels
from recon.terrain.limiter import excess
from recon.terrain.merging import ruled_folds
from recon.terrain.pipeline import TerrainOptions, terrain_surface
from recon.terrain.sections import contours_at

DATA = Path(__file__).parents[3] / "shared" / "data" / "terrain"
# file, interval and what contours may be off on average; nothing is promised of the first, which is coarser sampled
MAPS = {
    "maunga_whau": ("maunga_whau_10m.json", 20.0, 0.8),
    "St Helens at 50 m": ("st_helens_10m.tif", 50.0, 0.6),
    "St Helens at 20 m": ("st_helens_10m.tif", 20.0, 0.6),
}

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not DATA.exists(), reason="the measured grids are not beside the checkout"),
]


@pytest.fixture(scope="module", params=MAPS)
def mountain(request) -> tuple[ContourMap, Terrain, float]:
    name, interval, allowed = MAPS[request.param]
    contours = contour_grid(read_height_grid(DATA / name), interval)
    return contours, terrain_surface(contours), allowed


def test_no_height_goes_beyond_the_contours_around_by_more_than_a_twentieth_of_the_interval(mountain):
    _, ground, _ = mountain
    limits = levels(ground.tiling, ground.interval)
    strip = limits.strip[ground.layout.face]
    beyond = excess(limits.low[strip], limits.high[strip], ground.nets)[~limits.ended[strip]]
    assert beyond.max() < 0.05 * ground.interval


def test_cut_again_at_the_given_heights_the_ground_has_the_given_contours(mountain):
    contours, ground, allowed = mountain
    off = distances_between(contours, contours_at(ground, np.unique(contours.heights).tolist(), steps=16))
    assert off.mean() < allowed
    assert off.max() < 4.0


def test_no_patch_folds(mountain):
    _, ground, _ = mountain
    assert not ruled_folds(ground.tiling, ground.layout).any()


def test_tangent_planes_agree(mountain, request):
    _, ground, _ = mountain
    if "St Helens at 20 m" in request.node.name:
        # the last bit of 2,400 m is 5e-13 m, and a triangle in a hairpin of a contour is a millimetre wide
        request.applymarker(
            pytest.mark.xfail(strict=True, reason="the promise is missed at one triangle: 1.8e-6 degrees")
        )
    assert np.degrees(edge_angles(ground).max()) < 1e-6


def test_a_finer_tolerance_halves_what_contours_are_off():
    contours = contour_grid(read_height_grid(DATA / "st_helens_10m.tif"), 20.0)
    ground = terrain_surface(contours, TerrainOptions(tolerance=0.7))
    off = distances_between(contours, contours_at(ground, np.unique(contours.heights).tolist(), steps=16))
    assert off.mean() < 0.3
    assert off.max() < 2.0
