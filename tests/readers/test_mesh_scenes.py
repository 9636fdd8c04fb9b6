"""Scenes of several bodies, drawn by chance: placed by transforms within transforms they come back where they are, the
outside outward; and what would be misread without a word is refused.
"""

import io
import json
import struct
import zipfile
from base64 import b64encode

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from recon.errors import BadGeometry, UnreadableFile
from recon.readers.meshes import read_mesh

few = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
SIMPLEX = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
OUTWARD = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
LENGTHS = st.floats(-100, 100)
SCALES = st.floats(0.25, 4) | st.floats(-4, -0.25)
BODY = arrays(np.float32, (4, 3), elements=st.floats(-0.125, 0.125, width=32)).map(lambda off: SIMPLEX + off)


@st.composite
def turns(draw):
    """A quaternion x y z w of length one."""
    found = draw(arrays(np.float64, 4, elements=st.floats(-1, 1)))
    return found / np.linalg.norm(found) if np.linalg.norm(found) > 0.1 else np.array([0, 0, 0, 1.0])


def turned(quaternion):
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@st.composite
def places(draw):
    """What glTF tells of a node: translation, rotation and scale."""
    three = st.tuples(LENGTHS, LENGTHS, LENGTHS)
    return {"translation": draw(three), "rotation": draw(turns()), "scale": draw(st.tuples(SCALES, SCALES, SCALES))}


def matrix_of(place):
    made = np.eye(4)
    made[:3, :3] = turned(place["rotation"]) * place["scale"]
    made[:3, 3] = place["translation"]
    return made


def placed_corners(matrix, points):
    """(4, 3, 3) corners of a body's faces, outward also where the transform mirrors."""
    corners = (points @ matrix[:3, :3].T + matrix[:3, 3])[OUTWARD]
    return corners if np.linalg.det(matrix[:3, :3]) > 0 else corners[:, ::-1]


def assert_same_triangles(found, expected, slack):
    """Each triangle once, whatever the order of the faces and the first corner of each."""
    assert len(found) == len(expected)
    ways = [np.roll(expected, k, axis=1).reshape(-1, 9) for k in range(3)]
    apart = np.min([cdist(found.reshape(-1, 9), way, "chebyshev") for way in ways], axis=0)
    assert apart[linear_sum_assignment(apart > slack)].max() <= slack


@st.composite
def trees(draw):
    """Nodes with a place and perhaps a body's number each, every one below an earlier one or below none."""
    n_bodies = draw(st.integers(1, 3))
    nodes = []
    for k in range(draw(st.integers(1, 5))):
        above = draw(st.integers(-1, k - 1))
        body = draw(st.none() | st.integers(0, n_bodies - 1)) if k else 0
        nodes.append((above, draw(places()), body))
    return [draw(BODY) for _ in range(n_bodies)], nodes


def corners_of_tree(bodies, nodes):
    matrices, found = [], []
    for above, place, body in nodes:
        matrices.append((np.eye(4) if above < 0 else matrices[above]) @ matrix_of(place))
        if body is not None:
            found.append(placed_corners(matrices[-1], bodies[body]))
    return np.concatenate(found)


INDEX_TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32}


def gltf(bodies, nodes, *, index, with_matrix, stride):
    """The JSON part and the buffer; `index` is the type of point numbers, or None for loose triangles."""
    buffer, views, accessors, meshes = b"", [], [], []

    def add(data, **view):
        nonlocal buffer
        views.append({"buffer": 0, "byteOffset": len(buffer), "byteLength": len(data), **view})
        buffer += data + bytes(-len(data) % 4)

    for points in bodies:
        rows = points.astype("<f4") if index else points[OUTWARD].reshape(-1, 3).astype("<f4")
        padded = np.zeros((len(rows), 3 + stride), "<f4")
        padded[:, :3] = rows
        add(padded.tobytes(), **({"byteStride": 4 * padded.shape[1]} if stride else {}))
        count = {"componentType": 5126, "count": len(rows), "type": "VEC3"}
        accessors.append({"bufferView": len(views) - 1, **count})
        primitive = {"attributes": {"POSITION": len(accessors) - 1}}
        if index:
            add(OUTWARD.astype(INDEX_TYPES[index]).tobytes())
            accessors.append(
                {"bufferView": len(views) - 1, "componentType": index, "count": OUTWARD.size, "type": "SCALAR"}
            )
            primitive["indices"] = len(accessors) - 1
        meshes.append({"primitives": [primitive]})
    told = []
    for above, place, body in nodes:
        matrix = {"matrix": matrix_of(place).T.ravel().tolist()}
        told.append(matrix if with_matrix else {key: list(value) for key, value in place.items()})
        if body is not None:
            told[-1]["mesh"] = body
        if above >= 0:
            told[above].setdefault("children", []).append(len(told) - 1)
    roots = [k for k, (above, _, _) in enumerate(nodes) if above < 0]
    tree = {"asset": {"version": "2.0"}, "scene": 1, "scenes": [{"nodes": []}, {"nodes": roots}], "nodes": told}
    return tree | {"meshes": meshes, "accessors": accessors, "bufferViews": views}, buffer


