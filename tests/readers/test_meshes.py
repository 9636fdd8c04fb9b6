import io
import json
import struct
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from recon.errors import BadGeometry, BadOption, ReconError, UnreadableFile, UnsupportedFormat
from recon.numerics.halfedges import free_edges
from recon.readers.meshes import MESH_ENDINGS, read_mesh

DATA = Path(__file__).parents[2].parent / "shared" / "data"
needs_data = pytest.mark.skipif(not DATA.exists(), reason="the folder of real measurements is not here")

# A box of 2 x 3 x 4 in quads, seen from outside.
CORNERS = np.array([[x, y, z] for z in (0, 4) for y in (0, 3) for x in (0, 2)], dtype=float)
QUADS = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]])
TRIANGLES = QUADS[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
VOLUME = 2 * 3 * 4
STRIP = [0, 1, 2, 3, -1, 5, 4, 7, 6, -1]  # the strips of two opposite sides of a box with other corner numbers


def ply(encoding, points=CORNERS, faces=tuple(QUADS), *, strips=(), index="int", extra=False):
    """A PLY file; `extra` puts further properties before, between and after those that matter."""
    counter = "uchar" if max((len(f) for f in faces), default=3) < 256 else "int"
    head = ["ply", f"format {encoding} 1.0", "comment made by a test", f"element vertex {len(points)}"]
    head += ["property uchar red"] * extra + [f"property double {axis}" for axis in "xyz"]
    head += [f"element face {len(faces)}"] * bool(len(faces) or not strips)
    head += ["property float quality"] * extra * bool(len(faces))
    head += [f"property list {counter} {index} vertex_indices"] * bool(len(faces) or not strips)
    head += ["property uchar flag"] * extra * bool(len(faces))
    head += [f"element tristrips {len(strips)}", f"property list int {index} vertex_indices"] * bool(len(strips))
    order = ">" if "big" in encoding else "<"
    code = {"int": "i", "uint": "I", "short": "h"}[index]
    count = {"uchar": "B", "int": "i"}[counter]
    rows = [("B3d" if extra else "3d", [7, *p] if extra else [*p]) for p in points]
    for f in faces:
        rows.append((f"{'f' * extra}{count}{len(f)}{code}{'B' * extra}", [*[0.5] * extra, len(f), *f, *[1] * extra]))
    for s in strips:
        rows.append((f"i{len(s)}{code}", [len(s), *[v % 2**32 if index == "uint" else v for v in s]]))
    if encoding == "ascii":
        body = "\n".join(" ".join(repr(v.item() if hasattr(v, "item") else v) for v in row) for _, row in rows).encode()
    else:
        body = b"".join(struct.pack(order + form, *row) for form, row in rows)
    return "\n".join([*head, "end_header\n"]).encode() + body


def stl(encoding, corners=CORNERS[TRIANGLES]):
    if encoding == "binary":
        rows = b"".join(struct.pack("<12fH", 0, 0, 0, *c.ravel(), 0) for c in corners)
        return b"solid but binary".ljust(80) + struct.pack("<I", len(corners)) + rows
    facet = "facet normal 0 0 0\n outer loop\n{}\n endloop\nendfacet\n"
    body = "".join(facet.format("\n".join(f"  vertex {x} {y} {z}" for x, y, z in c)) for c in corners.tolist())
    return f"solid facet of a box\n{body}endsolid box\n".encode()


def obj(points=CORNERS, faces=tuple(QUADS), *, backwards=False):
    lines = [f"v {x} {y} {z}" for x, y, z in points]
    lines += ["f " + " ".join(str(v - len(points) if backwards else v + 1) for v in f) for f in faces]
    return "\n".join(["# a box", "mtllib none.mtl", "vt 0 0", *lines, "l 1 2"]).encode()


def off(points=CORNERS, faces=tuple(QUADS), head="OFF"):
    lines = [f"{x} {y} {z}" for x, y, z in points] + [f"{len(f)} {' '.join(map(str, f))} 0.1 0.2 0.3" for f in faces]
    return "\n".join([head, "# a box", f"{len(points)} {len(faces)} 0", "", *lines]).encode()


def threemf(unit="millimeter", corners=CORNERS, transform="1 0 0 0 1 0 0 0 1 0 0 0"):
    points = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in corners)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in TRIANGLES)
    model = (
        f'<?xml version="1.0"?><model unit="{unit}" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
        f'<resources><object id="1" type="model"><mesh><vertices>{points}</vertices>'
        f"<triangles>{faces}</triangles></mesh></object></resources>"
        f'<build><item objectid="1" transform="{transform}"/></build></model>'
    )
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", model)
    return file.getvalue()


