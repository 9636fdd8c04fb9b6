"""The door to cadquery: shapes like any other, workplane methods that outlive a reload, an editor's way to run."""

import importlib
import json
import subprocess
import sys

import numpy as np
import pytest

cq = pytest.importorskip("cadquery")

from brep_export.app import extension  # noqa: E402
from recon.errors import BadOption, GateFailed, ReconError  # noqa: E402
from recon.geometry.contour_map import HeightGrid  # noqa: E402

METHODS = {"reconPatch", "reconFit", "reconCurve", "reconTerrain", "reconVoxels", "reconViews"}
SQUARE = [[0, 0, 40, 0], [40, 0, 40, 40], [40, 40, 0, 40], [0, 40, 0, 0]]


def block():
    filled = np.zeros((34, 28, 22), dtype=bool)
    filled[2:-2, 2:-2, 2:-2] = True
    return filled


def test_importing_changes_nothing():
    probe = (
        "import cadquery as cq; before = set(dir(cq.Workplane)); import brep_export.app.extension, sys;"
        "assert set(dir(cq.Workplane)) == before; assert 'pyvista' not in sys.modules;"
        "assert not [name for name in sys.modules if name.endswith('.pipeline') and name.startswith('recon.')]"
    )
    run = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def test_voxels_of_an_array_become_a_solid_to_go_on_with():
    solid = extension.voxels(block(), analytic=True, spacing=2.0)
    assert type(solid) is cq.Solid and len(solid.Faces()) == 6
    assert solid.Volume() == pytest.approx(60 * 48 * 36, rel=1e-3)
    drilled = cq.Workplane(solid).faces(">Z").workplane(centerOption="CenterOfBoundBox").hole(4.0)
    assert solid.Volume() - drilled.val().Volume() == pytest.approx(36 * np.pi * 4, rel=1e-2)


def test_registered_methods_outlive_a_reload():
    extension.register()
    first = cq.Workplane.reconVoxels
    again = importlib.reload(extension)
    again.register()
    again.register()
    assert set(dir(cq.Workplane)) >= METHODS and cq.Workplane.reconVoxels is not first
    placed = cq.Workplane("XY", origin=(0, 0, 100)).reconVoxels(block(), analytic=True).faces(">Z")
    assert placed.val().Center().z == pytest.approx(100 + 19.5, abs=0.1)


def test_points_become_an_edge_and_close_where_they_meet():
    t = np.linspace(0, 2 * np.pi, 200)
    ring = np.stack([30 * np.cos(t), 20 * np.sin(t)], axis=1)
    ring[-1] = ring[0]
    edge = extension.curve(ring)
    assert type(edge) is cq.Edge and edge.IsClosed()
    assert cq.Face.makeFromWires(cq.Wire.assembleEdges([edge])).Area() == pytest.approx(600 * np.pi, rel=1e-2)


def test_a_hill_is_a_shell_without_a_base_and_a_solid_with_one():
    x, y = np.arange(0.0, 210.0, 10.0), np.arange(0.0, 160.0, 10.0)
    heights = 5 + 0.03 * x + 40 * np.exp(-(((x - 100) / 60) ** 2) - ((y[:, None] - 80) / 40) ** 2)
    grid = HeightGrid(x, y, heights)
    shell, solid = (extension.terrain(grid, interval=10.0, base_depth=depth) for depth in (None, 15.0))
    assert (type(shell), type(solid)) == (cq.Shell, cq.Solid)
    assert solid.BoundingBox().zmin == pytest.approx(shell.BoundingBox().zmin - 15.0, abs=0.5)
    with pytest.raises(BadOption, match="interval"):
        extension.terrain(grid)


def test_a_drawing_has_numbered_solids(tmp_path):
    drawn = {"front": [[0, 40, 40, 0]], "top": [[0, 0, 40, 40]], "side": [[0, 0, 40, 40]]}
    views = {name: {"visible": [*SQUARE, *lines], "hidden": []} for name, lines in drawn.items()}
    (tmp_path / "puzzle.json").write_text(json.dumps({"views": views}))
    solids = [extension.views(tmp_path / "puzzle.json", solution=n) for n in (1, 2)]
    assert all(type(solid) is cq.Solid for solid in solids)
    assert (solids[0].cut(solids[1]).Volume() + solids[1].cut(solids[0]).Volume()) > 100
    with pytest.raises(BadOption, match="7"):
        extension.views(str(tmp_path / "puzzle.json"), solution=7)


def test_what_cannot_be_made_says_why():
    with pytest.raises(ReconError, match=r"nowhere\.ply"):
        extension.patch(["nowhere.ply"])
    with pytest.raises(ReconError):
        extension.voxels(np.zeros((3, 3, 3)))
    assert issubclass(GateFailed, ReconError)


SCRIPT = """
import importlib
import cadquery as cq
import numpy as np
import brep_export.app.extension as recon

importlib.reload(recon).register()
filled = np.zeros((34, 28, 22), dtype=bool)
filled[2:-2, 2:-2, 2:-2] = True
part = cq.Workplane().reconVoxels(filled, analytic=True).edges("|Z").fillet(3.0)
show_object(part, name="rounded block")
"""


def executed(script):
    """What a script shows to an editor, which compiles and executes it in a namespace of its own, as CQ-editor does."""
    shown = {}
    names = {"show_object": lambda what, name=None: shown.update({name: what}), "__name__": "temp"}
    exec(compile(script, "script.py", "exec"), names)
    return shown


def test_an_editor_that_executes_a_script_again_and_again_gets_its_objects():
    for _ in range(2):
        shown = executed(SCRIPT)
        assert list(shown) == ["rounded block"]
        assert shown["rounded block"].val().isValid() and shown["rounded block"].faces().size() == 10
