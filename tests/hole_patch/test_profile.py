import numpy as np
import pytest
from thrown_walls import (
    AXIS,
    cone,
    cylinder,
    dish,
    dish_with_hole,
    hole_points,
    plan_circle,
    sphere,
    wall_with_hole,
)

from recon.errors import NoSurface
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.profile import wall_profile
from recon.hole_patch.section_samples import vertex_areas_and_normals
from recon.hole_patch.surroundings import HoleEdge, Wall

SURFACES = {"cylinder": cylinder(30.0), "cone": cone(40.0, 0.4), "plate": cone(60.0, 8.0), "sphere": sphere(45.0)}


def with_vertices(wall: Wall, vertices: np.ndarray) -> Wall:
    mesh = TriangleMesh(vertices, wall.measured.face_vertices)
    return Wall(mesh, mesh, wall.sherds, wall.trust, wall.edge)


@pytest.mark.parametrize("name", SURFACES)
def test_a_turned_wall_lies_on_its_turned_profile(name: str) -> None:
    size = (0.2, 2.0) if name == "plate" else (0.5, 14.0)
    t_range, step = ((-6.0, 6.0), 0.2) if name == "plate" else ((-35.0, 35.0), 1.2)
    profile = wall_profile(wall_with_hole(SURFACES[name], size=size, t_range=t_range, step=step), AXIS)
    off = profile.chart(hole_points(SURFACES[name], size))[:, 2]
    assert np.abs(off).max() < 1e-4  # mm; what the spline leaves of a sphere of 45 mm


@pytest.mark.parametrize("name", ["cylinder", "cone", "sphere"])
def test_chart_and_space_are_inverse(name: str) -> None:
    profile = wall_profile(wall_with_hole(SURFACES[name]), AXIS)
    rng = np.random.default_rng(3)
    middle = 0.5 * sum(profile.curve.domain)
    chart = rng.uniform([-3.0, middle - 20, -4.0], [3.0, middle + 20, 4.0], (200, 3))
    np.testing.assert_allclose(profile.chart(profile.space(chart)), chart, atol=1e-9)


def test_parameter_is_length_and_chart_counts_from_the_hole() -> None:
    wall = wall_with_hole(sphere(45.0))
    profile = wall_profile(wall, AXIS)
    s = np.linspace(*profile.curve.domain, 200)[20:-20]
    np.testing.assert_allclose(np.linalg.norm(profile.curve.derivative(s), axis=1), 1.0, atol=1e-3)
    angles = profile.chart(wall.edge.points)[:, 0]
    np.testing.assert_allclose([angles.min(), angles.max()], [-0.5, 0.5], atol=1e-6)


@pytest.mark.parametrize("turned_over", [False, True])
def test_normal_follows_the_wall_whichever_way_it_faces(turned_over: bool) -> None:
    wall = wall_with_hole(cone(40.0, 0.4))
    if turned_over:
        mesh = TriangleMesh(wall.measured.vertices, wall.measured.face_vertices[:, ::-1])
        wall = Wall(mesh, mesh, wall.sherds, wall.trust, wall.edge)
    profile = wall_profile(wall, AXIS)
    chart = profile.chart(wall.measured.vertices)
    outward = profile.space(chart + np.array([0.0, 0.0, 1.0])) - wall.measured.vertices
    _, normals = vertex_areas_and_normals(wall.measured)
    assert np.einsum("ij,ij->i", outward, normals).min() > 0.95


def test_a_handle_does_not_bend_the_profile() -> None:
    surface = cylinder(30.0)
    wall = wall_with_hole(surface)
    turned_points = AXIS.cylindrical(wall.measured.vertices)
    beside = np.abs(turned_points[:, 0] - 1.5) < 0.35
    turned_points[:, 1] -= 5.0 * beside * np.exp(-((turned_points[:, 2] / 10) ** 2))
    profile = wall_profile(with_vertices(wall, AXIS.cartesian(turned_points)), AXIS)
    assert np.abs(profile.chart(hole_points(surface))[:, 2]).max() < 1e-3


def test_noise_averages_out_over_the_turn() -> None:
    surface = cone(40.0, 0.4)
    wall = wall_with_hole(surface)
    noise = np.random.default_rng(1).normal(0, 0.2, wall.measured.vertices.shape)
    profile = wall_profile(with_vertices(wall, wall.measured.vertices + noise), AXIS)
    off = profile.chart(hole_points(surface))[:, 2]
    assert np.sqrt((off**2).mean()) < 0.2 / np.sqrt(15)


@pytest.mark.parametrize("aside", [0.0, 6.0, 14.0])
def test_a_hole_over_the_axis_is_bridged_by_a_symmetric_profile(aside: float) -> None:
    profile = wall_profile(dish_with_hole(dish(80.0), aside=aside, radius=12.0), AXIS)
    assert profile.crossing is not None
    np.testing.assert_allclose(profile.radius(np.array([profile.crossing])), 0.0, atol=1e-9)
    x, y = plan_circle(aside, 6.0)
    off = profile.chart(dish(80.0)(np.arctan2(y, x), np.hypot(x, y)))[:, 2]
    assert np.abs(off).max() < 0.05


def test_a_hole_that_takes_the_whole_turn_is_refused() -> None:
    wall = wall_with_hole(cylinder(30.0))
    turn = np.linspace(0.05, 2 * np.pi - 0.05, 200)
    points = np.concatenate([cylinder(30.0)(turn, np.full(200, -5.0)), cylinder(30.0)(turn[::-1], np.full(200, 5.0))])
    belt = Wall(wall.measured, wall.plain, wall.sherds, wall.trust, HoleEdge(points, np.zeros(400, np.int64)))
    with pytest.raises(NoSurface, match="300 degrees"):
        wall_profile(belt, AXIS)


def test_a_profile_that_is_read_towards_the_axis_is_refused() -> None:
    """Its normals point to the vessel's inside, as where fracture was taken for wall all round the hole."""
    wall = dish_with_hole(dish(80.0), aside=0.0, radius=12.0)
    mesh = TriangleMesh(wall.measured.vertices, wall.measured.face_vertices[:, ::-1])
    with pytest.raises(NoSurface, match="faces the wrong way"):
        wall_profile(Wall(mesh, mesh, wall.sherds, wall.trust, wall.edge), AXIS)
