"""Every STEP file that a test leaves behind is read by a second kernel, and the volume compared.

What that kernel does not read is left out: files of several solids, of which it takes the first, voids, and spheres.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

from brep_export.measures import measure
from brep_export.read_back import STEP_ENDINGS, read_cad
from recon.errors import ReconError

LARGEST = 3_000_000  # bytes
AGREEMENT = 5e-3  # of the volume: the other kernel integrates over triangles, coarse ones on trimmed faces


@pytest.fixture(autouse=True)
def second_opinion(request: pytest.FixtureRequest) -> Iterator[None]:
    """After a test with a folder of its own: a failure where the two kernels disagree."""
    folder = request.getfixturevalue("tmp_path") if "tmp_path" in request.fixturenames else None
    yield
    if folder is not None:
        for path in sorted(p for p in folder.rglob("*") if p.suffix.lower() in STEP_ENDINGS):
            compare_volumes(path)


def compare_volumes(path: Path) -> None:
    """Fail where a second kernel reads a solid of another volume; nothing where one of both reads no solid."""
    kernel = pytest.importorskip("pykentron")
    if path.is_symlink() or not path.is_file() or not 0 < path.stat().st_size <= LARGEST:
        return
    try:
        measures, found = measure(read_cad(path)), kernel.importers.importStep(str(path)).val()
    except (ReconError, ValueError):  # files that are meant to be bad
        return
    volume = measures.volume
    if measures.solids != 1 or volume is None or found.ShapeType() != "Solid" or not found.isValid():
        return
    assert found.Volume() == pytest.approx(volume, rel=AGREEMENT), f"{path.name}: a second kernel reads another volume"
