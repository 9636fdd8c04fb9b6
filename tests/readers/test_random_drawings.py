"""Three-view drawings by chance, as DXF and as SVG in many forms, come back line by line."""

import ezdxf
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from recon.errors import CurvedDrawing
from recon.readers.views import read_views

few = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
NAMES = ("front", "top", "side")
# where each view stands, as (right, up), and whether the side view looks from the left
LAYOUTS = [
    ((0, 0), (0, 1), (1, 0), False),
    ((1, 1), (1, 0), (0, 1), False),
    ((0, 1), (0, 0), (1, 1), True),
    ((1, 0), (1, 1), (0, 0), True),
]


@st.composite
def drawings(draw):
    """Views as rows u0 v0 u1 v1 of whole numbers within their outline, which of them are dashed, and their layout."""
    width, depth, height = (draw(st.integers(3, 40)) for _ in range(3))
    views = []
    for w, h in ((width, height), (width, depth), (depth, height)):
        place = st.tuples(st.integers(0, w), st.integers(0, h))
        inner = draw(st.lists(st.tuples(place, place).filter(lambda ends: ends[0] != ends[1]), max_size=5))
        outline = [(0, 0, w, 0), (w, 0, w, h), (w, h, 0, h), (0, h, 0, 0)]
        rows = np.array([*outline, *((*a, *b) for a, b in inner)], dtype=float)
        hidden = [False] * 4 + [draw(st.booleans()) for _ in inner]
        views.append((rows, np.array(hidden)))
    layout = draw(st.sampled_from(LAYOUTS))
    ratios = draw(st.sampled_from([(1, 1), (2, 1), (1, 0.5), (2.5, 2.5)]))
    gap = draw(st.integers(2, 30))
    return views, layout, (1.0, *ratios), gap


def on_sheet(drawing):
    """Rows and dashes of each view where it stands on the sheet, at its scale."""
    views, (*places, _), scales, gap = drawing
    sizes = [scale * rows[:4].max(axis=0)[:2] for (rows, _), scale in zip(views, scales)]
    # a quarter is as wide as the widest view of its column, and a view fills its own from the lower left
    reach = [max(size[axis] for size, at in zip(sizes, places) if at[axis] == 0) + gap for axis in (0, 1)]
    shifts = [np.array([at[axis] * reach[axis] for axis in (0, 1)] * 2) for at in places]
    return [(rows * scale + shift, hidden) for (rows, hidden), scale, shift in zip(views, scales, shifts)]


def told(rows, hidden):
    """Lines without a sense, in an order of their own."""
    ends = [sorted([(a, b), (c, d)]) for a, b, c, d in (np.round(rows, 6) + 0.0).tolist()]
    return sorted((*a, *b, bool(dashed)) for (a, b), dashed in zip(ends, hidden))


def assert_read(path, drawing, unit):
    views, (*_, from_left), _, _ = drawing
    found = read_views(path)
    assert found.mirrored == from_left
    for (_, view), (rows, hidden) in zip(found.drawing, views):
        width = rows[:4, 0].max()
        expected = rows * [-1, 1, -1, 1] + [width, 0, width, 0] if from_left else rows
        assert told(view.segments.reshape(-1, 4) / unit, view.hidden) == told(expected, hidden)


DASHED = [{"linetype": "HIDDEN"}, {"linetype": "DASHED2"}, {"layer": "VERDECKT"}, {"layer": "INSIDE"}]
DXF_UNITS = {1: 25.4, 4: 1.0, 5: 10.0, 6: 1000.0}


@few
@given(
    drawing=drawings(), dashed=st.sampled_from(DASHED), unit=st.sampled_from(list(DXF_UNITS)), in_rows=st.booleans(),
    in_blocks=st.booleans(), turn=st.sampled_from([0, 90, 180, 270]), size=st.sampled_from([1.0, 2.0, 0.25]),
)  # fmt: skip
def test_a_drawing_comes_back_from_dxf(tmp_path, drawing, dashed, unit, in_rows, in_blocks, turn, size):
    document = ezdxf.new("R2010", setup=True)
    document.header["$INSUNITS"] = unit
    document.layers.add("INSIDE", linetype="DASHED")
    for name, (rows, hidden) in zip(NAMES, on_sheet(drawing)):
        space = document.modelspace()
        if in_blocks:
            space.add_blockref(name, rows[0, :2], {"rotation": turn, "xscale": size, "yscale": size})
            space, back = document.blocks.new(name), np.radians(-turn)
            matrix = np.array([[np.cos(back), -np.sin(back)], [np.sin(back), np.cos(back)]]) / size
            rows = ((rows.reshape(-1, 2, 2) - rows[0, :2]) @ matrix.T).reshape(-1, 4)
        ends = rows.reshape(-1, 2, 2)
        for (a, b), attributes in zip(ends[4 * in_rows :], [dashed if h else {} for h in hidden[4 * in_rows :]]):
            space.add_line(a, b, dxfattribs=attributes)
        if in_rows:
            space.add_lwpolyline(ends[:4, 0], close=True)
    document.saveas(tmp_path / "part.dxf")
    assert_read(tmp_path / "part.dxf", drawing, DXF_UNITS[unit])