def as_text(tree, buffer):
    uri = "data:application/octet-stream;base64," + b64encode(buffer).decode()
    return json.dumps(tree | {"buffers": [{"byteLength": len(buffer), "uri": uri}]}).encode()


def as_container(tree, buffer):
    text = json.dumps(tree | {"buffers": [{"byteLength": len(buffer)}]}).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(buffer)
    head = struct.pack("<4sII", b"glTF", 2, size) + struct.pack("<I4s", len(text), b"JSON")
    return head + text + struct.pack("<I4s", len(buffer), b"BIN\0") + buffer


@pytest.mark.parametrize(("ending", "packed"), [(".glb", as_container), (".gltf", as_text)])
@few
@given(tree=trees(), index=st.sampled_from([None, *INDEX_TYPES]), with_matrix=st.booleans(), stride=st.integers(0, 2))
def test_bodies_of_a_gltf_scene_lie_where_its_nodes_place_them(
    ending, packed, tmp_path, tree, index, with_matrix, stride
):
    path = tmp_path / f"scene{ending}"
    path.write_bytes(packed(*gltf(*tree, index=index, with_matrix=with_matrix, stride=stride)))
    bodies, nodes = tree
    expected = 1000.0 * corners_of_tree([body.astype("<f4").astype(float) for body in bodies], nodes)
    found = read_mesh(path)
    assert_same_triangles(found.mesh.corners(), expected, 1e-9 * np.abs(expected).max())


IN_PLACE = {"translation": (0.0, 0.0, 0.0), "rotation": np.array([0, 0, 0, 1.0]), "scale": (1.0, 1.0, 1.0)}
CAMERAS = [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}]


def one_body(**changes):
    """The parts of a scene of one body, whose points are accessor 0 and whose corners are accessor 1."""
    tree, buffer = gltf([SIMPLEX], [(-1, IN_PLACE, 0)], index=5123, with_matrix=False, stride=0)
    return tree | changes, buffer


def put_glb(folder, tree, buffer):
    (folder / "scene.glb").write_bytes(as_container(tree, buffer))
    return folder / "scene.glb"


def changed(part, number, **more):
    tree, buffer = one_body()
    tree[part][number].update(more)
    return tree, buffer


UNREAD = {
    "points written over": (changed("accessors", 0, sparse={"count": 1}), "sparse"),
    "corners written over": (changed("accessors", 1, sparse={"count": 1}), "sparse"),
    "points as parts of 32767": (changed("accessors", 0, componentType=5122, normalized=True), "quantized"),
    "a morphed mesh": (changed("meshes", 0, weights=[0.5]), "morphed"),
    "a morphed node": (changed("nodes", 0, weights=[0, 1]), "morphed"),
    "one mesh in many places": (one_body(extensionsUsed=["EXT_mesh_gpu_instancing"]), "many places"),
    "an extension that nobody knows": (one_body(extensionsRequired=["ACME_mesh"]), "parts that need ACME_mesh"),
    "a count that is no number": (changed("accessors", 0, count="4"), "promises more numbers"),
}


@pytest.mark.parametrize("what", UNREAD)
def test_a_gltf_scene_that_would_be_misread_is_refused(what, tmp_path):
    (tree, buffer), told = UNREAD[what]
    with pytest.raises(UnreadableFile, match=told):
        read_mesh(put_glb(tmp_path, tree, buffer))


def test_extensions_that_change_no_triangle_do_not_keep_a_scene_from_being_read(tmp_path):
    scene = one_body(extensionsRequired=["KHR_materials_unlit", "KHR_texture_transform"])
    assert read_mesh(put_glb(tmp_path, *scene)).mesh.n_faces == 4


