"""Half of the base is lost, with wall beside it: where little of the turn is left, wall and fracture are still told."""

import numpy as np
import pytest
from numpy.typing import NDArray

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.sample_vessel import VesselOptions, broken_vessel
from recon.hole_patch.sherd_reading import Reading, read_sherds

JAR = {"height": 107.0, "thickness": 3.0, "relief": 0.0, "noise": 0.04, "edge": 1.8}


def narrowing(points: NDArray[np.float64], height: float, share: float) -> NDArray[np.float64]:
    """Every radius stretched by the height alone: by 1 + share at the base, 1 - share at the lip."""
    factor = 1.0 + share * (1.0 - 2.0 * np.clip(points[:, 2] / height, 0.0, 1.0))
    return np.asarray(points * np.stack([factor, factor, np.ones_like(factor)], axis=1))


def without_half_the_base(options: VesselOptions, share: float) -> tuple[list[TriangleMesh], TriangleMesh]:
    """The sherds but for the lowest, and that one."""
    vessel = broken_vessel(options)
    sherds = [*vessel.sherds, vessel.lost]
    lowest = min(range(len(sherds)), key=lambda k: float(sherds[k].vertices[:, 2].mean()))
    shaped = [
        TriangleMesh(narrowing(sherd.vertices, options.height, share), sherd.face_vertices, sherd.name)
        for sherd in sherds
    ]
    return [*shaped[:lowest], *shaped[lowest + 1 :]], shaped[lowest]


@pytest.mark.parametrize(
    ("options", "share"),
    [
        (VesselOptions(seed=1), 0.0),  # the crack lies level under cords, and comes back over a quarter of the turn
        (VesselOptions(seed=3), 0.0),  # what is left of the base lies beside the axis
        (VesselOptions(seed=27, **JAR), 0.2),  # the crack leans in the middle of the base
    ],
)
def test_the_hole_is_found_on_both_walls(options: VesselOptions, share: float) -> None:
    sherds, lost = without_half_the_base(options, share)
    reading = read_sherds(sherds)
    assert reading.axis is not None and reading.axis.direction[2] > 0.99
    hole = reading.holes[0]
    assert not hole.problem and hole.inner is not None
    for edge in (hole.outer, hole.inner):
        np.testing.assert_allclose(edge.points.min(axis=0), lost.vertices.min(axis=0), atol=2.0 * options.thickness)
        np.testing.assert_allclose(edge.points.max(axis=0), lost.vertices.max(axis=0), atol=2.0 * options.thickness)


def test_a_jar_stands_on_its_base_though_its_mouth_is_narrower() -> None:
    options = VesselOptions(seed=86, height=167.0, thickness=7.0, relief=0.0, edge=2.8)
    sherds, _ = without_half_the_base(options, 0.25)
    reading: Reading = read_sherds(sherds)
    assert reading.axis is not None and reading.axis.direction[2] > 0.99
