"""Any bytes under any ending: an error of our own or something sound; and whatever is written comes back."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from specimens import SPECIMENS

from brep_export.control_mesh_files import write_control_mesh
from recon.errors import ReconError
from recon.geometry.control_mesh import ControlMesh
from recon.readers.contours import read_contours
from recon.readers.control_meshes import read_control_mesh
from recon.readers.height_grids import read_height_grid
from recon.readers.meshes import read_mesh
from recon.readers.picks import read_picks
from recon.readers.point_rows import read_point_row
from recon.readers.views import read_views
from recon.readers.volumes import read_volume

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
one_folder = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])  # each example writes its own file
FLOATS = st.floats(-1e6, 1e6)
PLACES = st.floats(1e3, 1e6)  # of a map: no degrees
TYPES = ["uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64"]


def read_or_refused(read, path):
    try:
        return read(path)
    except ReconError as problem:
        assert str(problem) and "\n" not in str(problem)
        return None


@pytest.mark.parametrize("name", SPECIMENS)
@settings(one_folder, max_examples=30)
@given(content=st.binary(max_size=400))
def test_bytes_by_chance_are_refused_or_read(name, tmp_path, content):
    read, ending, _ = SPECIMENS[name]
    path = tmp_path / f"file{ending}"
    path.write_bytes(content)
    read_or_refused(read, path)


@pytest.mark.parametrize("name", SPECIMENS)
@settings(one_folder, max_examples=30)
@given(data=st.data())
def test_a_sound_file_with_bytes_by_chance_in_it_is_refused_or_read(name, tmp_path, data):
    read, ending, make = SPECIMENS[name]
    content = make()
    for part in data.draw(st.lists(st.binary(min_size=1, max_size=12), min_size=1, max_size=3)):
        place = data.draw(st.integers(0, min(len(content), 600)))
        width = data.draw(st.sampled_from([0, len(part)]))  # put in between, or written over
        content = content[:place] + part + content[place + width :]
    path = tmp_path / f"file{ending}"
    path.write_bytes(content)
    read_or_refused(read, path)


@one_folder
@given(
    points=arrays(np.float64, st.tuples(st.integers(1, 9), st.integers(2, 3)), elements=FLOATS),
    sep=st.sampled_from(",; "),
)
def test_a_row_of_points_comes_back(tmp_path, points, sep):
    path = tmp_path / "row.csv"
    path.write_text("".join(sep.join(map(repr, row)) + "\n" for row in points.tolist()))
    np.testing.assert_array_equal(read_point_row(path), points)


@one_folder
@given(segments=arrays(np.float64, (3, 4, 4), elements=FLOATS), n_hidden=st.integers(0, 4))
def test_views_come_back(tmp_path, segments, n_hidden):
    path = tmp_path / "views.json"
    parts = [{"visible": rows[n_hidden:].tolist(), "hidden": rows[:n_hidden].tolist()} for rows in segments]
    path.write_text(json.dumps({"views": dict(zip(("front", "top", "side"), parts))}))
    for (_, view), rows in zip(read_views(path).drawing, segments):
        np.testing.assert_array_equal(view.segments.reshape(-1, 4), np.roll(rows, -n_hidden, axis=0))
        assert view.hidden.tolist() == [False] * (4 - n_hidden) + [True] * n_hidden


@one_folder
@given(points=arrays(np.float64, (3, 3), elements=FLOATS))
def test_picks_come_back(tmp_path, points):
    (tmp_path / "picks.json").write_text(json.dumps({"picks": points.tolist()}))
    np.testing.assert_array_equal(read_picks(tmp_path / "picks.json"), points)


@st.composite
def heights(draw):
    found = draw(arrays(np.float64, draw(st.tuples(st.integers(2, 6), st.integers(2, 6))), elements=FLOATS))
    found[0, : draw(st.integers(0, 2))] = np.nan
    return found


@one_folder
@given(heights=heights(), cell=st.floats(0.1, 1e3))
def test_heights_come_back_from_json(tmp_path, heights, cell):
    ny, nx = heights.shape
    rows = np.where(np.isnan(heights), None, heights)[::-1]
    path = tmp_path / "grid.json"
    path.write_text(json.dumps({"width": nx, "height": ny, "cell": cell, "values": rows.ravel().tolist()}))
    found = read_height_grid(path)
    np.testing.assert_array_equal(found.heights, heights)
    np.testing.assert_allclose(found.x, cell * np.arange(nx))


@one_folder
@given(heights=heights(), cell=st.floats(0.1, 1e3), corner=st.tuples(PLACES, PLACES))
def test_heights_come_back_from_text(tmp_path, heights, cell, corner):
    ny, nx = heights.shape
    place = f"xllcenter {corner[0]!r}\nyllcenter {corner[1]!r}\n"
    head = f"ncols {nx}\nnrows {ny}\n{place}cellsize {cell!r}\nnodata_value -9e9\n"
    rows = "".join(" ".join(map(repr, row)) + "\n" for row in np.where(np.isnan(heights), -9e9, heights)[::-1].tolist())
    (tmp_path / "grid.asc").write_text(head + rows)
    found = read_height_grid(tmp_path / "grid.asc")
    np.testing.assert_array_equal(found.heights, heights)
    np.testing.assert_allclose([found.x[-1], found.y[-1]], corner + cell * np.array([nx - 1, ny - 1]))


@st.composite
def contours(draw):
    sizes = draw(st.lists(st.integers(2, 6), min_size=1, max_size=4))
    lines = [draw(arrays(np.float64, (n, 2), elements=PLACES, unique=True)) for n in sizes]
    return lines, draw(arrays(np.float64, len(sizes), elements=st.floats(-1e3, 1e4)))


def has_room(lines):
    points = np.concatenate(lines)
    return (np.ptp(points, axis=0) > 1.0).all()


@one_folder
@given(map_of=contours())
def test_contours_come_back_from_geojson(tmp_path, map_of):
    lines, levels = map_of
    assume(has_room(lines))
    parts = [
        {"type": "Feature", "properties": {"elev": z}, "geometry": {"type": "LineString", "coordinates": line.tolist()}}
        for line, z in zip(lines, levels.tolist())
    ]
    (tmp_path / "map.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": parts}))
    found = read_contours(tmp_path / "map.geojson")
    np.testing.assert_array_equal(found.heights, levels)
    for line, kept in zip(lines, found.lines, strict=True):
        np.testing.assert_array_equal(kept, line)


@one_folder
@given(map_of=contours())
def test_contours_come_back_from_a_table(tmp_path, map_of):
    lines, levels = map_of
    assume(has_room(lines))
    rows = [f"{x!r},{y!r},{z!r},{k}" for k, z in enumerate(levels.tolist()) for x, y in lines[k].tolist()]
    (tmp_path / "map.csv").write_text("x,y,z,line\n" + "\n".join(rows) + "\n")
    found = read_contours(tmp_path / "map.csv")
    np.testing.assert_array_equal(found.heights, levels)
    for line, kept in zip(lines, found.lines, strict=True):
        np.testing.assert_array_equal(kept, line)


@st.composite
def volumes(draw):
    shape = draw(st.tuples(*[st.integers(1, 5)] * 3))
    return draw(arrays(np.dtype(draw(st.sampled_from(TYPES))), shape))


@one_folder
@given(values=volumes())
def test_values_of_a_volume_come_back_from_numpys_file(tmp_path, values):
    np.save(tmp_path / "volume.npy", values)
    np.testing.assert_array_equal(read_volume(tmp_path / "volume.npy").values, values)


@one_folder
@given(values=volumes(), spacing=st.tuples(*[st.floats(1e-3, 1e3)] * 3))
def test_values_and_spacing_of_a_volume_come_back_from_nrrd(tmp_path, values, spacing):
    kind = {"float32": "float", "float64": "double"}.get(values.dtype.name, values.dtype.name)
    size, steps = (" ".join(map(repr, row)) for row in (values.shape, spacing))
    head = f"NRRD0004\ntype: {kind}\ndimension: 3\nsizes: {size}\nspacings: {steps}\nendian: little\nencoding: raw\n\n"
    (tmp_path / "volume.nrrd").write_bytes(head.encode() + values.tobytes(order="F"))
    found = read_volume(tmp_path / "volume.nrrd")
    np.testing.assert_array_equal(found.values, values)
    np.testing.assert_allclose(found.spacing, spacing)


@st.composite
def strips(draw):
    """Points (2 n, 3) far from each other, and triangles between two rows of them."""
    n = draw(st.integers(2, 6))
    points = draw(arrays(np.float64, (2 * n, 3), elements=st.floats(-0.25, 0.25)))
    points += np.stack([np.repeat(np.arange(n), 2), np.tile([0, 1], n), np.zeros(2 * n)], axis=1)
    a = 2 * np.arange(n - 1)
    return points, np.concatenate([np.stack([a, a + 2, a + 1], axis=1), np.stack([a + 1, a + 2, a + 3], axis=1)])


def text_rows(rows, before=""):
    return "".join(before + " ".join(map(repr, row)) + "\n" for row in rows.tolist())


def as_obj(points, faces):
    return (text_rows(points, "v ") + text_rows(faces + 1, "f ")).encode()


def as_off(points, faces):
    return (f"OFF\n{len(points)} {len(faces)} 0\n" + text_rows(points) + text_rows(faces, "3 ")).encode()


def ply_head(points, faces, kind):
    axes = "".join(f"property double {axis}\n" for axis in "xyz")
    counts = f"element vertex {len(points)}\n{axes}element face {len(faces)}\nproperty list uchar int vertex_indices\n"
    return f"ply\nformat {kind} 1.0\n{counts}end_header\n"


def as_text_ply(points, faces):
    return (ply_head(points, faces, "ascii") + text_rows(points) + text_rows(faces, "3 ")).encode()


def as_binary_ply(points, faces):
    rows = np.zeros(len(faces), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    rows["count"], rows["corners"] = 3, faces
    return ply_head(points, faces, "binary_little_endian").encode() + points.astype("<f8").tobytes() + rows.tobytes()


MESHES = {".obj": [as_obj], ".off": [as_off], ".ply": [as_text_ply, as_binary_ply]}


@pytest.mark.parametrize(("ending", "write"), [(e, w) for e, ways in MESHES.items() for w in ways])
@one_folder
@given(mesh=strips())
def test_a_mesh_comes_back_with_every_digit(ending, write, tmp_path, mesh):
    path = tmp_path / f"mesh{ending}"
    path.write_bytes(write(*mesh))
    found = read_mesh(path).mesh
    np.testing.assert_array_equal(found.vertices, mesh[0])
    np.testing.assert_array_equal(found.face_vertices, mesh[1])


@one_folder
@given(mesh=strips())
def test_triangles_come_back_from_stl(tmp_path, mesh):
    points, faces = mesh
    rows = np.zeros(len(faces), np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]))
    rows["corners"] = points[faces]
    (tmp_path / "mesh.stl").write_bytes(bytes(80) + np.uint32(len(faces)).tobytes() + rows.tobytes())
    found = read_mesh(tmp_path / "mesh.stl").mesh
    np.testing.assert_array_equal(found.corners(), rows["corners"])
    assert found.n_vertices == len(points)


@one_folder
@given(mesh=strips(), sharpness=st.floats(0.01, 9.9) | st.just(np.inf))
def test_a_control_mesh_comes_back(tmp_path, mesh, sharpness):
    points, faces = mesh
    marks = {"crease_edges": faces[:1, :2], "crease_sharpness": [sharpness], "corner_vertices": faces[0, 1:2]}
    made = ControlMesh.from_faces(points, faces, **marks, corner_sharpness=[sharpness])
    write_control_mesh(made, tmp_path / "mesh.obj", scheme="loop")
    found = read_control_mesh(tmp_path / "mesh.obj")
    for name in made.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(found, name), getattr(made, name))