def glb(mode=4, **extra):
    index, place = TRIANGLES.astype("<u4").tobytes(), CORNERS.astype("<f4").tobytes()
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": [1, 0, 0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 1}, "indices": 0, "mode": mode}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5125, "count": TRIANGLES.size, "type": "SCALAR"},
            {
                "bufferView": 1,
                "componentType": 5126,
                "count": len(CORNERS),
                "type": "VEC3",
                "min": [0, 0, 0],
                "max": [2, 3, 4],
            },
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(index)},
            {"buffer": 0, "byteOffset": len(index), "byteLength": len(place)},
        ],
        "buffers": [{"byteLength": len(index) + len(place)}],
        **extra,
    }
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(index + place), b"BIN\0")
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks) + len(index + place)) + chunks + index + place


ENCODINGS = ("ascii", "binary_little_endian", "binary_big_endian")
WHOLE = {
    **{f"{e}.ply": ply(e) for e in ENCODINGS},
    **{f"{e} extra.ply": ply(e, extra=True) for e in ENCODINGS},
    **{f"{e} uneven.ply": ply(e, faces=[*QUADS[:5], *TRIANGLES[10:]], extra=True) for e in ENCODINGS},
    "text.stl": stl("text"),
    "binary.stl": stl("binary"),
    "box.obj": obj(),
    "backwards.obj": obj(backwards=True),
    "box.off": off(),
    "counts behind the word.off": off(head="COFF").replace(b"COFF\n# a box\n", b"COFF "),
    "box.3mf": threemf(),
}


def written(folder, name, content):
    file = folder / name
    file.write_bytes(content)
    return file


@pytest.mark.parametrize("name", WHOLE)
def test_every_format_gives_the_same_box(name, tmp_path):
    found = read_mesh(written(tmp_path, name, WHOLE[name]))
    assert found.mesh.n_vertices == 8
    assert found.n_bodies == 1
    assert_allclose(found.mesh.volume(), VOLUME, rtol=1e-6)
    assert_array_equal(np.sort(found.mesh.vertices, axis=0), np.sort(CORNERS, axis=0))
    if not name.endswith(".stl"):
        assert_array_equal(found.mesh.vertices, CORNERS)
        assert found.notes == ()


def test_upper_case_endings_and_names_outside_ascii_are_read(tmp_path):
    assert read_mesh(written(tmp_path, "縄文土器 ß.PLY", ply("ascii"))).mesh.name == "縄文土器 ß.PLY"


def test_loose_triangles_are_joined_and_counted(tmp_path):
    found = read_mesh(written(tmp_path, "box.stl", stl("binary")))
    assert found.notes == ("28 points that equal another were merged with it",)


def test_zero_and_minus_zero_are_one_place(tmp_path):
    corners = CORNERS[TRIANGLES].copy()
    corners[::2][corners[::2] == 0] = -0.0
    assert read_mesh(written(tmp_path, "box.stl", stl("binary", corners))).mesh.n_vertices == 8


@pytest.mark.parametrize("index", ["int", "uint"])
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_triangle_strips_turn_every_second_triangle_over(encoding, index, tmp_path):
    # A band of two squares per strip, seen from above: every triangle has its normal along +z.
    points = np.array([[x, y, 0] for x in range(4) for y in (1, 0)], dtype=float)
    strips = [[0, 1, 2, 3, 4, 5, -1, 5, 7, 4, 6], [6, 6, 6]]
    found = read_mesh(written(tmp_path, "s.ply", ply(encoding, points, (), strips=strips, index=index)))
    normals = found.mesh.area_vectors()
    assert_allclose(normals[:, 2], 0.5)
    assert found.mesh.n_faces == 6
    assert "7 triangles were read from triangle strips" in found.notes


