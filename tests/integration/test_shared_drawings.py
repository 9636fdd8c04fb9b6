"""All real drawings: as many solids as are known, the original among them, from DXF and from JSON."""

import json
from pathlib import Path

import numpy as np
import pytest

from recon.geometry.views import DrawnView, ThreeViews
from recon.readers.views import read_views
from recon.three_view.pipeline import interpret

SHARED = Path(__file__).parents[2].parent / "shared"
DRAWINGS = SHARED / "data" / "views" / "drawings"
PARTS = SHARED / "data" / "views" / "parts"
TOOLS = SHARED / "tools"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not DRAWINGS.is_dir(), reason="the folder of drawings is not beside this checkout"),
]


def names():
    return sorted(json.loads((DRAWINGS / "manifest.json").read_text())) if DRAWINGS.is_dir() else []


def parts():
    paths = sorted(PARTS.iterdir()) if PARTS.is_dir() else []
    return [path for path in paths if path.suffix in (".step", ".stp", ".brep")]


def kernel_solids(path):
    import cadquery

    if path.suffix == ".brep":
        return cadquery.Compound.makeCompound(cadquery.Shape.importBrep(str(path)).Solids())
    return cadquery.Compound.makeCompound(cadquery.importers.importStep(str(path)).solids().vals())


def kernel_shape(polyhedron):
    """The solid with whole edges: the kernel's boolean fails where those at which a body touches itself are cut."""
    import cadquery

    from brep_export.solids import polyhedron_solid

    return cadquery.Shape.cast(polyhedron_solid(polyhedron)).clean()


def difference(one, other):
    """Volume of what only one of two shapes fills, as a share; up to 2e-5 mm, as drawings are rounded."""
    cut = [a.cut(b, tol=2e-5) for a, b in ((one, other), (other, one))]
    return sum(abs(piece.Volume()) for piece in cut) / one.Volume()


def original_among(found, original):
    """Whether a solution is the original: first those of its volume, then by boolean difference."""
    for polyhedron in found.polyhedra():
        shape = kernel_shape(polyhedron)
        if abs(shape.Volume() - original.Volume()) < 1e-5 * original.Volume() and difference(original, shape) < 1e-6:
            return True
    return False


@pytest.mark.parametrize("name", names())
def test_a_drawing_has_its_solids_and_the_original_is_one(name):
    known = json.loads((DRAWINGS / "manifest.json").read_text())[name]
    for ending in ("dxf", "json"):
        found = interpret(read_views(DRAWINGS / f"{name}.{ending}").drawing)
        assert (found.count, found.exact) == (known["solutions"], True)
        few = [found.polyhedron(number) for number in range(min(found.count, 40))]
        assert not any(found.differences(solid) for solid in few)
    assert original_among(found, kernel_solids(DRAWINGS / f"{name}.step"))


def test_all_252_lattice_drawings_have_as_many_solids_as_brute_force_found():
    wrong = []
    for case in json.loads((DRAWINGS / "voxel_counts.json").read_text()):
        views = []
        for name in ("front", "top", "side"):
            lines = case["views"][name]
            rows = np.array([*lines["visible"], *lines["hidden"]], dtype=float).reshape(-1, 2, 2)
            views.append(DrawnView(rows, np.arange(len(rows)) >= len(lines["visible"])))
        if interpret(ThreeViews(*views)).count != case["n_solutions"]:
            wrong.append(case["voxel_masks"])
    assert not wrong


@pytest.mark.parametrize("path", parts(), ids=lambda path: path.stem)
def test_a_part_is_found_from_its_drawing(path, monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(TOOLS)
    import make_drawing

    original = kernel_solids(path)
    solids = original.Solids()
    make_drawing.make(solids[0] if len(solids) == 1 else original, str(tmp_path / "part"))
    found = interpret(read_views(tmp_path / "part.json").drawing)
    assert original_among(found, original)


def test_sheets_with_arcs_are_refused_with_their_places():
    from recon.errors import CurvedDrawing

    for path in sorted((DRAWINGS.parent / "sheets").glob("*.dxf")):
        with pytest.raises(CurvedDrawing) as refusal:
            read_views(path)
        assert refusal.value.curves
        assert all(" at (" in curve or " from (" in curve for curve in refusal.value.curves)
