"""A STEP file written before the gate has spoken, and read by a second process: put in place once, or gone."""

import numpy as np
import pytest
from kernel_shapes import box

from brep_export import advance_copy as module
from brep_export.advance_copy import advance_copy
from brep_export.blocks import block_solid
from brep_export.check import check
from brep_export.file_header import FileHeader, LengthUnit
from brep_export.kernel_settings import kernel_threads
from brep_export.outputs import Consignment, write_together
from brep_export.read_back import read_cad
from brep_export.step import StepSchema
from recon.errors import NotWritten
from recon.geometry.bspline import BSplineSurface
from recon.geometry.patches import connect
from recon.tolerance import Tolerance

TOLERANCE = Tolerance(merge=1e-6, fit=1e-3)
KNOTS = np.repeat([0.0, 1.0], 2)
HEADER = FileHeader(name="ground", unit=LengthUnit.METRE)


@pytest.fixture(autouse=True)
def _two_threads(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    monkeypatch.setattr(module, "FEWEST_FACES", 64)


@pytest.fixture(scope="module")
def block():
    cells = [(i, j) for i in range(9) for j in range(8)]
    nets = [[[[x + i, y + j, 0.1 * (x + i) * (y + j)] for j in (0, 1)] for i in (0, 1)] for x, y in cells]
    surfaces = [BSplineSurface(1, 1, KNOTS, KNOTS, np.array(net, dtype=float)) for net in nets]
    return block_solid(connect(surfaces, 1e-9), -1.0, TOLERANCE)


def delivered(shape, copy, path, header=HEADER):
    report = check(shape, TOLERANCE, copy=copy)
    sent = Consignment(shape, report.triangulation, [path], header, measures=report.measures, copy=report.copy)
    return write_together([sent])[0][0], report


def test_what_was_read_beside_the_gate_is_compared_and_put_in_place(block, tmp_path):
    path, told = tmp_path / "ground.step", []
    with advance_copy(block, path, HEADER, announce=told.append) as copy:
        assert copy is not None and copy.path == told[0] and copy.path.exists() and not path.exists()
        back, report = delivered(block, copy, path)
    assert report.passed and back.same and back.volume_change == pytest.approx(0.0, abs=1e-12)
    assert [entry.name for entry in tmp_path.iterdir()] == ["ground.step"]
    assert read_cad(path, unit="M").ShapeType() == block.ShapeType()
    assert copy.reader.returncode == 0


def test_the_gate_says_the_same_with_and_without(block, tmp_path):
    with advance_copy(block, tmp_path / "ground.step", HEADER) as copy:
        beside = check(block, TOLERANCE, copy=copy)
    alone = check(block, TOLERANCE)
    assert beside.as_json() == alone.as_json()


def test_a_copy_that_nobody_takes_is_gone_and_so_is_its_reader(block, tmp_path):
    with advance_copy(block, tmp_path / "ground.step", HEADER) as copy:
        assert copy is not None and copy.reader.poll() is None
    assert copy.reader.returncode is not None and not list(tmp_path.iterdir())


def test_a_reader_that_breaks_off_is_stood_in_for(block, tmp_path):
    path = tmp_path / "ground.step"
    with advance_copy(block, path, HEADER) as copy:
        copy.reader.kill()
        back, _ = delivered(block, copy, path)
    assert back.same and path.exists()


def test_a_copy_that_is_cut_short_is_not_put_in_place(block, tmp_path):
    """What is compared is what stands in the file, not what was meant to."""
    path = tmp_path / "ground.step"
    path.write_text("what stood here before")
    with advance_copy(block, path, HEADER) as copy:
        copy.reader.kill()
        text = copy.path.read_text()
        copy.path.write_text(text[: len(text) // 2])
        with pytest.raises(NotWritten, match=r"ground\.step.*cut short"):
            delivered(block, copy, path)
    assert path.read_text() == "what stood here before" and len(list(tmp_path.iterdir())) == 1


def test_few_faces_are_not_worth_it(tmp_path):
    with advance_copy(box(), tmp_path / "box.step", HEADER) as copy:
        assert copy is None


def test_another_header_or_schema_is_written_anew(block, tmp_path):
    path = tmp_path / "ground.step"
    with advance_copy(block, path, HEADER) as copy:
        delivered(block, copy, path, FileHeader(name="other", unit=LengthUnit.METRE))
        assert "PRODUCT('other'" in path.read_text() and copy.path.exists()
        sent = Consignment(block, None, [path], HEADER, copy=copy)
        assert write_together([sent], schema=StepSchema.AP242)[0][0].same
        assert copy.path.exists()


@pytest.mark.parametrize("told", ["1", "1,2"])
def test_one_thread_means_one_process(block, tmp_path, monkeypatch, told):
    monkeypatch.setenv("OMP_NUM_THREADS", told)
    with advance_copy(block, tmp_path / "ground.step", HEADER) as copy:
        assert copy is None


def test_threads_are_those_told_or_the_processors(monkeypatch):
    assert kernel_threads() == 2
    for told in ("", "many"):
        monkeypatch.setenv("OMP_NUM_THREADS", told)
        assert kernel_threads() >= 1
    monkeypatch.setenv("OMP_NUM_THREADS", "0")
    assert kernel_threads() == 1
