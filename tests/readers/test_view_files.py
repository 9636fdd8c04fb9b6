"""Drawings from files: the sheet that was written is the drawing that is read, or one sentence says why not."""

import json

import ezdxf
import numpy as np
import pytest

from recon.errors import BadGeometry, CurvedDrawing, UnreadableFile, UnsupportedFormat
from recon.readers.views import read_views

# an L-shaped block with a groove, so that no two views are alike: 40 wide, 20 deep, 30 high
FRONT = [[0, 0, 40, 0], [40, 0, 40, 10], [40, 10, 15, 10], [15, 10, 15, 30], [15, 30, 0, 30], [0, 30, 0, 0]]
TOP = [[0, 0, 40, 0], [40, 0, 40, 20], [40, 20, 0, 20], [0, 20, 0, 0], [15, 0, 15, 20]]
SIDE = [[0, 0, 20, 0], [20, 0, 20, 30], [20, 30, 0, 30], [0, 30, 0, 0], [0, 10, 20, 10]]
DASHED = {"front": [[5, 0, 5, 30]], "top": [[5, 5, 5, 15]], "side": [[5, 12, 15, 12]]}
VIEWS = {"front": FRONT, "top": TOP, "side": SIDE}
PLACES = {
    "third angle, side view from the right": {"front": (0, 0), "top": (0, 50), "side": (60, 0)},
    "first angle, side view from the right": {"front": (0, 0), "top": (0, -40), "side": (-40, 0)},
    "first angle, side view from the left": {"front": (0, 0), "top": (0, -40), "side": (60, 0)},
    "third angle, side view from the left": {"front": (0, 0), "top": (0, 50), "side": (-40, 0)},
}


def sheet(places, *, scale=None, hidden=None):
    """A DXF document with the views at their places; `hidden` are the attributes that dashed lines get."""
    document = ezdxf.new("R2010", setup=True)
    document.units = ezdxf.units.MM
    document.layers.add("HIDDEN", linetype="DASHED")
    space = document.modelspace()
    scale = scale or {}
    for name, (x, y) in places.items():
        for segments, attributes in ((VIEWS[name], {}), (DASHED[name], hidden or {"layer": "HIDDEN"})):
            for a, b, c, d in np.array(segments) * scale.get(name, 1.0):
                space.add_line((a + x, b + y), (c + x, d + y), dxfattribs=attributes)
    return document


def rows(view):
    found = set()
    for ends, hidden in zip(np.round(view.segments, 6).tolist(), view.hidden):
        a, b = sorted(map(tuple, ends))
        found.add((*a, *b, bool(hidden)))
    return found


def expected(name):
    found = set()
    for segments, hidden in ((VIEWS[name], False), (DASHED[name], True)):
        for a, b, c, d in segments:
            found.add((*map(float, (*min((a, b), (c, d)), *max((a, b), (c, d)))), hidden))
    return found


@pytest.mark.parametrize("layout", [name for name in PLACES if "right" in name])
def test_each_arrangement_of_the_views_is_told_from_its_empty_quarter(layout, tmp_path):
    path = tmp_path / "part.dxf"
    sheet(PLACES[layout]).saveas(path)
    read = read_views(path)
    assert layout in read.notes
    assert not read.mirrored
    assert [rows(view) for _, view in read.drawing] == [expected(name) for name in VIEWS]


@pytest.mark.parametrize("layout", [name for name in PLACES if "left" in name])
def test_a_side_view_from_the_left_is_read_as_the_mirror_image(layout, tmp_path):
    path = tmp_path / "part.dxf"
    sheet(PLACES[layout]).saveas(path)
    read = read_views(path)
    assert layout in read.notes
    assert read.mirrored
    turned = read.drawing.front.segments * [-1, 1] + [40, 0]
    assert rows(type(read.drawing.front)(turned, read.drawing.front.hidden)) == expected("front")


@pytest.mark.parametrize(
    "hidden", [{"linetype": "HIDDEN"}, {"linetype": "DASHED2"}, {"linetype": "ACAD_ISO02W100"}, {"layer": "VERDECKT"}]
)
def test_hidden_lines_are_known_by_line_type_or_layer(hidden, tmp_path):
    path = tmp_path / "part.dxf"
    sheet(PLACES["third angle, side view from the right"], hidden=hidden).saveas(path)
    assert [int(view.hidden.sum()) for _, view in read_views(path).drawing] == [1, 1, 1]