def path_of(rows, form):
    """Path data of lines, each from its beginning."""
    made, at = "", (0.0, 0.0)
    for a, b, c, d in rows:
        if form == "absolute":
            made += f"M{a!r},{b!r}L{c!r},{d!r}"
        elif form == "one after the other":
            made += f"M {a!r} {b!r} {c!r} {d!r}"
        elif form == "along an axis" and b == d:
            made += f"M{a!r} {b!r}H{c!r}"
        elif form == "along an axis" and a == c:
            made += f"M{a!r} {b!r}v{d - b!r}"
        else:
            made += f"m{a - at[0]!r},{b - at[1]!r}l{c - a!r},{d - b!r}"
        at = c, d
    return made


FORMS = ("absolute", "one after the other", "along an axis", "relative")
HIDDEN = ['stroke-dasharray="3 1.5"', 'style="stroke-dasharray:2,1"', 'class="inside"', 'stroke-dasharray="4"']
STYLE = "<style>.inside { stroke-dasharray: 5 2; }</style>"
SVG_UNITS = {"mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72, "px": 25.4 / 96, "": None}
TRANSFORMS = {  # what is told, and what is done: first the last of a list
    "": np.eye(3),
    "translate(7,-3) scale(2)": np.array([[2, 0, 7], [0, 2, -3], [0, 0, 1]]),
    "rotate(90)": np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "rotate(180 10 20)": np.array([[-1, 0, 20], [0, -1, 40], [0, 0, 1]]),
    "matrix(0 2 2 0 1 5) skewX(45)": np.array([[0, 2, 1], [2, 2, 5], [0, 0, 1]]),
}


def svg_view(rows, hidden, form, dashed):
    """Elements of a view, its outline in a form of its own; rows as the file counts them, y downward."""
    corners = [tuple(row[:2]) for row in rows[:4]]
    (x0, y0), (x1, y1) = np.min(corners, axis=0).tolist(), np.max(corners, axis=0).tolist()
    points = " ".join(f"{x!r},{y!r}" for x, y in corners)
    outline = {
        "rect": f'<rect x="{x0!r}" y="{y0!r}" width="{x1 - x0!r}" height="{y1 - y0!r}"/>',
        "polygon": f'<polygon points="{points}"/>',
        "closed path": f'<path d="M {points} z"/>',
    }.get(form) or f'<path d="{path_of(rows[:4], form)}"/>'
    inner = (
        f'<line x1="{a!r}" y1="{b!r}" x2="{c!r}" y2="{d!r}" {dashed * bool(is_hidden)}/>'
        for (a, b, c, d), is_hidden in zip(rows[4:], hidden[4:])
    )
    return outline + "".join(inner)


@few
@given(
    drawing=drawings(), form=st.sampled_from([*FORMS, "rect", "polygon", "closed path"]),
    dashed=st.sampled_from(HIDDEN), unit=st.sampled_from(list(SVG_UNITS)),
    transform=st.sampled_from(list(TRANSFORMS)), used=st.booleans(),
)  # fmt: skip
def test_a_drawing_comes_back_from_svg(tmp_path, drawing, form, dashed, unit, transform, used):
    if form == "rect" and "skew" in transform:
        form = "polygon"
    back, parts = np.linalg.inv(TRANSFORMS[transform]), []
    for rows, hidden in on_sheet(drawing):
        ends = rows.reshape(-1, 2) * [1, -1]
        before = (ends @ back[:2, :2].T + back[:2, 2]).reshape(-1, 4).tolist()
        parts.append(svg_view(before, hidden, form, dashed))
    content = "".join(parts)
    if used:
        named = "".join(f'<g id="{name}">{part}</g>' for name, part in zip(NAMES, parts))
        content = f"<defs>{named}</defs>" + "".join(f'<use href="#{name}"/>' for name in NAMES)
    size = f'width="300{unit}" height="300{unit}"' if unit else ""
    (tmp_path / "part.svg").write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="-50 -100 150 150">{STYLE}'
        f'<g transform="{transform}"><g stroke="#000" fill="none">{content}</g></g></svg>'
    )
    assert_read(tmp_path / "part.svg", drawing, 2.0 * SVG_UNITS[unit] if unit else 1.0)


@pytest.mark.parametrize(
    ("data", "at"),
    [
        ("M0,0 a5 5 0 01 10,-5", "arc at (10, -5)"),
        ("M0,0 A5,5 0 1110-5", "arc at (10, -5)"),
        ("M1,2 q3", "curve at (1, 2)"),
    ],
)
def test_a_curve_whose_numbers_stand_close_together_or_break_off_is_no_edge_left_out(data, at, tmp_path):
    rows = "".join(f'<rect x="{x}" y="{y}" width="9" height="9"/>' for x, y in ((0, 0), (20, 0), (0, -20)))
    content = f'<g stroke="black">{rows}<path d="{data}"/></g>'
    (tmp_path / "part.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg">{content}</svg>')
    with pytest.raises(CurvedDrawing) as refusal:
        read_views(tmp_path / "part.svg")
    assert refusal.value.curves == (at,)