def test_faces_and_strips_of_one_file_are_both_read(tmp_path):
    found = read_mesh(written(tmp_path, "s.ply", ply("ascii", faces=tuple(QUADS[1:]), strips=[[2, 3, 0, 1]])))
    assert found.mesh.n_faces == 12
    assert_allclose(found.mesh.volume(), VOLUME)


def polygon(kind):
    if kind == "star":
        angle = np.arange(10) * np.pi / 5
        return np.c_[np.cos(angle), np.sin(angle)] * np.where(np.arange(10) % 2, 0.4, 1.0)[:, None]
    if kind == "dart":
        return np.array([[0, 0], [2, 1], [0, 2], [0.5, 1]], dtype=float)
    if kind == "comb":
        return np.array(
            [[0, 0], [5, 0], [5, 3], [4, 3], [4, 1], [3, 1], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]]
        )
    return np.array([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [0, 2]], dtype=float)  # a corner of 180 degrees


@pytest.mark.parametrize("turn", [0, 1, 3])
@pytest.mark.parametrize("kind", ["star", "dart", "comb", "square with points on its sides"])
def test_polygons_are_covered_once_by_triangles_of_their_own_sense(kind, turn, tmp_path):
    flat = np.roll(polygon(kind), turn, axis=0)
    x, y = flat.T
    area = 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))
    tilted = np.c_[x, 0.6 * y, 0.8 * y] * 10
    mesh = read_mesh(written(tmp_path, "p.off", off(tilted, [np.arange(len(flat))]))).mesh
    vectors = mesh.area_vectors()
    assert mesh.n_faces == len(flat) - 2
    assert_allclose(np.linalg.norm(vectors, axis=1).sum(), 100 * area, rtol=1e-12)
    assert_allclose(vectors.sum(axis=0), 100 * area * np.array([0, -0.8, 0.6]), atol=1e-9)


def test_two_bodies_stay_in_one_mesh_and_are_counted(tmp_path):
    two = obj(np.concatenate([CORNERS, CORNERS + 10]), [*QUADS, *(QUADS + 8)])
    found = read_mesh(written(tmp_path, "two.obj", two))
    assert found.n_bodies == 2
    assert_allclose(found.mesh.volume(), 2 * VOLUME)
    assert "the mesh has 2 bodies, which were kept together" in found.notes


def test_faces_without_three_points_are_dropped_and_counted(tmp_path):
    found = read_mesh(written(tmp_path, "d.off", off(faces=[*QUADS, [0, 1, 1], [2, 2, 2]])))
    assert found.mesh.n_faces == 12
    assert "2 faces with two corners in the same point were dropped" in found.notes


def test_faces_on_a_line_are_kept_for_they_close_the_surface_and_counted(tmp_path):
    # The side from corner 0 to corner 1 is halved in one of its two faces only; a face on a line fills the slit.
    points = np.concatenate([CORNERS, [[1, 0, 0]]])
    faces = [*QUADS[[0, 1, 3, 4, 5]], [0, 8, 1, 5, 4], [0, 1, 8]]
    found = read_mesh(written(tmp_path, "slit.off", off(points, faces)))
    assert len(free_edges(found.mesh.face_vertices)) == 0
    assert_allclose(found.mesh.volume(), VOLUME)
    assert found.notes == ("1 faces have no area; they were kept, since dropping them would open the surface",)


def test_points_that_no_face_uses_are_left_out_even_when_they_are_no_numbers(tmp_path):
    found = read_mesh(written(tmp_path, "l.off", off(np.concatenate([CORNERS, [[np.nan, 0, 0]]]))))
    assert_array_equal(found.mesh.vertices, CORNERS)
    assert "1 points that no face uses were left out" in found.notes


