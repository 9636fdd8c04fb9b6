"""The names that the packages offer: the same for the interpreter, the type checker and the reference, and light."""

import ast
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("recon", "brep_export")


def typed_names(package):
    """Names by module, as the type checker sees them."""
    tree = ast.parse((ROOT / package / "__init__.py").read_text(encoding="utf-8"))
    (block,) = [node for node in tree.body if isinstance(node, ast.If)]
    return {alias.name: node.module for node in block.body for alias in node.names if alias.asname == alias.name}


@pytest.mark.parametrize("package", PACKAGES)
def test_types_and_names_agree(package):
    assert typed_names(package) == import_module(package)._MODULE_OF


@pytest.mark.parametrize("package", PACKAGES)
def test_every_name_is_there_and_is_what_its_module_says(package):
    module = import_module(package)
    for name, home in typed_names(package).items():
        assert getattr(module, name) is getattr(import_module(home), name)
    assert set(module.__all__) <= set(dir(module))


@pytest.mark.parametrize("package", PACKAGES)
def test_the_reference_has_every_name(package):
    page = (ROOT / "docs" / "api" / f"{package}.md").read_text(encoding="utf-8")
    told = set(re.findall(rf"^::: {package}\.(\w+)$", page, flags=re.MULTILINE))
    assert told == set(typed_names(package))


def test_no_lazy_name_is_that_of_a_submodule():
    for package in PACKAGES:
        modules = {path.stem for path in (ROOT / package).iterdir()}
        assert set(typed_names(package)) & modules == set()


def test_importing_the_packages_loads_nothing_heavy():
    probe = "import sys, recon, brep_export; print({'numpy', 'scipy', 'OCP', 'cadquery'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True).stdout == "set()\n"
