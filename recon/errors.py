"""One error for each promise that can break, with what was measured in its fields.

Two families decide what a caller does next, and which exit status the command line gives:

    InputError   what was handed over cannot be used as it is (exit status 2)
    Refusal      it was understood, but no sound result follows from it (exit status 1)
"""

from collections.abc import Mapping, Sequence

__all__ = [
    "ReconError",
    "InputError",
    "UnreadableFile",
    "UnsupportedFormat",
    "BadGeometry",
    "BadOption",
    "Refusal",
    "NotManifold",
    "NoHole",
    "NoSurface",
    "NoWall",
    "NoSolid",
    "CurvedDrawing",
    "GateFailed",
    "NotWritten",
]


class ReconError(Exception):
    """Anything that the project itself has to say about a failure; the message is one sentence for a person, and
    `figures`, where there are any, say the same to a program.
    """

    figures: Mapping[str, object] = {}


class InputError(ReconError):
    """What was handed over cannot be used as it is."""


class Refusal(ReconError):
    """The input was understood, but no sound result follows from it."""


class UnreadableFile(InputError):
    """A file is missing, empty, truncated, or not what its name says."""

    def __init__(self, path: str, problem: str, advice: str = "") -> None:
        super().__init__(f"{path}: {problem}." + (f" {advice}." if advice else ""))
        self.path, self.problem, self.advice = path, problem, advice


class UnsupportedFormat(InputError):
    """The ending of a file name belongs to no format that can be read, or written, here."""

    def __init__(self, path: str, allowed: Sequence[str]) -> None:
        super().__init__(f"{path}: its ending names no format known here; use one of {' '.join(allowed)}.")
        self.path, self.allowed = path, tuple(allowed)


class BadGeometry(InputError):
    """Arrays that describe no geometry: wrong shapes, indices out of range, coordinates that are not finite."""

    def __init__(self, what: str, problem: str) -> None:
        super().__init__(f"{what}: {problem}.")
        self.what, self.problem = what, problem


class BadOption(InputError):
    """An option whose value makes no sense, alone or beside the others."""

    def __init__(self, option: str, problem: str) -> None:
        super().__init__(f"{option}: {problem}.")
        self.option, self.problem = option, problem


class NotManifold(Refusal):
    """A mesh whose edges or vertices are shared in a way that no surface allows."""

    def __init__(self, what: str, problem: str, where: Sequence[float] | None = None) -> None:
        place = "" if where is None else f" near ({', '.join(f'{x:.3g}' for x in where)})"
        super().__init__(f"{what}: {problem}{place}.")
        self.what, self.problem = what, problem
        self.where = None if where is None else tuple(float(x) for x in where)


class NoHole(Refusal):
    """The sherds surround no hole that could be patched."""


class NoSurface(Refusal):
    """No surface through the given points keeps the accuracy asked for."""


class NoWall(Refusal):
    """The second wall of the piece is unknown and no thickness was given."""


class NoSolid(Refusal):
    """No solid is drawn as the drawing shows; `conflicts` are the lines that contradict each other, where known, and
    `repairs` the changes that would mend them.
    """

    def __init__(self, problem: str, conflicts: Sequence[object] = (), repairs: Sequence[object] = ()) -> None:
        super().__init__(problem[0].upper() + problem[1:] + ("" if problem.endswith(".") else "."))
        self.conflicts, self.repairs = tuple(conflicts), tuple(repairs)
        self.figures = {"conflicts": list(map(str, conflicts)), "repairs": list(map(str, repairs))}


class CurvedDrawing(Refusal):
    """A drawing with arcs or other curves, where only straight edges can be read; `curves` names them and where."""

    def __init__(self, path: str, curves: Sequence[str]) -> None:
        shown = "; ".join(curves[:50]) + (f"; and {len(curves) - 50} more" if len(curves) > 50 else "")
        count = f"{len(curves)} curves" if len(curves) > 1 else "a curve"
        super().__init__(f"{path}: holds {count}, and only straight edges can be read: {shown}.")
        self.path, self.curves = path, tuple(curves)
        self.figures = {"curves": list(curves)}


class GateFailed(Refusal):
    """A kernel shape that does not keep what it promises; `defects` lists each broken line of the gate."""

    def __init__(self, defects: Sequence[object]) -> None:
        super().__init__("; ".join(str(defect) for defect in defects))
        self.defects = tuple(defects)


class NotWritten(Refusal):
    """An output file could not be written, or did not read back as what was written; nothing was left behind."""

    def __init__(self, path: str, problem: str) -> None:
        super().__init__(f"{path} was not written: {problem}.")
        self.path, self.problem = path, problem