def test_what_is_no_oriented_surface_is_said(tmp_path):
    flipped = [*QUADS[:5], QUADS[5][::-1]]
    assert any("disagree" in note for note in read_mesh(written(tmp_path, "f.off", off(faces=flipped))).notes)
    fin = [*QUADS, [0, 1, 7]]
    assert any("three faces" in note for note in read_mesh(written(tmp_path, "t.off", off(faces=fin))).notes)


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1.0), ("cm", 10.0), ("m", 1000.0), ("inch", 25.4)])
def test_stated_units_are_scaled_to_millimetres(unit, scale, tmp_path):
    found = read_mesh(written(tmp_path, "box.ply", ply("ascii")), unit=unit)
    assert_allclose(found.mesh.vertices, scale * CORNERS)
    assert bool(found.notes) == (unit != "mm")


@pytest.mark.parametrize(
    ("unit", "scale"),
    [("micron", 1e-3), ("millimeter", 1), ("centimeter", 10), ("inch", 25.4), ("foot", 304.8), ("meter", 1000)],
)
def test_3mf_files_carry_their_unit(unit, scale, tmp_path):
    found = read_mesh(written(tmp_path, "box.3mf", threemf(unit)))
    assert_allclose(found.mesh.volume(), VOLUME * scale**3)


def test_3mf_objects_lie_where_they_are_built(tmp_path):
    found = read_mesh(written(tmp_path, "box.3mf", threemf(transform="0 1 0 -1 0 0 0 0 1 7 8 9")))
    assert_allclose(found.mesh.vertices.min(axis=0), [7 - 3, 8, 9])
    assert_allclose(found.mesh.volume(), VOLUME)


def test_glb_is_in_metres_and_its_nodes_are_placed(tmp_path):
    file = written(tmp_path, "box.glb", glb())
    found = read_mesh(file)
    assert_allclose(found.mesh.vertices, 1000 * (CORNERS + np.eye(3)[0]))
    assert found.notes == ("the file's unit is 1000 mm; the mesh was scaled to millimetres",)
    stated = read_mesh(file, unit="mm")
    assert_allclose(stated.mesh.vertices, CORNERS + np.eye(3)[0])
    assert "mm was asked for" in stated.notes[0]


def test_a_mesh_smaller_than_its_unit_is_suspected_of_metres_but_not_scaled(tmp_path):
    small = written(tmp_path, "small.off", off(CORNERS / 100))
    found = read_mesh(small)
    assert_allclose(found.mesh.vertices, CORNERS / 100)
    assert "probably metres" in found.notes[-1]
    assert read_mesh(small, unit="mm").notes == ()