def test_views_at_their_own_scales_are_brought_to_that_of_the_front_view(tmp_path):
    path = tmp_path / "part.dxf"
    sheet({"front": (0, 0), "top": (0, 50), "side": (100, 0)}, scale={"top": 2.0, "side": 0.5}).saveas(path)
    read = read_views(path)
    assert [rows(view) for _, view in read.drawing] == [expected(name) for name in VIEWS]
    assert any("scale" in note for note in read.notes)


@pytest.mark.parametrize("seed", range(3))
def test_views_whose_every_coordinate_is_off_are_parted_and_aligned_all_the_same(seed, tmp_path):
    document = sheet(PLACES["third angle, side view from the right"])
    rng = np.random.default_rng(seed)
    for line in document.modelspace():
        line.dxf.start += tuple(rng.uniform(-0.01, 0.01, 2))
        line.dxf.end += tuple(rng.uniform(-0.01, 0.01, 2))
    path = tmp_path / "part.dxf"
    document.saveas(path)
    read = read_views(path)
    assert read.notes == ("third angle, side view from the right",)
    for (_, view), name in zip(read.drawing, VIEWS):
        given = np.array([*VIEWS[name], *DASHED[name]], dtype=float).reshape(-1, 2, 2)
        np.testing.assert_allclose(view.segments, given, atol=0.03)


def test_what_is_no_edge_is_set_aside_and_counted(tmp_path):
    document = sheet(PLACES["third angle, side view from the right"])
    space = document.modelspace()
    space.add_line((20, -5), (20, 35), dxfattribs={"linetype": "CENTER"})
    space.add_text("PART", dxfattribs={"insert": (70, 60)})
    space.add_linear_dim(base=(0, -10), p1=(0, 0), p2=(40, 0)).render()
    space.add_lwpolyline([(-90, -90), (190, -90), (190, 190), (-90, 190)], close=True)
    block = document.blocks.new("SYMBOL")
    block.add_text("A")
    space.add_blockref("SYMBOL", (90, 90))
    path = tmp_path / "part.dxf"
    document.saveas(path)
    read = read_views(path)
    assert [rows(view) for _, view in read.drawing] == [expected(name) for name in VIEWS]
    told = " ".join(read.notes)
    assert all(word in told for word in ("1 centre lines", "1 dimensions", "2 texts", "frame of 4 lines"))


def test_polylines_and_blocks_are_resolved(tmp_path):
    document = ezdxf.new("R2010", setup=True)
    document.units = ezdxf.units.MM
    space = document.modelspace()
    for name, (x, y) in PLACES["third angle, side view from the right"].items():
        block = document.blocks.new(name.upper())
        for a, b, c, d in VIEWS[name]:
            block.add_lwpolyline([(a, b), (c, d)])
        for a, b, c, d in DASHED[name]:
            block.add_line((a, b), (c, d), dxfattribs={"linetype": "HIDDEN"})
        space.add_blockref(name.upper(), (x, y))
    path = tmp_path / "part.dxf"
    document.saveas(path)
    assert [rows(view) for _, view in read_views(path).drawing] == [expected(name) for name in VIEWS]


def test_arcs_are_refused_with_their_places(tmp_path):
    document = sheet(PLACES["third angle, side view from the right"])
    document.modelspace().add_circle((20, 5), 3)
    document.modelspace().add_lwpolyline([(0, 0, 0), (10, 0, 1.0), (20, 0, 0)], format="xyb")
    path = tmp_path / "part.dxf"
    document.saveas(path)
    with pytest.raises(CurvedDrawing) as refusal:
        read_views(path)
    assert len(refusal.value.curves) == 2
    assert "circle at (20, 5) of radius 3" in str(refusal.value)


def test_sheets_that_hold_no_three_views_say_so(tmp_path):
    path = tmp_path / "part.dxf"
    sheet({"front": (0, 0), "top": (0, 50)}).saveas(path)
    with pytest.raises(UnreadableFile, match="do not fall into"):
        read_views(path)
    document = sheet(PLACES["third angle, side view from the right"])
    document.modelspace().add_line((40, 10), (60, 10))  # front and side view are one figure
    document.saveas(path)
    with pytest.raises(UnreadableFile):
        read_views(path)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", UnreadableFile),
        ("[1, 2]", UnreadableFile),
        ('{"views": {"front": {"visible": []}}}', UnreadableFile),
        ('{"views": {"front": {"visible": [[0, 0, 1]]}}}', BadGeometry),
        ('{"views": {"front": {"visible": [[0, 0, 1, NaN]]}}}', BadGeometry),
        ('{"views": {"front": {"visible": 7}}}', UnreadableFile),
    ],
)
def test_damaged_json_gets_one_sentence(text, error, tmp_path):
    path = tmp_path / "part.json"
    path.write_text(text)
    with pytest.raises(error):
        read_views(path)


