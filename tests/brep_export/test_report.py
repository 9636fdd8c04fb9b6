"""The page of a result says the verdict, names what is broken, fetches nothing, and appears whole or not at all."""

import re

import pytest

from brep_export.app.report import report_page, write_report
from brep_export.app.result import refusal, result
from brep_export.check import check
from recon.errors import NotWritten
from recon.tolerance import Tolerance

box = pytest.importorskip("cadquery").Workplane().box(1, 2, 3).val()
TOLERANCE = Tolerance()


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
    page = report_page(answer(box), None)
    assert "passes the gate" in page
    assert re.search(r"Closed\?</dt><dd>yes", page) and re.search(r"Printable\?</dt><dd>yes", page)
    assert page.count('<tr class="passed">') == 6 and page.count('<tr class="not">') == 1  # no file was read back


def test_a_broken_shape_names_its_line_of_the_gate():
    page = report_page(answer(box.Shells()[0]), None)
    assert '<p class="verdict refused">' in page and "no-solid" in page
    assert '<tr class="broken"><td>1</td>' in page


def test_what_users_named_is_text_and_nothing_is_fetched():
    page = report_page(answer(box, room={"nested": {"deep": [1.0, 2.5]}, "rows": [{"a": 1}, {"a": 2}]}), b"PNG")
    assert "part &lt;1&gt;.step" in page and "part <1>" not in page
    assert "nested. deep" in page and "rows 1. a" in page
    assert not re.search(r'(src|href)="(?!data:)', page)


def test_a_run_that_measured_nothing_still_has_a_page():
    assert "there is no such file" in report_page(refusal("patch", ["a.ply"], ["there is no such file"]), None)


def test_a_page_that_cannot_be_written_leaves_nothing(tmp_path):
    with pytest.raises(NotWritten):
        write_report(tmp_path / "missing" / "page.html", answer(box), None)
    write_report(tmp_path / "page.html", answer(box), None)
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]
