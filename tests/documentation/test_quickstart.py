"""Every block of the quick start runs as it stands, in a folder of generated inputs, and writes the files it names."""

import contextlib
import io
import re
import sys
from pathlib import Path

import pytest
from pages import DOCS, blocks

from recon.hole_patch.sample_vessel import VesselOptions

CADQUERY = blocks(DOCS / "for-cad-users.md", "python")
BLOCKS = blocks(DOCS / "quickstart.md", "python")
TITLES = re.findall(r"^## (\w+)", (DOCS / "quickstart.md").read_text(encoding="utf-8"), flags=re.MULTILINE)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    with contextlib.ExitStack() as stack:
        monkeypatch = stack.enter_context(pytest.MonkeyPatch.context())
        monkeypatch.syspath_prepend(str(DOCS))
        from make_inputs import write_inputs

        folder = tmp_path_factory.mktemp("inputs")
        write_inputs(folder, VesselOptions(edge=2.0))
        sys.modules.pop("make_inputs", None)
        yield folder


def test_every_method_has_its_block():
    assert TITLES == ["Patch", "Fit", "Curve", "Terrain", "Voxels", "Views"] and len(BLOCKS) == len(TITLES)


@pytest.mark.parametrize("block", BLOCKS, ids=TITLES)
def test_a_block_has_ten_lines_at_most_and_runs(block, inputs, monkeypatch):
    assert len([line for line in block.splitlines() if line.strip()]) <= 10
    monkeypatch.chdir(inputs)
    before = set(Path.cwd().iterdir())
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile(block, "quickstart", "exec"), {})
    made = set(Path.cwd().iterdir()) - before
    assert made and all(path.stat().st_size > 0 for path in made)
    assert {path.suffix for path in made} <= {".step", ".stl"}


def test_the_block_for_cadquery_makes_one_solid(inputs, monkeypatch):
    (block,) = CADQUERY
    monkeypatch.chdir(inputs)
    names: dict[str, object] = {}
    exec(compile(block, "for-cad-users", "exec"), names)
    bracket, part = names["bracket"], names["part"].val()
    assert len(part.Solids()) == 1 and part.isValid() and 0 < part.Volume() < bracket.Volume()