DAMAGED = {
    "empty.ply": (b"", UnreadableFile, "is empty"),
    "blank.obj": (b"\n \n", UnreadableFile, "is empty"),
    "page.ply": (b"<!DOCTYPE html><html><body>404</body></html>", UnreadableFile, "a web page"),
    "page.stl": (b"<html>" + b"x" * 200, UnreadableFile, "a web page"),
    "page.obj": (b"<html>\nno</html>", UnreadableFile, "a web page"),
    "page.glb": (b"<html></html>", UnreadableFile, "a web page"),
    "page.3mf": (b"<html></html>", UnreadableFile, "a web page"),
    "other.stl": (ply("binary_little_endian"), UnreadableFile, "a PLY mesh"),
    "other.off": (ply("ascii"), UnreadableFile, "a PLY mesh"),
    "points.ply": (ply("ascii", faces=()), BadGeometry, "8 points but no faces"),
    "points.obj": (obj(faces=()), BadGeometry, "8 points but no faces"),
    "points.off": (off(faces=()), BadGeometry, "8 points but no faces"),
    "nothing.ply": (ply("ascii", CORNERS[:0], ()), BadGeometry, "no points and no faces"),
    "nothing.stl": (b"solid nothing\nendsolid nothing\n", BadGeometry, "no points and no faces"),
    "huge.ply": (ply("binary_little_endian").replace(b"face 6", b"face 99999999999999"), UnreadableFile, "promises"),
    "huge text.ply": (ply("ascii").replace(b"vertex 8", b"vertex 99999999999999"), UnreadableFile, "promises"),
    "huge.stl": (stl("binary")[:80] + b"\xff\xff\xff\xff" + stl("binary")[84:], UnreadableFile, "promises 4294967295"),
    "huge.off": (off().replace(b"8 6 0", b"8 999999999999 0"), UnreadableFile, "promises"),
    "cut.ply": (ply("binary_big_endian")[:-3], UnreadableFile, "promises 6 of face"),
    "cut.stl": (stl("text")[:-60], UnreadableFile, "in the middle of a solid"),
    "cut binary.stl": (stl("binary")[:-60], UnreadableFile, "promises 12 triangles, but the file holds 10"),
    "cut.glb": (glb()[:-8], UnreadableFile, "shorter than its header says"),
    "cut.3mf": (threemf()[:-30], UnreadableFile, "whole 3MF archive"),
    "header.ply": (b"ply\nformat ascii 1.0\nelement vertex 3\n", UnreadableFile, "no end"),
    "format.ply": (ply("ascii").replace(b"format ascii", b"format middle_endian"), UnreadableFile, "middle_endian"),
    "type.ply": (ply("ascii").replace(b"double x", b"quaternion x"), UnreadableFile, "unknown type"),
    "axes.ply": (ply("ascii").replace(b"double z", b"double w"), UnreadableFile, "no properties x, y and z"),
    "columns.ply": (ply("ascii").replace(b"property double z\n", b""), ReconError, "."),
    "word.ply": (ply("ascii").replace(b"\n4 0", b"\nfour 0"), UnreadableFile, "'four' where a number belongs"),
    "length.ply": (ply("ascii").replace(b"\n4 0", b"\n-4 0"), UnreadableFile, "has the length -4"),
    "range.ply": (ply("ascii", faces=[[0, 1, 8]]), BadGeometry, "face 0 names point 8"),
    "below.ply": (ply("ascii", faces=[[0, 1, 2], [0, 1, -1]]), BadGeometry, "face 1 names point -1"),
    "range.obj": (obj(faces=[[0, 1, 8]]), BadGeometry, "face 0 names point 8"),
    "zero.obj": (obj(faces=[[-1, 1, 2]]), BadGeometry, "point 0"),
    "back.obj": (obj(faces=[[-20, 1, 2]]), BadGeometry, "face 0 names point"),
    "two.obj": (obj(faces=[[0, 1, 2], [0, 1]]), BadGeometry, "face 1 names 2 points"),
    "two.off": (off(faces=[[0, 1]]), BadGeometry, "face 0 names 2 points"),
    "short.obj": (obj() + b"\nv 1 2", UnreadableFile, "fewer than three numbers"),
    "half.ply": (ply("ascii").replace(b"\n4 0", b"\n4 0.5"), BadGeometry, "whole number"),
    "nan.ply": (ply("binary_little_endian", CORNERS * [1, np.nan, 1]), BadGeometry, "not a finite number"),
    "inf.stl": (stl("binary", np.where(CORNERS[TRIANGLES] > 0, np.inf, 0.0)), BadGeometry, "not a finite number"),
    "far.obj": (obj(CORNERS * 1e200), BadGeometry, "more than anything"),
    "flat.off": (off(CORNERS * 0), BadGeometry, "three different points"),
    "unit.3mf": (threemf("furlong"), UnreadableFile, "unknown unit 'furlong'"),
    "no model.3mf": (threemf().replace(b"3dmodel", b"4dmodel"), UnreadableFile, "no undamaged 3D model"),
    "fans.glb": (glb(mode=6), UnreadableFile, "triangle fans"),
    "lines.glb": (glb(mode=1), BadGeometry, "no faces"),
    "draco.glb": (glb(extensionsUsed=["KHR_draco_mesh_compression"]), UnreadableFile, "compressed"),
    "no asset.gltf": (b"[1, 2]", UnreadableFile, "no asset"),
    "no buffer.gltf": (
        b'{"asset": {"version": "2.0"}, "buffers": [{"uri": "gone.bin", "byteLength": 9}]}',
        UnreadableFile,
        "cannot be read",
    ),
    "binary.off": (b"OFF BINARY\n\0\0\0\1", UnreadableFile, "binary OFF"),
    "four.off": (b"4OFF\n1 0 0\n0 0 0 0", UnreadableFile, "points in space"),
}