def test_json_and_dxf_of_one_drawing_say_the_same(tmp_path):
    views = {name: {"visible": VIEWS[name], "hidden": DASHED[name]} for name in VIEWS}
    (tmp_path / "part.json").write_text(json.dumps({"views": views}))
    sheet(PLACES["third angle, side view from the right"]).saveas(tmp_path / "part.dxf")
    one, other = (read_views(tmp_path / name).drawing for name in ("part.json", "part.dxf"))
    assert [rows(view) for _, view in one] == [rows(view) for _, view in other]


def test_other_endings_and_damaged_dxf_are_refused(tmp_path):
    with pytest.raises(UnsupportedFormat):
        read_views("part.pdf")
    path = tmp_path / "part.dxf"
    for content in (b"", b"0\nSECTION\n2\nENTITIES\n0\nLINE\n10\nxyz", b"\x00\xff" * 500):
        path.write_bytes(content)
        with pytest.raises(UnreadableFile):
            read_views(path)


def svg(places, hidden='stroke-dasharray="3 1.5"', extra=""):
    """The views as SVG, whose y runs downward."""
    rows = []
    for name, (x, y) in places.items():
        for segments, how in ((VIEWS[name], ""), (DASHED[name], hidden)):
            for a, b, c, d in segments:
                rows.append(f'<line x1="{a + x}" y1="{-b - y}" x2="{c + x}" y2="{-d - y}" {how}/>')
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" width="200mm" height="200mm" viewBox="-100 -100 200 200">'
        f'<g stroke="black" fill="none">{"".join(rows)}{extra}</g></svg>'
    )


@pytest.mark.parametrize("layout", [name for name in PLACES if "right" in name])
def test_svg_and_dxf_of_one_drawing_say_the_same(layout, tmp_path):
    path = tmp_path / "part.svg"
    path.write_text(svg(PLACES[layout]))
    read = read_views(path)
    assert layout in read.notes
    assert [rows(view) for _, view in read.drawing] == [expected(name) for name in VIEWS]


@pytest.mark.parametrize(
    "rule", [".dashed, .x { stroke-dasharray: 3 1.5 }", "/* } */ line.y {} #d, .dashed{stroke-dasharray:3}"]
)
def test_style_sheets_of_an_svg_tell_dashed_lines(rule, tmp_path):
    path = tmp_path / "part.svg"
    drawn = svg(PLACES["third angle, side view from the right"], 'class="thin dashed"')
    path.write_text(drawn.replace("<g ", f"<style>{rule}</style><g ", 1))
    assert [rows(view) for _, view in read_views(path).drawing] == [expected(name) for name in VIEWS]


def test_an_svg_path_says_the_same_as_lines_under_a_transform(tmp_path):
    path = tmp_path / "part.svg"
    drawn = svg(PLACES["third angle, side view from the right"])
    first = '<line x1="0" y1="0" x2="40" y2="0" />'
    assert first in drawn
    path.write_text(drawn.replace(first, '<path transform="translate(-5,0) scale(2)" d="m2.5,0 h20"/>'))
    assert rows(read_views(path).drawing.front) == expected("front")


def test_what_is_no_edge_of_an_svg_is_set_aside_and_curves_are_refused(tmp_path):
    path = tmp_path / "part.svg"
    centre = '<line x1="20" y1="5" x2="20" y2="-35" style="stroke-dasharray: 8 2 1 2"/><text x="0" y="9">PART</text>'
    path.write_text(svg(PLACES["third angle, side view from the right"], extra=centre))
    read = read_views(path)
    assert [rows(view) for _, view in read.drawing] == [expected(name) for name in VIEWS]
    assert any("1 centre lines" in note and "1 texts" in note for note in read.notes)
    curved = '<circle cx="20" cy="-5" r="3"/><path d="M0,0 A5 5 0 0 1 10,-5"/>'
    path.write_text(svg(PLACES["third angle, side view from the right"], extra=curved))
    with pytest.raises(CurvedDrawing) as refusal:
        read_views(path)
    assert refusal.value.curves == ("circle at (20, -5)", "arc at (10, -5)")


