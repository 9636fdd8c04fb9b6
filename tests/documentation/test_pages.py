"""What the pages say of files, formats, the gate, papers and names is so; and the site builds without a warning."""

import importlib.util
import json
import re
import subprocess
import sys

import pytest
from pages import DOCS, PAGES, ROOT, code_words, name

from brep_export.check import LINES

FILES = re.compile(
    r"(?:\.ci|benchmarks|brep_export|docs|examples|notebooks|recon|tests)/[\w./*-]*|[\w-]+\.(?:md|toml|txt)"
)
LARGEST_PICTURE = 150_000
DEFECTS = re.compile(r'Defect\(\s*f?"([a-z-]+)')


def hook(module):
    spec = importlib.util.spec_from_file_location(module, DOCS / "hooks" / f"{module}.py")
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def slugs(page):
    """Anchors of a page's headings."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w]+", "-", re.sub(r"[`*]", "", heading).lower()).strip("-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        path, _, anchor = target.partition("#")
        linked = page.parent / path if path else page
        assert linked.exists(), target
        assert not anchor or anchor in slugs(linked), target


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_files_that_a_page_names_exist(page):
    named = [word for word in code_words(page) if FILES.fullmatch(word)]
    assert [word for word in named if not list(ROOT.glob(word.rstrip("/"))) and "<" not in word] == []


def test_the_page_of_formats_is_what_the_program_prints():
    ask = [sys.executable, "-c", "from brep_export.app.cli import main; main()", "formats", "--json"]
    table = json.loads(subprocess.run(ask, capture_output=True, text=True, check=True).stdout)
    rows = re.findall(r"^\| `(\w+)` \| (.*) \| (.*) \|$", (DOCS / "formats.md").read_text("utf-8"), flags=re.MULTILINE)
    told = {command: {"reads": reads, "writes": writes} for command, reads, writes in rows}
    shown = {
        c: {way: [f"`{ending}`" for ending in endings] for way, endings in row.items()} for c, row in table.items()
    }
    assert {c: {way: cell.split() for way, cell in row.items()} for c, row in told.items()} == shown


def test_the_page_of_the_gate_has_its_lines_in_order():
    rows = re.findall(r"^\| (\d) \| (.*?) \| (.*) \|$", (DOCS / "gate.md").read_text("utf-8"), flags=re.MULTILINE)
    assert [(int(number), said) for number, said, _ in rows] == [(i, said) for i, (said, _) in enumerate(LINES, 1)]
    for (_, _, codes), (_, beginnings) in zip(rows, LINES):
        named = re.findall(r"`([^`]+)`", codes)
        assert [b for b in beginnings if not any(code.startswith(b) for code in named)] == []


def test_the_page_of_the_gate_names_every_defect():
    sources = [
        ROOT / "brep_export" / f"{stem}.py" for stem in ("check", "check_geometry", "check_topology", "read_back")
    ]
    codes = {code for source in sources for code in DEFECTS.findall(source.read_text("utf-8"))} - {"read-back-"}
    page = (DOCS / "gate.md").read_text("utf-8")
    assert len(codes) > 15 and [code for code in codes if f"`{code}`" not in page] == []


def test_the_bibliography_has_every_entry():
    bibliography = hook("bibliography")
    source = bibliography.BIBLIOGRAPHY.read_text("utf-8")
    page = bibliography.entries_as_markdown(source)
    keys = re.findall(r"^@\w+\{(\w+),", source, flags=re.MULTILINE)
    assert len(keys) > 30
    assert [key for key in keys if f'<a id="{key}"></a>' not in page] == []
    assert page.count("</a>") == len(keys) and not set("{}\\") & set(page)
    assert "Bathe, Klaus-Jürgen" in page and "Sharpen&Bend: Recovering Curved Sharp Edges" in page


def test_keys_of_papers_in_prose_become_links():
    with_links = hook("bibliography").with_links
    assert (
        with_links("as in [taubin1995], [nobody1999]", "b.md") == "as in [[taubin1995]](b.md#taubin1995), [nobody1999]"
    )


def test_pictures_are_small_and_used():
    pictures = sorted((DOCS / "pictures").glob("*.png"))
    shown = "".join(page.read_text("utf-8") for page in PAGES)
    assert {"patch", "fit", "curve", "terrain", "voxels", "views", "report"} <= {path.stem for path in pictures}
    assert [path.name for path in pictures if path.stat().st_size > LARGEST_PICTURE] == []
    assert [path.name for path in pictures if f"pictures/{path.name}" not in shown] == []


def test_docstrings_in_columns_become_lists():
    pytest.importorskip("griffe", reason="the packages of the extra `docs` are not installed")
    written = "A sentence [taubin1995].\n\nmesh   (V, 3) in\n       millimetres\nRaises  BadOption.\n\n    drawn  as is"
    read = hook("docstring_lists").as_markdown(written)
    assert "[[taubin1995]](../bibliography.md#taubin1995)" in read
    assert "`mesh`\n:   (V, 3) in millimetres\n\n`Raises`\n:   BadOption." in read
    assert read.endswith("\n\n    drawn  as is")


def test_the_site_builds_without_a_warning(tmp_path):
    pytest.importorskip("mkdocstrings", reason="the packages of the extra `docs` are not installed")
    pytest.importorskip("material", reason="the packages of the extra `docs` are not installed")
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", tmp_path / "site"]
    run = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 0, run.stderr
    for page in (
        "index.html",
        "methods/patch/index.html",
        "api/recon/index.html",
        "decisions/020-three-js-for-the-page",
    ):
        assert (tmp_path / "site" / page).exists()
    assert 'id="kinoshita"' in (tmp_path / "site" / "bibliography" / "index.html").read_text("utf-8")
