"""The page of --report in a browser: it loads alone, without complaint, and its view obeys clicks."""

import json
import subprocess
import sys

import numpy as np
import pytest
from browser import CHROMIUM, opened

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium to open the page in")

RECON = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]
SQUARE = [[0, 0, 40, 0], [40, 0, 40, 40], [40, 40, 0, 40], [0, 40, 0, 0]]
LARGEST = 15 * 2**20
ANSWERS = {"Is it closed?", "How far off is it?", "Can I print it?"}
COLOURS = """(() => {
    const canvas = document.querySelector("#view canvas"), small = document.createElement("canvas");
    [small.width, small.height] = [120, 80];
    const flat = small.getContext("2d");
    flat.drawImage(canvas, 0, 0, 120, 80);
    const data = new Uint32Array(flat.getImageData(0, 0, 120, 80).data.buffer);
    return new Set(data.filter(colour => colour >>> 24)).size;
})()"""
DRAWN = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))"


def recon(*words, cwd):
    run = subprocess.run(
        [*RECON, *map(str, words), "--report", "page.html", "--quiet"],
        capture_output=True, text=True, timeout=300, check=False, cwd=cwd
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return cwd / "page.html"


def click(page, words):
    """Click the box or button of the panel that is labelled so, and let the view draw."""
    found = page.run(
        f"(() => {{ const label = [...document.querySelectorAll('.panel label')]"
        f".find(l => l.textContent.trim() === {json.dumps(words)}); if (label) label.click(); return !!label; }})()"
    )
    page.run(DRAWN)
    return found


def first_screen(page):
    """Questions whose answers lie within the first screen."""
    return set(
        page.run(
            "[...document.querySelectorAll('.answers div')]"
            ".filter(d => d.getBoundingClientRect().bottom < innerHeight && d.querySelector('dd').textContent)"
            ".map(d => d.querySelector('dt').textContent)"
        )
    )


def assert_sound(page, path):
    assert page.complaints == []
    assert [url for url in page.fetched if not url.startswith(("file:", "data:"))] == []
    assert path.stat().st_size < LARGEST
    assert first_screen(page) == ANSWERS
    assert page.run(COLOURS) > 5


def modes(page):
    return page.run("[...document.querySelectorAll('.panel input[type=radio]')].map(b => b.parentNode.textContent)")


def test_a_click_hides_a_part_and_modes_change_the_view(tmp_path):
    cadquery = pytest.importorskip("cadquery")
    part = cadquery.Workplane().box(20, 12, 6).edges("|Z").fillet(2)
    part.val().exportStep(str(tmp_path / "part.step"))
    path = recon("check", "part.step", cwd=tmp_path)
    with opened(path) as page:
        assert_sound(page, path)
        assert modes(page) == ["the parts", "edges by angle", "zebra stripes"]
        whole = page.run(COLOURS)
        assert click(page, "zebra stripes") and page.run(COLOURS) != whole
        assert click(page, "edges by angle")
        legend = page.run("document.querySelector('.legend').textContent")
        assert "free: one face only: 0 mm" in legend and "smooth, to 0.1°: 48.0 mm" in legend  # 8 edges of 6 mm
        assert click(page, "the parts") and click(page, "shape")
        edges_alone = page.run(COLOURS)
        assert click(page, "edges of shape")
        assert page.run(COLOURS) == 0 < edges_alone
        assert page.complaints == []


def test_a_solid_of_the_gallery_comes_into_the_view(tmp_path):
    drawn = {"front": [[0, 40, 40, 0]], "top": [[0, 0, 40, 40]], "side": [[0, 0, 40, 40]]}
    views = {name: {"visible": [*SQUARE, *lines], "hidden": []} for name, lines in drawn.items()}
    (tmp_path / "puzzle.json").write_text(json.dumps({"views": views}))
    path = recon("views", "puzzle.json", cwd=tmp_path)
    shown = (
        "[...document.querySelectorAll('.panel label')].filter(l => l.querySelector('input[type=checkbox]')?.checked"
        " && l.textContent.startsWith('solid')).map(l => l.textContent)"
    )
    with opened(path) as page:
        assert_sound(page, path)
        assert page.run(shown) == ["solid 1"]
        page.run("document.querySelector('figure[data-part=\"solid 4\"]').dispatchEvent(new MouseEvent('click'))")
        assert page.run(shown) == ["solid 4"]
        page.run("(b => { b.value = '2'; b.onchange(); })(document.querySelector('.gallery select'))")
        assert page.run("[...document.querySelectorAll('#solids figure')].filter(f => !f.hidden).length") == 1
        assert page.complaints == []


def ball(path):
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=20.0)
    mesh.apply_scale([1.0, 0.8, 0.6])
    mesh.export(path / "ball.ply")
    return "fit", "ball.ply", "-o", "ball.step"


def hill(path):
    x, y = np.meshgrid(np.linspace(0, 300, 31), np.linspace(0, 200, 21))
    heights = 5 + 0.04 * x + 60 * np.exp(-(((x - 120) / 70) ** 2) - ((y - 100) / 50) ** 2)
    grid = {"width": 31, "height": 21, "values": heights.ravel().tolist()}
    (path / "hill_10m.json").write_text(json.dumps(grid))
    words = ("terrain", "hill_10m.json", "--interval", 10, "--base-depth", 10, "-o", "hill.step")
    return (*words, "--against", "hill_10m.json")


def block(path):
    axis = np.arange(-20, 20) + 0.5
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    solid = (abs(x) < 15) & (abs(y) < 10) & (abs(z) < 8) & (x**2 + y**2 > 25)
    np.savez(path / "block.npz", voxels=solid.astype(np.uint8), spacing=np.ones(3), origin=np.zeros(3))
    return "voxels", "block.npz", "-o", "block.step"


def row(path):
    t = np.linspace(0, 6, 200)
    np.savetxt(path / "row.csv", np.stack([30 * np.cos(t), 20 * np.sin(t), t], axis=1), delimiter=",")
    return "curve", "row.csv", "-o", "row.step", "--tolerance", "0.1%"


def vessel(path):
    return "demo", "-d", path / "demo"


@pytest.mark.slow
@pytest.mark.parametrize("made", [vessel, ball, row, hill, block], ids=lambda made: made.__name__)
def test_every_command_has_its_page_with_a_scale(made, tmp_path):
    path = recon(*made(tmp_path), cwd=tmp_path)
    with opened(path) as page:
        assert_sound(page, path)
        for name in modes(page):
            assert click(page, name)
            assert page.run(COLOURS) > 5
        scales = [name for name in modes(page) if name.endswith(("mm", " m"))]
        assert scales
        for name in scales:
            click(page, name)
            assert page.run("document.querySelectorAll('.bars i').length") > 20
        assert page.complaints == []
