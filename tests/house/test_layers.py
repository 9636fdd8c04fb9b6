"""The import contract: data climbs, imports descend, rooms have no doors between them, OCP stays behind brep_export.

And the sizes beyond which a module, a function or a class is taken apart.
"""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
KERNEL = ("OCP", "cadquery", "vtk", "vtkmodules", "pyvista")
GROUND = ("recon.errors", "recon.tolerance", "recon.version")
NOT_ROOMS = {"numerics", "geometry", "readers", "subdivision"}
ROOMS = tuple(
    f"recon.{folder.name}"
    for folder in sorted((ROOT / "recon").iterdir())
    if (folder / "__init__.py").exists() and folder.name not in NOT_ROOMS
)
BELOW = {
    "recon.errors": (),
    "recon.version": (),
    "recon.tolerance": ("recon.errors",),
    "recon.numerics": GROUND,
    "recon.geometry": (*GROUND, "recon.numerics"),
    "recon.readers": (*GROUND, "recon.numerics", "recon.geometry"),
    "recon.subdivision": (*GROUND, "recon.numerics", "recon.geometry"),
    **dict.fromkeys(ROOMS, (*GROUND, "recon.numerics", "recon.geometry", "recon.subdivision")),
    "brep_export": (*GROUND, "recon.geometry"),
    "brep_export.app": (
        *GROUND,
        "recon.numerics",
        "recon.geometry",
        "recon.readers",
        "recon.subdivision",
        *ROOMS,
        "brep_export",
    ),
}
MOST_LINES, MOST_LINES_OF_A_FUNCTION, MOST_METHODS = 400, 60, 12
MODULES = sorted(p for package in ("recon", "brep_export") for p in (ROOT / package).rglob("*.py"))


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(path: Path) -> set[str]:
    """Every module that a file imports, at its top, in a function, or for the type checker."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute here"
            names.add(node.module)
    return names


def storey(name: str) -> str | None:
    """The longest storey that a module belongs to; the package `recon` itself only opens doors and belongs to none."""
    return max((s for s in BELOW if (name + ".").startswith(s + ".")), key=len, default=None)


@pytest.mark.parametrize("path", MODULES, ids=module_name)
def test_imports_descend(path):
    home = storey(module_name(path))
    if home is None:
        return
    ours = {name for name in imported(path) if name.split(".")[0] in ("recon", "brep_export")}
    assert {name for name in ours if storey(name) not in (*BELOW[home], home)} == set()


@pytest.mark.parametrize("path", [p for p in MODULES if "recon" in p.relative_to(ROOT).parts[0]], ids=module_name)
def test_no_kernel_below_the_kernel_door(path):
    assert not [name for name in imported(path) if name.split(".")[0] in KERNEL]


@pytest.mark.parametrize("path", MODULES, ids=module_name)
def test_no_dumping_grounds(path):
    assert not {"utils", "util", "helpers", "misc", "common"} & set(path.relative_to(ROOT).with_suffix("").parts)


@pytest.mark.parametrize("path", MODULES, ids=module_name)
def test_modules_functions_and_classes_stay_small(path):
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= MOST_LINES
    declares_options = "commands" in path.parts
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef) and not declares_options:
            assert node.end_lineno - node.lineno < MOST_LINES_OF_A_FUNCTION, node.name
        if isinstance(node, ast.ClassDef):
            methods = [f for f in node.body if isinstance(f, ast.FunctionDef) and not f.name.startswith("__")]
            assert len([f for f in methods if not is_property(f)]) <= MOST_METHODS, node.name


def is_property(function: ast.FunctionDef) -> bool:
    return any(isinstance(d, ast.Name) and d.id.endswith("property") for d in function.decorator_list)


def test_every_storey_of_the_contract_exists():
    names = {module_name(path) for path in MODULES}
    assert set(BELOW) <= names | {name.rsplit(".", 1)[0] for name in names}