@pytest.mark.parametrize("text", ["", "<svg", "<html/>", "<!DOCTYPE x [<!ENTITY a 'b'>]><svg>&a;</svg>"])
def test_damaged_svg_gets_one_sentence(text, tmp_path):
    path = tmp_path / "part.svg"
    path.write_text(text)
    with pytest.raises(UnreadableFile):
        read_views(path)


def test_a_title_block_beside_the_views_is_set_aside(tmp_path):
    document = sheet(PLACES["third angle, side view from the right"])
    for a, b, c, d in [
        (30, -40, 90, -40),
        (90, -40, 90, -20),
        (90, -20, 30, -20),
        (30, -20, 30, -40),
        (30, -30, 90, -30),
    ]:
        document.modelspace().add_line((a, b), (c, d))
    path = tmp_path / "part.dxf"
    document.saveas(path)
    read = read_views(path)
    assert [rows(view) for _, view in read.drawing] == [expected(name) for name in VIEWS]
    assert "set aside 5 lines beside the views" in read.notes


def same_as_drawn(document, path):
    document.saveas(path)
    read = read_views(path)
    assert [rows(view) for _, view in read.drawing] == [expected(name) for name in VIEWS]
    return read.notes


def test_what_is_not_shown_is_set_aside(tmp_path):
    document = sheet(PLACES["third angle, side view from the right"])
    space = document.modelspace()
    document.layers.add("AUX").off()
    document.layers.add("OLD").freeze()
    block = document.blocks.new("GRID")
    block.add_line((0, 0), (90, 90))
    block.add_circle((5, 5), 3)
    space.add_line((-5, -5), (90, 60), dxfattribs={"layer": "AUX"})
    space.add_blockref("GRID", (0, 0), dxfattribs={"layer": "OLD"})
    space.add_line((0, 0), (90, 3), dxfattribs={"invisible": 1})
    assert any("3 entities that are not shown" in note for note in same_as_drawn(document, tmp_path / "part.dxf"))


def test_views_on_a_sheet_of_paper_are_read_where_the_model_space_is_empty(tmp_path):
    document = sheet(PLACES["third angle, side view from the right"])
    for line in list(document.modelspace()):
        document.modelspace().move_to_layout(line, document.paperspace())
    same_as_drawn(document, tmp_path / "part.dxf")


def test_a_block_inserted_in_rows_stands_in_every_place(tmp_path):
    document = sheet(PLACES["third angle, side view from the right"])
    space = document.modelspace()
    # both dashed lines that stand upright in the front view's column, 5 and 10 long, are put in by one row of pieces
    for line in [line for line in space if line.dxf.layer == "HIDDEN" and line.dxf.start.x == line.dxf.end.x]:
        start, end = sorted([line.dxf.start, line.dxf.end])
        space.delete_entity(line)
        block = document.blocks.new(f"DASH{len(document.blocks)}")
        block.add_line((0, 0), (0, (end - start).y / 2), dxfattribs={"linetype": "ACAD_ISO07W100"})
        many = {"row_count": 2, "row_spacing": (end - start).y / 2}
        space.add_blockref(block.name, (start.x, start.y), dxfattribs=many)
    document.saveas(tmp_path / "part.dxf")
    read = read_views(tmp_path / "part.dxf")
    assert [int(view.hidden.sum()) for _, view in read.drawing] == [2, 2, 1]
    lengths = [np.linalg.norm(np.diff(view.segments[view.hidden], axis=1), axis=2).sum() for _, view in read.drawing]
    np.testing.assert_allclose(lengths, [30, 10, 10])


def test_a_pictorial_view_and_labels_made_of_lines_are_set_aside(tmp_path):
    document = sheet(PLACES["third angle, side view from the right"])
    space = document.modelspace()
    for a, b, c, d in [(60, 45, 80, 35), (80, 35, 95, 42), (95, 42, 95, 60), (80, 35, 80, 55), (60, 45, 60, 66)]:
        space.add_line((a, b), (c, d))
    for x, y in [(-6, 2), (-6, 52), (88, 2)]:
        space.add_line((x, y), (x + 2, y + 4))
        space.add_line((x + 3, y), (x + 2.2, y + 3))
    assert "set aside 11 lines beside the views" in same_as_drawn(document, tmp_path / "part.dxf")
