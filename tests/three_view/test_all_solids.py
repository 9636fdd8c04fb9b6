"""Every solid, and none but solids: against brute force, against known puzzles, against itself."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from lattice_solids import filled_cubes, lattice_drawing, lattice_solids, signature

from recon.errors import NoSolid
from recon.geometry.polyhedron import PlanarFace, Polyhedron
from recon.geometry.views import DrawnView, ThreeViews
from recon.three_view.hidden_lines import draw
from recon.three_view.pipeline import ViewsOptions, all_polyhedra, interpret

SIZE = 40.0
SQUARE = [[0, 0, SIZE, 0], [SIZE, 0, SIZE, SIZE], [SIZE, SIZE, 0, SIZE], [0, SIZE, 0, 0]]
UP, DOWN = [[0, 0, SIZE, SIZE]], [[0, SIZE, SIZE, 0]]


def view(segments, n_hidden=0):
    hidden = np.arange(len(segments)) >= len(segments) - n_hidden
    return DrawnView(np.array(segments, dtype=float).reshape(-1, 2, 2), hidden)


def square_with(*lines):
    return view([*SQUARE, *(segment for line in lines for segment in line)])


def volume(solid):
    total = 0.0
    for face in solid.faces:
        for loop in face.loops:
            corners = solid.vertices[list(loop)]
            for a, b in pairwise(corners[1:]):
                total += np.linalg.det([corners[0], a, b]) / 6
    return total


def convex(points):
    """A convex polyhedron as a `Polyhedron`, coplanar triangles joined."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    planes = {}
    for row, (triangle, equation) in enumerate(zip(hull.simplices, hull.equations)):
        planes.setdefault(tuple(np.round(equation, 6)), []).append((row, triangle))
    faces = []
    for equation, members in planes.items():
        corners = np.unique([t for _, t in members])
        n = np.array(equation[:3])
        first = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
        rest = points[corners] - points[corners].mean(axis=0)
        angle = np.arctan2(rest @ np.cross(n, first), rest @ first)
        faces.append(PlanarFace(tuple(int(c) for c in corners[np.argsort(angle)])))
    return Polyhedron(points, tuple(faces), ((tuple(range(len(faces))),),))


@pytest.mark.parametrize(
    ("views", "count"),
    [
        ((UP, UP, UP), 14),
        ((DOWN, UP, UP), 6),
        ((UP, DOWN, UP), 6),
        ((UP, UP, DOWN), 6),
        ((UP + DOWN, UP + DOWN, UP + DOWN), 10),
    ],
)
def test_squares_with_diagonals_mean_as_many_solids_as_the_puzzle_has(views, count):
    drawing = ThreeViews(*(square_with(lines) for lines in views))
    found = interpret(drawing)
    solids = list(all_polyhedra(drawing))
    assert (found.count, found.complete) == (count, True)
    assert len(solids) == count
    assert all(volume(solid) > 0 for solid in solids)


def test_every_solid_of_two_by_two_by_two_cubes_is_found_and_no_other():
    shape = (2, 2, 2)
    solids = {cubes.tobytes(): signature(cubes) for cubes in lattice_solids(shape)}
    shared = Counter(solids.values())
    rng = np.random.default_rng(5)
    wanted = [s for s, n in shared.items() if n > 1] + [
        list(shared)[i] for i in rng.choice(len(shared), 60, replace=False)
    ]
    by_drawing = {}
    for key, mark in solids.items():
        by_drawing.setdefault(mark, set()).add(key)
    for mark in wanted:
        members = by_drawing[mark]
        cubes = np.frombuffer(next(iter(members)), dtype=bool).reshape(shape)
        made = {filled_cubes(solid, shape).tobytes() for solid in all_polyhedra(lattice_drawing(cubes))}
        assert made == members


@pytest.mark.slow
def test_every_drawing_of_three_by_two_by_two_cubes_has_as_many_solids_as_brute_force_finds():
    drawings = {}
    for cubes in lattice_solids((3, 2, 2)):
        drawings.setdefault(signature(cubes), []).append(cubes)
    counts = {mark: interpret(lattice_drawing(same[0])).count for mark, same in drawings.items()}
    assert {mark: len(same) for mark, same in drawings.items()} == counts


@pytest.mark.parametrize("seed", range(6))
def test_a_convex_solid_with_slanted_faces_is_found_from_its_own_drawing(seed):
    rng = np.random.default_rng(seed)
    points = np.unique(rng.integers(0, 60, (9, 3)).astype(float), axis=0)
    solid = convex(points)
    found = interpret(draw(solid))
    volumes = [volume(made) for made in found.polyhedra()]
    assert any(abs(v - volume(solid)) < 1e-9 * volume(solid) for v in volumes)
    assert all(not found.differences(made) for made in found.polyhedra())


@pytest.mark.parametrize("seed", range(4))
def test_ends_that_are_off_by_less_than_snap_are_absorbed(seed):
    rng = np.random.default_rng(seed)
    cubes = rng.random((3, 3, 2)) < 0.7
    cubes[:, :, 0] = True
    exact = lattice_drawing(cubes)
    shaken = ThreeViews(
        *(DrawnView(v.segments + rng.uniform(-0.01, 0.01, v.segments.shape), v.hidden) for _, v in exact)
    )
    assert interpret(shaken).count == interpret(exact).count


def test_views_that_contradict_each_other_have_no_solid():
    odd = ThreeViews(square_with(UP), square_with(), square_with())
    with pytest.raises(NoSolid):
        interpret(odd)


def test_without_line_types_every_solid_with_the_same_lines_is_found():
    lines = {}
    for cubes in lattice_solids((2, 2, 2)):
        mark = tuple(frozenset(row[:4] for row in rows) for _, rows in signature(cubes))
        lines.setdefault(mark, []).append(cubes)
    groups = sorted(lines.values(), key=len)[-12:]
    counts = [interpret(lattice_drawing(group[0]), ViewsOptions(line_types=False)).count for group in groups]
    assert counts == [len(group) for group in groups]
    assert counts[-1] > 1


def test_bodies_that_touch_along_an_edge_stay_two_and_a_void_is_a_shell_of_its_own():
    touching = np.zeros((2, 2, 1), dtype=bool)
    touching[0, 0, 0] = touching[1, 1, 0] = True
    solids = list(all_polyhedra(lattice_drawing(touching)))
    assert [len(solid.bodies) for solid in solids] == [2]
    hollow = np.ones((3, 3, 3), dtype=bool)
    hollow[1, 1, 1] = False
    first = next(all_polyhedra(lattice_drawing(hollow)))
    assert [len(body) for body in first.bodies] == [2]
    assert volume(first) == pytest.approx(26 * 10.0**3)


def test_of_solids_with_as_many_faces_and_edges_the_one_without_dents_comes_first():
    points = [[x, y, z] for x in (-20, 20) for y in (-20, 20) for z in (-20, 20)]
    points += [(sign * 40 * np.eye(3)[axis]).tolist() for axis in range(3) for sign in (-1, 1)]
    dodecahedron = convex(np.array(points, dtype=float))  # twelve rhombi
    found = interpret(draw(dodecahedron))
    assert found.count == 17
    assert volume(found.polyhedron(0)) == pytest.approx(volume(dodecahedron))
