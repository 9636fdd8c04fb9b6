"""The page of a result says the verdict, names what is broken, fetches nothing, and appears whole or not at all."""

import re

import pytest

from brep_export.app.report import Exhibits, report_page, write_report
from brep_export.app.result import refusal, result
from brep_export.check import check
from recon.errors import NotWritten
from recon.tolerance import Tolerance

box = pytest.importorskip("cadquery").Workplane().box(1, 2, 3).val()
TOLERANCE = Tolerance()
SHOWN = Exhibits(pictures=[b"PNG"], scene='{"parts":[{"name":"sherd <script>"}]}')


def answer(shape, *, room=None):
    report = check(shape.wrapped, TOLERANCE)
    return result(
        "check",
        inputs=["part <1>.step"],
        outputs=[],
        reasons=[str(defect) for defect in report.defects],
        kernel=report.as_json(),
        seconds={},
        room=room,
    )


def test_a_closed_solid_passes_and_can_be_printed():
    page = report_page(answer(box))
    assert "passes the gate" in page
    assert "Is it closed?</dt><dd>yes: 1 closed solid, 6 faces" in page
    assert "Can I print it?</dt><dd>yes: 1 × 2 × 3 mm" in page
    assert page.count('<tr class="passed">') == 6 and page.count('<tr class="not">') == 1  # no file was read back


def test_a_broken_shape_names_its_line_of_the_gate():
    page = report_page(answer(box.Shells()[0]))
    assert '<p class="verdict refused">' in page and "no-solid" in page
    assert '<tr class="broken"><td>1</td>' in page


def test_what_users_named_is_text_and_nothing_is_fetched():
    page = report_page(answer(box, room={"nested": {"deep": [1.0, 2.5]}, "rows": [{"a": 1}, {"a": 2}]}), SHOWN)
    assert "part &lt;1&gt;.step" in page and "part <1>" not in page
    assert "nested. deep" in page and "rows 1. a" in page
    assert page.count("<script") == 3 and "sherd \\u003cscript>" in page
    assert not re.search(r'(src|href)="(?!data:)', page)
    assert "default-src 'none'" in page


def test_a_run_that_measured_nothing_still_has_a_page():
    assert "there is no such file" in report_page(refusal("patch", ["a.ply"], ["there is no such file"]))


def test_a_page_that_cannot_be_written_leaves_nothing(tmp_path):
    with pytest.raises(NotWritten):
        write_report(tmp_path / "missing" / "page.html", answer(box), Exhibits())
    write_report(tmp_path / "page.html", answer(box), Exhibits())
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


def test_figures_have_units():
    room = {
        "g1_max_deg": 0.25,
        "gap": {"min": 0.5, "unit": "mm"},
        "shift_mm": 2.0,
        "edge": {"rejected": 0.25, "unit": "mm, share"},
    }
    page = report_page(answer(box, room=room), Exhibits(unit="m"))
    rows = dict(re.findall(r"<tr><td>([^<]*)</td><td>([^<]*)</td></tr>", page))
    assert rows["volume"] == "6 m³" and rows["area"] == "22 m²" and rows["g1 max"] == "0.25 °"
    assert rows["gap. min"] == "0.5 mm" and rows["shift"] == "2 mm" and rows["edge. unit"] == "mm, share"


def test_an_open_shape_says_what_is_missing():
    page = report_page(answer(box.Shells()[0].Faces()[0]))
    assert "Is it closed?</dt><dd>no: 4 free edges" in page and "Can I print it?</dt><dd>no" in page


def test_where_no_shape_was_made_no_gate_is_said_to_be_passed():
    listed = result("patch", inputs=[], outputs=[], reasons=[], kernel={}, seconds={}, room={"holes": 2})
    page = report_page(listed)
    assert "passes the gate" not in page and "no shape was made" in page