@pytest.mark.parametrize("name", DAMAGED)
@pytest.mark.filterwarnings("error")
def test_damage_is_refused_in_one_sentence_that_names_file_and_fault(name, tmp_path, capfd):
    content, kind, words = DAMAGED[name]
    file = written(tmp_path, name, content)
    with pytest.raises(kind) as caught:
        read_mesh(file)
    assert words in str(caught.value)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_missing_files_folders_and_other_endings_are_refused(tmp_path):
    with pytest.raises(UnreadableFile, match="no such file"):
        read_mesh(tmp_path / "none.ply")
    with pytest.raises(UnreadableFile, match="is a folder"):
        read_mesh(tmp_path)
    for name in ("drawing.dxf", "mesh", "mesh.ply.gz"):
        with pytest.raises(UnsupportedFormat, match=r"\.ply \.stl"):
            read_mesh(written(tmp_path, name, b"0"))
    assert set(MESH_ENDINGS) >= {Path(name).suffix for name in DAMAGED}


def test_a_file_that_may_not_be_read_is_refused(tmp_path, monkeypatch):
    def refuse(self):
        raise PermissionError(13, "denied")

    file = written(tmp_path, "box.ply", ply("ascii"))
    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(UnreadableFile, match="may not be read"):
        read_mesh(file)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no named pipes in the file system")
def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    import os

    os.mkfifo(tmp_path / "pipe.ply")
    with pytest.raises(UnreadableFile, match="a device or a pipe"):
        read_mesh(tmp_path / "pipe.ply")


def test_unknown_units_are_refused(tmp_path):
    with pytest.raises(BadOption, match="mm, cm, m, inch"):
        read_mesh(written(tmp_path, "box.ply", ply("ascii")), unit="furlong")


@pytest.mark.parametrize("length", [1, 34, 79, 83, 84])
def test_a_text_stl_cut_off_before_its_first_facet_is_refused(tmp_path, length):
    with pytest.raises(UnreadableFile, match=r"box\.stl"):
        read_mesh(written(tmp_path, "box.stl", WHOLE["text.stl"][:length]))


@pytest.mark.filterwarnings("error")
@settings(max_examples=300)
@given(st.data())
def test_a_file_cut_off_or_changed_anywhere_gives_a_mesh_or_one_of_our_errors(tmp_path_factory, data):
    name = data.draw(st.sampled_from([*WHOLE, "box.glb"]))
    content = bytearray(WHOLE.get(name) or glb())
    for place, byte in data.draw(
        st.lists(st.tuples(st.integers(0, len(content) - 1), st.integers(0, 255)), max_size=3)
    ):
        content[place] = byte
    cut = data.draw(st.integers(1, len(content)))
    file = written(tmp_path_factory.mktemp("cut"), name, bytes(content[:cut]))
    try:
        mesh = read_mesh(file).mesh
    except ReconError:
        return
    assert mesh.n_faces > 0
    assert np.isfinite(mesh.vertices).all()


@needs_data
@pytest.mark.parametrize(
    ("name", "n_faces"),
    [
        ("bad/hole_capsule.off", 152),
        ("bad/negative_indices.obj", 12),
        ("bad/sphereWithHole.stl", 285),
        ("bad/soup.stl", 100),
        ("bad/joined_tetrahedra.obj", 8),
        ("scans/horse.ply", 96966),
        ("scans/bunny_closed.off", 69666),
        ("scans/rocker-arm.obj", 20088),
    ],
)
def test_real_files_give_all_their_faces(name, n_faces):
    assert read_mesh(DATA / name).mesh.n_faces == n_faces


@needs_data
@pytest.mark.parametrize(
    "name", ["empty.obj", "empty.off", "empty.ply", "empty.stl", "notenoughindices.obj", "pond.0.ply", "recover01.dxf"]
)
def test_real_damaged_files_are_refused(name):
    with pytest.raises(ReconError, match=name):
        read_mesh(DATA / "bad" / name)