@pytest.mark.parametrize("packed", [as_container, as_text])
def test_what_hangs_on_a_camera_is_read(packed, tmp_path):
    nodes = [{"mesh": 0, "camera": 0, "children": [1]}, {"mesh": 0, "translation": [2, 0, 0]}]
    path = tmp_path / ("scene.glb" if packed is as_container else "scene.gltf")
    path.write_bytes(packed(*one_body(nodes=nodes, cameras=CAMERAS)))
    assert read_mesh(path).mesh.vertices[:, 0].max() == 3000.0


def test_a_corner_of_one_body_of_a_scene_is_no_point_of_another(tmp_path):
    tree, buffer = gltf(
        [SIMPLEX, SIMPLEX + 2], [(-1, IN_PLACE, 0), (-1, IN_PLACE, 1)], index=5121, with_matrix=False, stride=0
    )
    at = tree["bufferViews"][1]["byteOffset"]
    with pytest.raises(BadGeometry, match="names point 5, but the body has 4"):
        read_mesh(put_glb(tmp_path, tree, buffer[:at] + b"\5" + buffer[at + 1 :]))


def xml_of_3mf(bodies, groups, items):
    """A model of bodies, of groups that hold numbered bodies or earlier groups, and of what is built."""

    def transform(matrix):
        return f'transform="{" ".join(map(repr, matrix[:3].T.ravel().tolist()))}"'

    objects = []
    for points in bodies:
        vertices = "".join(f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in points.tolist())
        faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in OUTWARD)
        objects.append(f"<mesh><vertices>{vertices}</vertices><triangles>{faces}</triangles></mesh>")
    for group in groups:
        parts = "".join(f'<component objectid="{k + 1}" {transform(matrix)}/>' for k, matrix in group)
        objects.append(f"<components>{parts}</components>")
    told = "".join(f'<object id="{k + 1}" type="model">{content}</object>' for k, content in enumerate(objects))
    built = "".join(f'<item objectid="{k + 1}" {transform(matrix)} {more}/>' for k, matrix, more in items)
    return (
        '<?xml version="1.0"?><model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"'
        ' xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06">'
        f"<resources>{told}</resources><build>{built}</build></model>"
    )


def archive(**parts):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as made:
        for name, text in parts.items():
            made.writestr(f"3D/{name}.model", text)
    return file.getvalue()


@st.composite
def packages(draw):
    """Bodies, groups of bodies and of earlier groups, and items of any of them."""
    bodies = [draw(BODY) for _ in range(draw(st.integers(1, 3)))]
    known, groups = len(bodies), []
    matrices = places().map(matrix_of)
    for _ in range(draw(st.integers(0, 2))):
        parts = st.tuples(st.integers(0, known - 1), matrices)
        groups.append(draw(st.lists(parts, min_size=1, max_size=3)))
        known += 1
    more = st.sampled_from(["", 'partnumber="A-1"', 'partnumber="A-2"'])
    items = st.lists(st.tuples(st.integers(0, known - 1), matrices, more), min_size=1, max_size=4)
    return bodies, groups, draw(items)


def corners_of_package(bodies, groups, number, matrix):
    if number < len(bodies):
        return [placed_corners(matrix, bodies[number])]
    parts = groups[number - len(bodies)]
    return [c for k, within in parts for c in corners_of_package(bodies, groups, k, matrix @ within)]


@few
@given(package=packages())
def test_bodies_of_a_3mf_package_lie_where_its_items_and_components_place_them(tmp_path, package):
    bodies, groups, items = package
    path = tmp_path / "package.3mf"
    path.write_bytes(archive(**{"3dmodel": xml_of_3mf(bodies, groups, items)}))
    parts = [c for k, matrix, _ in items for c in corners_of_package(bodies, groups, k, matrix)]
    expected = np.concatenate(parts)
    found = read_mesh(path)
    assert_same_triangles(found.mesh.corners(), expected, 1e-9 * np.abs(expected).max())


def put_3mf(folder, **models):
    (folder / "package.3mf").write_bytes(archive(**models))
    return folder / "package.3mf"


