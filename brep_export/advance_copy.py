"""STEP that is written before the gate has spoken, and read by a second process while the gate goes on.

The kernel reads a large file for as long as all other lines of the gate take, and holds the interpreter meanwhile:

    this process     survey, text | the gate's other lines ...............| compare, put in place, or thrown away
    second process                | read the text, measure what came back |

The file stands under a hidden name beside its place. It is put in place by whoever writes the outputs, once the gate
has passed and what came back is what was written.
"""

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from OCP.TopoDS import TopoDS_Shape

import brep_export
from brep_export.file_header import FileHeader
from brep_export.kernel_settings import KERNEL_FAILURES, kernel_threads
from brep_export.measures import ShapeMeasures, measure
from brep_export.spline_step import write_spline_text
from brep_export.survey import Survey, survey

__all__ = ["AdvanceCopy", "advance_copy"]

FEWEST_FACES = 2000  # below, a second process has hardly begun when the gate is through


@dataclass(frozen=True, eq=False)
class AdvanceCopy:
    """A file on its way, what was seen and measured of the shape in it, and who reads it."""

    path: Path
    header: FileHeader
    seen: Survey
    measures: ShapeMeasures
    reader: "subprocess.Popen[bytes]"

    def move_to(self, place: Path) -> ShapeMeasures | None:
        """Wait for the reader, rename the file, and say what was read; None where the reader broke off.

        Raises  OSError where the file cannot be renamed.
        """
        assert self.reader.stdout is not None
        answer = self.reader.stdout.read()
        self.path.replace(place)
        found = pickle.loads(answer) if self.reader.wait() == 0 else None
        return found if isinstance(found, ShapeMeasures) else None


@contextmanager
def advance_copy(
    shape: TopoDS_Shape,
    place: str | Path,
    header: FileHeader,
    *,
    announce: Callable[[Path], None] = lambda path: None,
) -> Iterator[AdvanceCopy | None]:
    """A copy of a shape on its way to `place`; None where that would save nothing, or could not be written.

    A second process is started for shapes of many faces that go through `spline_step`, and where the kernel may have
    two threads (`kernel_threads`).
    announce  called with the temporary path before it is made
    Promises  neither file nor process outlives the block.
    """
    place = Path(place)
    path = place.with_name(f".{place.stem}.{os.getpid()}.advance{place.suffix}")
    reader = None
    try:
        seen = _worth_it(shape)
        if seen is not None and (measures := _written(shape, path, header, seen, announce)) is not None:
            reader = _reader(path, str(header.unit))
            yield AdvanceCopy(path, header, seen, measures, reader)
        else:
            yield None
    finally:
        if reader is not None:
            _end(reader)
        path.unlink(missing_ok=True)


def _worth_it(shape: TopoDS_Shape) -> Survey | None:
    if kernel_threads() < 2 or shape.IsNull():
        return None
    try:
        seen = survey(shape)
    except KERNEL_FAILURES:  # the gate will name it
        return None
    return seen if len(seen.uses.faces) >= FEWEST_FACES else None


def _written(
    shape: TopoDS_Shape, path: Path, header: FileHeader, seen: Survey, announce: Callable[[Path], None]
) -> ShapeMeasures | None:
    """What was measured of the shape, once it is in the file."""
    try:
        measures = measure(shape, seen=seen)
        announce(path)
        return measures if write_spline_text(shape, path, header, measures, seen) else None
    except OSError:  # those who write the outputs will meet it again, and name it
        return None
    except KERNEL_FAILURES:
        return None


def _reader(path: Path, unit: str) -> "subprocess.Popen[bytes]":
    found_in = [str(Path(brep_export.__file__).parents[1]), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    return subprocess.Popen(
        [sys.executable, "-m", "brep_export.second_reader", str(os.getpid()), str(path), unit],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(place for place in found_in if place)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )


def _end(reader: "subprocess.Popen[bytes]") -> None:
    reader.kill()
    reader.wait()
    if reader.stdout is not None:
        reader.stdout.close()
