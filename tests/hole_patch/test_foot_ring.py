"""Walls that stand on a foot ring: the profile follows it, and the fracture finds its way through it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree
from thrown_walls import AXIS, turned, wall_with_hole

from brep_export.app.patch_job import TOLERANCE, kernel_piece
from brep_export.check import check
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.edge_cleaning import crossings
from recon.hole_patch.foot_rungs import ring_runs
from recon.hole_patch.fracture_band import HEIGHTS
from recon.hole_patch.fracture_relief import fracture_relief
from recon.hole_patch.pipeline import patch_hole
from recon.hole_patch.profile import wall_profile
from recon.hole_patch.sample_vessel import VesselOptions, broken_vessel, whole_vessel
from recon.hole_patch.section_samples import lengths_along_mesh, section_samples
from recon.hole_patch.surroundings import HoleKind, Wall
from recon.numerics.distance import closest_points

DEEP, WIDE = 10.0, 5.0  # of the ring, mm


def footed_profile() -> np.ndarray:
    """(n, 2) radius and height at even lengths: base, ring, base, wall; every corner rounded by about a millimetre."""
    corners = [(6, 0), (26, 0), (26, -DEEP), (26 + WIDE, -DEEP), (26 + WIDE, 0), (42, 0), (44, 40)]
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    at = np.arange(0.0, run[-1], 0.1)
    sharp = np.stack([np.interp(at, run, column) for column in np.transpose(corners)], axis=1)
    return gaussian_filter1d(sharp, 8.0, axis=0, mode="nearest")


def footed_wall() -> Wall:
    """Its hole takes a quarter of the ring's inner side and tip, and the base within."""
    profile = footed_profile()
    t = 0.1 * np.arange(len(profile)) - 28.0
    surface = turned(lambda x: np.interp(x, t, profile[:, 0]), lambda x: np.interp(x, t, profile[:, 1]))
    return wall_with_hole(surface, t_range=(t[0], t[-1]), step=0.8)


def with_swelling(wall: Wall) -> Wall:
    """The wall with a lump on the upright part over a sixth of the turn, away from the hole."""
    turn, radius, height = AXIS.cylindrical(wall.measured.vertices).T
    inward = 8.0 * np.exp(-((np.angle(np.exp(1j * (turn - 1.2))) / 0.3) ** 2) - ((height - 15.0) / 8.0) ** 2)
    moved = AXIS.cartesian(np.column_stack([turn, radius - np.where(radius > 40.0, inward, 0.0), height]))
    mesh = TriangleMesh(moved, wall.measured.face_vertices, "wall")
    return replace(wall, measured=mesh, plain=mesh)


@pytest.mark.parametrize("swelling", [False, True])
def test_a_profile_follows_a_foot_ring_and_ties_no_loop(swelling: bool) -> None:
    wall = with_swelling(footed_wall()) if swelling else footed_wall()
    curve = wall_profile(wall, AXIS).curve
    line = curve.point(np.linspace(*curve.domain, 3000))
    profile = footed_profile()
    away = cKDTree(line).query(profile[profile[:, 1] < 10.0])[0]
    assert away.mean() < 0.1
    assert away.max() < 0.6
    assert not [pair for pair in crossings(line[::4]) if pair.max() < len(line[::4]) - 1]


def test_lengths_along_the_mesh_go_down_a_ring_and_not_across_its_throat() -> None:
    wall = footed_wall()
    samples = section_samples(wall, AXIS, middle=0.0, nearness=np.inf)
    s = lengths_along_mesh(samples, AXIS.cylindrical(wall.edge.points)[:, 1:], wall=wall.measured)
    inside, outside = (
        s[cKDTree(samples.place).query([[radius, 0.0]], k=20)[1][0]].mean() for radius in (24.0, 28.0 + WIDE)
    )
    assert outside - inside > 2.0 * DEEP  # WIDE + 4 across


def test_stations_down_a_ring_are_told_from_those_on_the_base() -> None:
    """A loop in a plane: a square's lower side with a ring below it, the inner loop 3 mm above."""
    corners = np.array([(0, 0), (18, 0), (18, -8), (22, -8), (22, 0), (40, 0), (40, 40), (0, 40)], dtype=float)
    ends = np.roll(corners, -1, axis=0)
    points = np.concatenate(
        [
            a + (b - a) * np.linspace(0, 1, round(np.linalg.norm(b - a) / 0.35), endpoint=False)[:, None]
            for a, b in zip(corners, ends)
        ]
    )
    points = np.column_stack([points, np.zeros(len(points))])
    inside = np.clip(points, [3, 3, 0], [37, 37, 0])
    (run,) = ring_runs(points, inside - points)
    x, y = points[run, 0], points[run, 1]
    assert x.min() >= 17.0 and x.max() <= 23.0
    assert y.min() == -8.0 and y.max() > -2.0


def test_a_straight_wall_keeps_behind_a_tooth_of_its_neighbour() -> None:
    """The neighbour's fracture lies 0.3 mm off, but for a tooth 0.2 mm high and half a millimetre wide."""
    x = np.arange(0.0, 20.0, 0.1)
    off = 0.3 - 0.2 * (np.abs(x - 10.0) < 0.25)
    strip = np.concatenate([np.column_stack([x, off, np.full_like(x, z)]) for z in (-1.0, 4.0)])
    a, n = np.arange(len(x) - 1), len(x)
    faces = np.concatenate([np.stack([a, a + 1, a + n], axis=1), np.stack([a + 1, a + n + 1, a + n], axis=1)])
    at = np.arange(3.0, 17.0, 0.2)
    rungs = np.stack([np.column_stack([at, np.zeros_like(at), np.full_like(at, 3.0 * h)]) for h in HEIGHTS], axis=1)
    away = np.broadcast_to([0.0, 1.0, 0.0], rungs.shape)
    thickness = np.full(len(at), 3.0)
    relief = fracture_relief(rungs, away, TriangleMesh(strip, faces, "tooth"), thickness=thickness, closed=False)
    tooth, rest = np.abs(at - 10.0) < 0.2, np.abs(at - 10.0) > 3.0
    assert relief[tooth, :, 1].max() < 0.19
    assert np.abs(relief[rest, :, 1] - 0.3).max() < 0.05  # a rung as it is counts a little, too


def test_a_vessel_on_a_ring_is_closed_and_stands_below_its_base() -> None:
    vessel = whole_vessel(VesselOptions(foot=6.0))
    assert vessel.volume() > whole_vessel(VesselOptions()).volume()
    assert vessel.vertices[:, 2].min() == pytest.approx(-6.0, abs=0.1)


@pytest.mark.slow
def test_the_outer_wall_of_a_lost_base_sherd_runs_over_the_ring() -> None:
    vessel = broken_vessel(VesselOptions(foot=6.0, thickness=3.0, relief=0.0))
    lowest = int(np.argmin([sherd.vertices[:, 2].mean() for sherd in vessel.sherds]))
    sherds = (*vessel.sherds[:lowest], *vessel.sherds[lowest + 1 :], vessel.lost)
    piece = patch_hole(sherds)
    assert piece.around.kind is HoleKind.FOOT
    outer = piece.outer.trimmed
    points = outer.surface.point(outer.loops[0].polygon())
    away = closest_points(points, vessel.plain.vertices, vessel.plain.face_vertices).distances
    assert points[:, 2].min() < -5.0
    assert away.mean() < 0.1
    assert check(kernel_piece(piece)[0], TOLERANCE).passed
