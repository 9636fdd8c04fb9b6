"""Nothing that only one machine knows may be committed: absolute paths of a home or scratch folder, hosts in pins."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def tracked_files() -> list[Path]:
    try:
        listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout, so there is no list of committed files")
    return [ROOT / name for name in listing.decode().split("\0") if name]


def test_no_absolute_paths():
    pattern = re.compile(rb"[\s\"'(=]/(?:home|root|tmp|work|Users)/[a-z]")
    found = [path.name for path in tracked_files() if path.is_file() and pattern.search(path.read_bytes())]
    assert found == []


def test_constraints_pin_exact_versions_and_nothing_else():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [line for line in lines if line and not line.startswith("#")]
    assert pins
    assert [line for line in pins if not re.fullmatch(r"[A-Za-z0-9._-]+==[0-9][A-Za-z0-9.+!_-]*", line)] == []