SHIFT = np.array([[1, 0, 0, 3], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def test_one_part_number_does_not_make_two_items_one(tmp_path):
    twice = [(0, np.eye(4), 'partnumber="7"'), (0, SHIFT, 'partnumber="7"')]
    assert read_mesh(put_3mf(tmp_path, **{"3dmodel": xml_of_3mf([SIMPLEX], [], twice)})).n_bodies == 2


def test_numbers_of_objects_count_within_the_model_that_holds_them(tmp_path):
    items = [(1, np.eye(4), ""), (1, SHIFT @ SHIFT, "")]
    main = xml_of_3mf([SIMPLEX], [[(0, np.eye(4)), (0, SHIFT)]], items)
    # object 1 of each further model; a second object stands in one of them that nothing names
    first, second = (f'p:path="/3D/{name}.model" objectid="1" transform="1 0 0' for name in ("small", "large"))
    main = main.replace('<component objectid="1" transform="1.0 0.0 0.0', f"<component {first}", 1)
    main = main.replace('<component objectid="1" transform="1.0 0.0 0.0', f"<component {second}", 1)
    parts = {"small": xml_of_3mf([0.5 * SIMPLEX, SIMPLEX], [], []), "large": xml_of_3mf([2 * SIMPLEX], [], [])}
    found = read_mesh(put_3mf(tmp_path, **{"3dmodel": main, **parts}))
    assert found.n_bodies == 4
    assert found.mesh.volume() == pytest.approx(2 * (0.5**3 + 2**3) / 6)


REFUSED = {
    "its own part": (xml_of_3mf([SIMPLEX], [[(1, SHIFT)]], [(1, SHIFT, "")]), "hold each other"),
    "a part that is not there": (xml_of_3mf([SIMPLEX], [[(4, SHIFT)]], [(1, SHIFT, "")]), "builds object '5'"),
    "a model that is not there": (
        xml_of_3mf([SIMPLEX], [], [(0, SHIFT, 'p:path="/3D/a.model"')]),
        "has no part '3d/a.model'",
    ),
    "an extension that changes the shape": (
        xml_of_3mf([SIMPLEX], [], [(0, SHIFT, "")]).replace("<model", '<model requiredextensions="b"'),
        "needs the extension b",
    ),
    "half a transform": (
        xml_of_3mf([SIMPLEX], [], [(0, SHIFT, "")]).replace("3.0 0.0 0.0", "3.0"),
        "cannot be read as 3MF",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_3mf_package_that_would_be_misread_is_refused(what, tmp_path):
    model, told = REFUSED[what]
    with pytest.raises(UnreadableFile, match=told):
        read_mesh(put_3mf(tmp_path, **{"3dmodel": model}))


def test_objects_within_objects_do_not_unfold_for_ever(tmp_path, monkeypatch):
    monkeypatch.setattr("recon.readers.threemf.MOST_BODIES", 1000)
    groups = [[(k, np.eye(4))] * 10 for k in range(20)]
    with pytest.raises(UnreadableFile, match="unfold without end"):
        read_mesh(put_3mf(tmp_path, **{"3dmodel": xml_of_3mf([SIMPLEX], groups, [(20, SHIFT, "")])}))


def test_a_corner_of_one_body_of_a_package_is_no_point_of_another(tmp_path):
    model = xml_of_3mf([SIMPLEX, SIMPLEX], [], [(0, np.eye(4), ""), (1, SHIFT, "")])
    with pytest.raises(BadGeometry, match="names point 5, but the body has 4"):
        read_mesh(put_3mf(tmp_path, **{"3dmodel": model.replace('v3="1"', 'v3="5"', 1)}))


@st.composite
def grouped(draw):
    """Bodies one after the other, whose points count from the first or backwards from the last one known."""
    return draw(st.lists(st.tuples(BODY, LENGTHS, st.booleans()), min_size=1, max_size=5))


@few
@given(bodies=grouped())
def test_bodies_of_the_groups_of_an_obj_file_come_back(tmp_path, bodies):
    lines, parts, before = ["mtllib none.mtl"], [], 0
    for k, (body, shift, backwards) in enumerate(bodies):
        points = body + np.array([shift, 0, 0])
        parts.append(points[OUTWARD])
        lines += [f"{'og'[k % 2]} part {k}", "usemtl grey", f"s {k}"]
        lines += ["v " + " ".join(map(repr, row)) for row in points.tolist()]
        first = -4 if backwards else before + 1
        lines += ["f " + " ".join(f"{first + v}//{v + 1}" for v in row) for row in OUTWARD.tolist()]
        before += 4
    path = tmp_path / "groups.obj"
    path.write_text("\n".join(lines))
    assert_same_triangles(read_mesh(path).mesh.corners(), np.concatenate(parts), 0.0)
