"""Whatever arrays a neutral type is made of: sound ones are kept and locked, others are refused in a sentence."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from recon.errors import BadGeometry
from recon.geometry.analytic import Cone, Cylinder, Plane, Sphere
from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.contour_map import ContourMap, HeightGrid
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.height_source import HeightSource
from recon.geometry.mesh import PointSet, TriangleMesh
from recon.geometry.mixed import MixedBoundary, MixedEdge, MixedFace
from recon.geometry.patches import PatchMosaic, PatchNetwork, connect, side_curve
from recon.geometry.polyhedron import PlanarFace, Polyhedron
from recon.geometry.trimmed import TrimLoop
from recon.geometry.turned import ProfileArc, ProfileLine, TurnedPart
from recon.geometry.views import DrawnView
from recon.geometry.volume_source import VolumeSource
from recon.geometry.voxel_grid import Volume, VoxelGrid

FLOATS = st.floats(-1e6, 1e6).map(lambda x: round(x, 3))
SIZES = st.integers(2, 6)
SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], dtype=float)


@st.composite
def rows(draw, n, *more):
    return draw(arrays(np.float64, (n, *more), elements=FLOATS))


def increasing(n):
    return st.lists(st.integers(-1000, 1000), min_size=n, max_size=n, unique=True).map(lambda x: np.sort(x) / 8.0)


@st.composite
def triangle_mesh(draw):
    n = draw(st.integers(3, 9))
    corners = st.lists(st.integers(0, n - 1), min_size=3, max_size=3, unique=True)
    faces = draw(st.lists(corners, min_size=1, max_size=8))
    return {"vertices": draw(rows(n, 3)), "face_vertices": np.array(faces)}


@st.composite
def control_mesh(draw):
    n = draw(st.integers(4, 9))
    faces = draw(st.lists(st.permutations(range(n)).flatmap(lambda p: SIZES.map(lambda k: p[: max(k, 3)])), min_size=1))
    corners = np.concatenate([np.array(face) for face in faces])
    starts = np.concatenate([[0], np.cumsum([len(face) for face in faces])])
    sharpness = draw(arrays(np.float64, 2, elements=st.floats(0.1, 9.0) | st.just(np.inf)))
    marks = {"crease_edges": np.array([faces[0][:2], faces[0][1:3]]), "corner_vertices": np.array(faces[0][:2])}
    both = {"crease_sharpness": sharpness, "corner_sharpness": sharpness}
    return {"vertices": draw(rows(n, 3)), "face_corners": corners, "face_starts": starts, **marks, **both}


@st.composite
def knots(draw, degree, n):
    inner = draw(increasing(max(n - degree - 1, 0) + 2))
    return np.concatenate([[inner[0]] * degree, inner, [inner[-1]] * degree])


@st.composite
def curve(draw):
    degree, more, d = draw(st.tuples(st.integers(1, 4), st.integers(1, 4), st.sampled_from([2, 3])))
    n = degree + more
    weights = draw(arrays(np.float64, n, elements=st.floats(0.1, 10.0)))
    return {
        "degree": degree,
        "knots": draw(knots(degree, n)),
        "control_points": draw(rows(n, d)),
        "weights": weights,
    }


@st.composite
def surface(draw):
    p, q, more = draw(st.tuples(st.integers(1, 3), st.integers(1, 3), st.integers(1, 3)))
    shape = p + more, q + 1
    return {
        "degree_u": p,
        "degree_v": q,
        "knots_u": draw(knots(p, shape[0])),
        "knots_v": draw(knots(q, shape[1])),
        "control_net": draw(rows(*shape, 3)),
        "weights": draw(arrays(np.float64, shape, elements=st.floats(0.1, 10.0))),
    }


@st.composite
def contour_map(draw):
    n = draw(SIZES)
    size = draw(st.floats(1.0, 1e5))
    ring = size * (0.2 + 0.3 * SQUARE)
    return {
        "lines": [draw(rows(n, 2)), draw(rows(3, 2))],
        "heights": draw(rows(2)),
        "extent": np.array([[0.0, 0.0], [size, size]]),
        "spots": draw(rows(n, 3)),
        "voids": [ring],
        "outline": size * SQUARE,
    }


@st.composite
def grid_axes(draw):
    return {"x": draw(SIZES.flatmap(increasing)), "y": draw(SIZES.flatmap(increasing))}


@st.composite
def height_grid(draw):
    axes = draw(grid_axes())
    heights = draw(rows(len(axes["y"]), len(axes["x"])))
    heights[:1, : draw(st.integers(0, 1))] = np.nan
    return {**axes, "heights": heights}


@st.composite
def placed(draw):
    turn = np.linalg.qr(draw(rows(3, 3)) + 1e7 * np.diag([1.0, 2.0, 3.0]))[0]
    return {"spacing": draw(arrays(float, 3, elements=st.floats(0.01, 9))), "origin": draw(rows(3)), "direction": turn}


@st.composite
def voxel_grid(draw):
    solid = draw(arrays(np.bool_, draw(st.tuples(SIZES, SIZES, SIZES))))
    solid[0, 0, 0], solid[1, 1, 1] = True, False
    return {**draw(placed()), "solid": solid}


@st.composite
def volume(draw):
    return {**draw(placed()), "values": draw(arrays(np.int16, draw(st.tuples(SIZES, SIZES, SIZES))))}


@st.composite
def volume_source(draw):
    return {**draw(placed()), "shape": np.array(draw(st.tuples(SIZES, SIZES, SIZES)))}


@st.composite
def view(draw):
    n = draw(SIZES)
    return {"segments": draw(rows(n, 2, 2)), "hidden": draw(arrays(np.bool_, n))}


@st.composite
def polyhedron(draw):
    faces = tuple(PlanarFace(face) for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)))
    return {"vertices": draw(rows(4, 3)), "faces": faces, "bodies": (((0, 1, 2, 3),),)}


def sheet(n, m):
    """n by m bilinear patches side by side."""
    one = np.array([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0]]], dtype=float)
    return [
        BSplineSurface(1, 1, [0, 0, 1, 1], [0, 0, 1, 1], one + np.array([i, j, 0.0]))
        for i in range(n)
        for j in range(m)
    ]


@st.composite
def patch_network(draw):
    found = connect(sheet(draw(SIZES), draw(SIZES)), 0.2)
    return {name: getattr(found, name) for name in found.__dataclass_fields__}


@st.composite
def patch_mosaic(draw):
    found = connect(sheet(draw(SIZES), draw(SIZES)), 0.2)
    first = np.unique(found.side_edges, return_index=True)[1]
    n_uses = found.side_edges.size
    return {
        "patches": found.patches,
        "vertices": found.vertices,
        "edge_curves": [side_curve(found.patches[k // 4], k % 4) for k in first.tolist()],
        "edge_vertices": found.edge_vertices,
        "smooth_edges": draw(arrays(np.bool_, len(first))),
        "side_starts": np.arange(n_uses + 1),
        "side_edges": found.side_edges.ravel(),
        "side_forward": found.side_forward.ravel(),
        "side_ranges": np.tile([0.0, 1.0], (n_uses, 1)),
    }


@st.composite
def turned_part(draw):
    corners = draw(rows(4, 2))
    loop = tuple(ProfileLine(a, b) for a, b in zip(corners, np.roll(corners, -1, axis=0)))
    return {"origin": draw(rows(3)), "axis": draw(st.sampled_from(list(np.eye(3)))), "loops": (loop,)}


@st.composite
def mixed_boundary(draw):
    edges = tuple(MixedEdge(a, (a + 1) % 3) for a in range(3))
    faces = tuple(MixedFace(None, 1.0, (((0, True), (1, True), (2, True)),), 1.0, k) for k in range(3))
    surfaces = (Plane(np.eye(3)[0], 1.0), Sphere(np.zeros(3), 2.0))
    bodies = (((0, 1, 2),),)
    shared = {"surfaces": surfaces, "edges": edges, "faces": faces, "bodies": bodies}
    return {"vertices": draw(rows(4, 3)), **shared, "slack": 0.5}


# The fields of a type that are arrays, by what they hold: floats, vertex or edge numbers, truth values.
TYPES = {
    PointSet: (rows(4, 3).map(lambda p: {"points": p}), {"points": "f"}),
    TriangleMesh: (triangle_mesh(), {"vertices": "f", "face_vertices": "n"}),
    ControlMesh: (
        control_mesh(),
        {"vertices": "f", "face_corners": "n", "face_starts": "n", "crease_edges": "n", "corner_vertices": "n"}
        | {"crease_sharpness": "s", "corner_sharpness": "s"},
    ),
    BSplineCurve: (curve(), {"knots": "f", "control_points": "f", "weights": "f"}),
    BSplineSurface: (surface(), {"knots_u": "f", "knots_v": "f", "control_net": "f", "weights": "f"}),
    ContourMap: (contour_map(), {"heights": "f", "extent": "f", "spots": "f", "outline": "f"}),
    HeightGrid: (height_grid(), {"x": "f", "y": "f", "heights": "h"}),
    HeightSource: (grid_axes().map(lambda axes: {**axes, "crs": "", "read": None}), {"x": "f", "y": "f"}),
    VoxelGrid: (voxel_grid(), {"spacing": "f", "origin": "f", "direction": "f", "solid": "b"}),
    Volume: (volume(), {"spacing": "f", "origin": "f", "direction": "f"}),
    VolumeSource: (volume_source(), {"spacing": "f", "origin": "f", "direction": "f", "shape": "c"}),
    DrawnView: (view(), {"segments": "f", "hidden": "b"}),
    Polyhedron: (polyhedron(), {"vertices": "f"}),
    PatchNetwork: (
        patch_network(),
        {"vertices": "f", "edge_vertices": "n", "side_edges": "n", "side_forward": "b", "corner_vertices": "n"},
    ),
    PatchMosaic: (
        patch_mosaic(),
        {"vertices": "f", "edge_vertices": "n", "side_starts": "n", "side_edges": "n", "side_ranges": "f"}
        | {"side_forward": "b", "smooth_edges": "b"},
    ),
    ProfileLine: (rows(2, 2).map(lambda p: {"start": p[0], "end": p[1]}), {"start": "f", "end": "f"}),
    ProfileArc: (
        rows(3, 2).map(lambda p: dict(zip(("start", "middle", "end"), p))),
        {"start": "f", "middle": "f", "end": "f"},
    ),
    TurnedPart: (turned_part(), {"origin": "f", "axis": "f"}),
    MixedBoundary: (mixed_boundary(), {"vertices": "f", "slack": "f"}),
}
FIELDS = [(kind, name) for kind, (_, names) in TYPES.items() for name in names]


def with_value(value, values, place):
    changed = values.astype(np.result_type(values.dtype, np.asarray(value).dtype) if values.size else float)
    changed[place] = value
    return changed


def masked(values, place):
    hidden = np.zeros(values.shape, dtype=bool)
    hidden[place] = True
    return np.ma.array(values, mask=hidden)


def ragged(values, place):
    found = values.tolist()
    return [found, [0.5]] if values.ndim < 2 else [*found[:-1], found[-1][:-1]]


ANY = {
    "another axis": lambda values, place: values[None],
    "text": lambda values, place: values.astype(str),
    "objects": lambda values, place: np.full(values.shape, None),
    "imaginary": lambda values, place: values + 1j,
    "masked": masked,
    "dates": lambda values, place: np.zeros(values.shape, dtype="M8[s]"),
    "rows of different length": ragged,
    "an endless number": lambda values, place: with_value(10**400, values.astype(object), place),
    "minus infinite": partial(with_value, -np.inf),
}
NAN, INFINITE, HUGE = ({name: partial(with_value, value)} for name, value in zip("nih", (np.nan, np.inf, 1e200)))
NUMBERS = {
    "half a vertex": partial(with_value, 0.5),
    "below the first": partial(with_value, -2),
    "beyond the last": partial(with_value, 1000),
    "more than 63 bits": lambda values, place: with_value(np.uint64(2**63), values.astype(np.uint64), place),
}
DAMAGES = {
    "f": ANY | NAN | INFINITE | HUGE,
    "h": ANY | INFINITE | HUGE,  # a height that is NaN is not known
    "s": ANY | NAN | HUGE | {"none at all": partial(with_value, 0.0)},  # an infinite sharpness is a crease for ever
    "n": ANY | NAN | INFINITE | HUGE | NUMBERS,
    "c": ANY | NAN | INFINITE | HUGE | {k: d for k, d in NUMBERS.items() if k != "beyond the last"},
    "b": ANY | NAN | INFINITE | {"two": partial(with_value, 2), "minus one": partial(with_value, -1)},
}


@pytest.mark.parametrize("kind", TYPES, ids=lambda kind: kind.__name__)
@settings(max_examples=25)
@given(data=st.data())
def test_sound_arrays_are_kept_as_they_are_and_locked(kind, data):
    strategy, names = TYPES[kind]
    given_arrays = data.draw(strategy)
    made = kind(**given_arrays)
    for name in names:
        kept = getattr(made, name)
        np.testing.assert_array_equal(kept, given_arrays[name])
        if isinstance(kept, np.ndarray):
            assert not kept.flags.writeable and not np.shares_memory(kept, given_arrays[name])


@pytest.mark.parametrize(("kind", "name"), FIELDS, ids=lambda part: getattr(part, "__name__", part))
@settings(max_examples=40)
@given(data=st.data())
def test_unsound_arrays_are_refused_in_a_sentence(kind, name, data):
    strategy, names = TYPES[kind]
    given_arrays = data.draw(strategy)
    damage = data.draw(st.sampled_from(sorted(DAMAGES[names[name]])))
    values = np.asarray(given_arrays[name])
    place = tuple(data.draw(st.integers(0, n - 1)) for n in values.shape)
    unsound = DAMAGES[names[name]][damage](values, place)
    with pytest.raises(BadGeometry) as refusal:
        kind(**{**given_arrays, name: unsound})
    assert str(refusal.value).endswith(".") and "\n" not in str(refusal.value)


@pytest.mark.parametrize("degree", [0, -1, 1.0, np.nan, "2", None, True, np.array([1])])
def test_a_degree_that_is_none_is_refused(degree):
    with pytest.raises(BadGeometry, match="degree"):
        BSplineCurve(degree, [0, 0, 1, 1], [[0, 0], [1, 1]])


@pytest.mark.parametrize("corner", [np.nan, 0.5, -1, 4])
def test_a_face_of_a_polyhedron_names_vertices(corner):
    faces = [PlanarFace((0, 2, 1)), PlanarFace((0, 1, 3)), PlanarFace((0, 3, 2)), PlanarFace((1, 2, corner))]
    with pytest.raises(BadGeometry):
        Polyhedron(np.eye(4)[:, :3], faces, [[range(4)]])


@pytest.mark.parametrize(
    "surface",
    [
        Plane(np.array([0.0, 0.0, 2.0]), 1.0),
        Plane(np.zeros(3), 0.0),
        Plane(np.eye(3)[2], np.nan),
        Sphere(np.zeros(3), -1.0),
        Sphere(np.array([np.inf, 0.0, 0.0]), 1.0),
        Cylinder(np.zeros(3), np.eye(3)[2], 0.0),
        Cylinder(np.zeros(2), np.eye(3)[2], 1.0),
        Cone(np.zeros(3), np.eye(3)[2], np.pi / 2),
        Cone(np.zeros(3), np.eye(3)[2], -0.1),
    ],
    ids=repr,
)
def test_a_boundary_of_no_surface_is_refused(surface):
    with pytest.raises(BadGeometry, match="surface 0"):
        MixedBoundary(np.zeros((0, 3)), (surface,), (), (), (), 0.1)


def test_a_loop_of_a_turned_part_closes():
    there = ProfileLine([0, 0], [1, 0]), ProfileLine([1, 0], [1, 1]), ProfileLine([1, 1.01], [0, 0])
    with pytest.raises(BadGeometry, match="piece 1 of loop 0"):
        TurnedPart(np.zeros(3), np.eye(3)[2], [there])


def test_the_axes_of_a_volume_stand_at_right_angles():
    with pytest.raises(BadGeometry, match="right angles"):
        Volume(direction=np.diag([2.0, 0.5, 1.0]), values=np.zeros((2, 2, 2)))


@given(curve())
def test_a_curve_begins_and_ends_in_its_control_points_and_stays_among_them(values):
    made = BSplineCurve(**values)
    points = made.point(np.linspace(*made.domain, 33))
    np.testing.assert_allclose(points[[0, -1]], made.control_points[[0, -1]], rtol=1e-9, atol=1e-6)
    low, high = made.control_points.min(axis=0), made.control_points.max(axis=0)
    assert (points >= low - 1e-6).all() and (points <= high + 1e-6).all()
    np.testing.assert_allclose(made.reversed().point(np.linspace(*made.domain, 33))[::-1], points, rtol=1e-9, atol=1e-5)


@given(surface())
def test_the_grid_of_a_surface_holds_its_points(values):
    made = BSplineSurface(**values)
    u, v = (np.linspace(*domain, 5) for domain in made.domain)
    places = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    np.testing.assert_allclose(made.grid(u, v).reshape(-1, 3), made.point(places), rtol=1e-9, atol=1e-5)


@given(control_mesh())
def test_a_control_mesh_is_drawn_with_two_triangles_less_than_its_corners(values):
    made = ControlMesh(**values)
    assert sorted(made.next_corners()) == list(range(len(made.face_corners)))
    assert made.triangle_mesh().n_faces == len(made.face_corners) - 2 * made.n_faces


@given(triangle_mesh(), st.integers(0, 2), st.floats(0.1, 10.0))
def test_measures_of_a_mesh_grow_with_its_size_and_turn_over_in_a_mirror(values, axis, scale):
    made = TriangleMesh(**values)
    matrix = np.diag([scale, scale, scale, 1.0])
    matrix[axis, axis] = -scale
    changed = made.moved(matrix)
    size = np.abs(made.vertices).max() ** 3 * made.n_faces + 1e-9
    assert abs(changed.volume() + scale**3 * made.volume()) <= 1e-9 * scale**3 * size
    flat = np.linalg.norm(made.area_vectors(), axis=1)
    np.testing.assert_allclose(np.linalg.norm(changed.area_vectors(), axis=1), scale**2 * flat, rtol=1e-6, atol=1e-3)
    np.testing.assert_array_equal(made.part(np.arange(made.n_faces)).corners(), made.corners())


@given(contour_map(), rows(2))
def test_a_map_that_is_moved_there_and_back_is_where_it_was(values, origin):
    made = ContourMap(**values)
    back = made.moved(origin).moved(-origin)
    for before, after in zip((*made.lines, made.extent, *made.voids), (*back.lines, back.extent, *back.voids)):
        np.testing.assert_allclose(after, before, atol=1e-8)
    assert back.n_points == made.n_points


@given(polyhedron(), st.integers(0, 2), FLOATS)
def test_the_mirror_image_of_a_mirror_image_is_the_solid(values, axis, at):
    made = Polyhedron(**values)
    twice = made.mirrored(axis, at).mirrored(axis, at)
    np.testing.assert_allclose(twice.vertices, made.vertices, atol=1e-8)
    assert twice.faces == made.faces


@given(voxel_grid())
def test_a_grid_keeps_lengths_and_the_outside_outside(values):
    made = VoxelGrid(**values)
    corner = np.vstack([np.zeros(3), np.eye(3)])
    mesh = made.placed(corner, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    assert mesh.volume() == pytest.approx(made.voxel**3 / 6, rel=1e-6, abs=1e-9)


@given(st.lists(st.floats(0.05, 6.2), min_size=3, max_size=9, unique=True))
def test_a_trim_loop_the_other_way_round_has_the_opposite_area(angles):
    corners = np.stack([np.cos(np.sort(angles)), np.sin(np.sort(angles))], axis=1)
    sides = [BSplineCurve(1, [0, 0, 1, 1], ends) for ends in zip(corners, np.roll(corners, -1, axis=0))]
    forward, backward = TrimLoop(sides), TrimLoop([side.reversed() for side in reversed(sides)])
    assert forward.signed_area() >= 0
    assert backward.signed_area() == pytest.approx(-forward.signed_area(), abs=1e-12)
