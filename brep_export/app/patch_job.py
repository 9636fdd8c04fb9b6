"""The job behind `recon patch`: scans to the missing piece, through the gate, to files."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OCP.TopoDS import TopoDS_Shape

from brep_export.app.deliver import Parcel, gate, print_formats, write_parcels
from brep_export.app.hole_list import hole_figures, hole_list
from brep_export.app.outputs import check_destinations
from brep_export.app.piece_figures import piece_figures, placing_figures, trust_figures
from brep_export.app.result import kernel_of_all, result, statistics
from brep_export.app.scene import Measured, mesh_part
from brep_export.app.workshop import Bench, Exit
from brep_export.check import CheckReport, ShapeKind
from brep_export.faces import trimmed_face
from brep_export.solids import lip_solid, thick_solid
from recon.errors import BadOption, NoHole, NoWall, ReconError
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import LipPiece, ThickPiece, TrimmedSurface
from recon.hole_patch.confidence import BOUND, Confidence, PieceErrors, confidence
from recon.hole_patch.lip_piece import lip_thickness
from recon.hole_patch.pipeline import (
    MissingPiece,
    PatchMethod,
    PatchOptions,
    Relief,
    WallThickness,
    list_holes,
    patch_holes,
    patch_readings,
)
from recon.hole_patch.placing import Placing, place, scans_tolerance
from recon.hole_patch.thickness import Thickness, piece_thickness
from recon.readers.meshes import read_mesh
from recon.readers.picks import read_picks
from recon.tolerance import Tolerance

__all__ = ["TOLERANCE", "BuiltPiece", "built", "kernel_piece", "patch", "patch_answer"]

# a twentieth of a millimetre: half of what a scanner resolves, and what a kernel edge may stray from its faces
TOLERANCE = Tolerance(merge=1e-4, fit=0.05)

EVERY_HOLE = "all"
WORTH_A_WORD = 0.1  # of the volume, by which the piece may be off
SAMPLES = "the walls as scanned within 2 mm of the hole's edge"

Answer = tuple[Exit, dict[str, Any], tuple[str, ...]]


def patch(request: Mapping[str, Any], bench: Bench) -> Answer:
    """Read the sherds, find the piece, prove it, write it."""
    every = request["hole"] == EVERY_HOLE
    options = PatchOptions(
        method=PatchMethod(request["method"]),
        thickness=_thickness(request["thickness"]),
        picks=None if request["picks"] is None else read_picks(request["picks"]),
        pass_band=request["pass_band"],
        hole=None if every else _hole(request["hole"]),
        relief=Relief(request["relief"]),
        clearance=request["clearance"],
        settle=request["settle"],
    )
    with bench.phase("read", "reading the scans"):
        sherds = _read(request, bench)
    if request["list_holes"]:
        with bench.phase("reconstruct", "finding the holes"):
            found = list_holes(sherds, options, doing=bench.doing)
        return hole_list(found, request, bench)
    if every:
        return _patch_all(sherds, options, request, bench)
    return patch_answer("patch", patch_readings(sherds, options, doing=bench.doing), request, bench)


def _hole(text: str | None) -> int | None:
    if text is None:
        return None
    if not text.isdecimal():
        raise BadOption("--hole", f"must be a number that --list gives, or {EVERY_HOLE}, not {text!r}")
    return int(text)


def _thickness(text: str | None) -> float | WallThickness | None:
    if text is None or text == WallThickness.SHOWN.value:
        return None if text is None else WallThickness.SHOWN
    try:
        return float(text)
    except ValueError:
        raise BadOption("--thickness", f"must be a length in mm or auto, not {text!r}") from None


def _read(request: Mapping[str, Any], bench: Bench) -> list[TriangleMesh]:
    if len(set(map(Path, request["inputs"]))) < len(request["inputs"]):
        raise BadOption("sherds", "the same file is named twice")
    files = [read_mesh(path, unit=request["unit"]) for path in request["inputs"]]
    for path, file in zip(request["inputs"], files):
        for note in file.notes:
            bench.note(f"{path}: {note}", name="reading")
    return [file.mesh for file in files]


def kernel_piece(piece: MissingPiece) -> tuple[TopoDS_Shape, ShapeKind]:
    """The kernel shape of the piece, and what it is meant to be: a solid, or the face of the outer wall alone."""
    if isinstance(piece.shape, ThickPiece):
        return thick_solid(piece.shape, TOLERANCE), ShapeKind.SOLID
    if isinstance(piece.shape, LipPiece):
        return lip_solid(piece.shape, TOLERANCE), ShapeKind.SOLID
    return trimmed_face(piece.shape, TOLERANCE), ShapeKind.FACE


@dataclass(frozen=True, eq=False)
class BuiltPiece:
    """A piece, its kernel shape, what the gate said of it, and how a solid that passed lies between its neighbours."""

    piece: MissingPiece
    shape: TopoDS_Shape
    report: CheckReport
    placing: Placing | None

    def betters(self, other: "BuiltPiece") -> bool:
        """Whether this is to be kept, and not another from a likelier reading.

        It is where it passed the gate and the other did not, or where it cuts less into its neighbours by more than the
        tolerance with which these are placed.
        """
        if self.report.passed != other.report.passed:
            return self.report.passed
        return self._gap > other._gap + (0.0 if other.placing is None else other.placing.tolerance_mm)

    @property
    def _gap(self) -> float:
        gap = None if self.placing is None else self.placing.usual_gap_mm
        return 0.0 if gap is None else gap

    @property
    def sound(self) -> bool:
        return self.report.passed and (self.placing is None or not self.placing.cuts_in)


def built(pieces: Iterator[MissingPiece], bench: Bench, *, name: str = "") -> BuiltPiece:
    """The first piece that passes the gate and does not cut into its neighbours; else the best, the first of like ones.

    pieces  of one hole, by the readings of its walls, at least one; made as they are asked for
    Raises  what the first piece raised, where none could be built.
    """
    best: BuiltPiece | None = None
    error: ReconError | None = None
    while True:
        with bench.phase("reconstruct", f"{name}finding the hole"):
            piece = next(pieces, None)
        if piece is None:
            break
        try:
            made = _built(piece, bench, name)
        except ReconError as failure:
            error = error or failure
            continue
        if made.sound:
            return made
        best = made if best is None or made.betters(best) else best
    if best is None:
        raise error or NoHole("no piece was made.")
    return best


def _built(piece: MissingPiece, bench: Bench, name: str) -> BuiltPiece:
    with bench.phase("brep", f"{name}building the shape"):
        shape, kind = kernel_piece(piece)
    report = gate(shape, TOLERANCE, kind, bench)
    if not report.passed or kind is not ShapeKind.SOLID:
        return BuiltPiece(piece, shape, report, None)
    with bench.phase("check", f"{name}setting the piece in"):
        placing = place(report.triangles(), piece.sherds, tolerance=scans_tolerance(piece.settling))
    return BuiltPiece(piece, shape, report, placing)


@dataclass(frozen=True, eq=False)
class _Proved:
    """A built piece, its thickness, and how far it may be trusted; notes about it begin with the name."""

    found: BuiltPiece
    thickness: Thickness | None
    trust: Confidence
    errors: PieceErrors | None
    name: str

    @property
    def piece(self) -> MissingPiece:
        return self.found.piece

    def parcel(self, outputs: Sequence[str], picture: str | None) -> Parcel:
        report = self.found.report
        expected = None if self.errors is None else self.errors.at_vertices
        paint = partial(_paint, self.piece.sherds, report, expected)
        title = f"the piece of {self.name[:-2]}" if self.name else "the piece"
        measured, colours = partial(_measured, self.piece.sherds, self.trust), _colours(expected, outputs)
        return Parcel(
            self.found.shape, report, outputs, picture, paint, colours=colours, measured=measured, title=title
        )

    @property
    def _volume_off(self) -> float | None:
        """Share of the volume that it is expected to be off by; None of an open piece."""
        measures = self.found.report.measures
        if self.errors is None or measures is None or measures.volume is None or self.found.placing is None:
            return None
        return self.errors.volume / measures.volume

    def tell(self, bench: Bench) -> None:
        """A word where cracks that were not scanned leave the volume open."""
        off = self._volume_off
        if off is not None and BOUND * off > WORTH_A_WORD and not self.trust.fracture_scanned:
            bench.note(
                f"{self.name}nothing shows how the cracks lean through the wall: the piece may have up to"
                f" {100.0 * BOUND * off:.0f} % more or less volume than the lost one.",
                name="volume",
            )

    def figures(self, bench: Bench) -> dict[str, Any]:
        return (
            piece_figures(self.piece, self.thickness) | trust_figures(self.trust, self._volume_off) | _fit(self, bench)
        )


def patch_answer(
    command: str,
    pieces: Iterator[MissingPiece],
    request: Mapping[str, Any],
    bench: Bench,
    *,
    room: Callable[[MissingPiece], Mapping[str, Any]] = lambda piece: {},
) -> Answer:
    """Build, prove and write the first of the pieces of a hole that is sound; `room` finds further figures of it."""
    found = built(pieces, bench)
    piece = found.piece
    for note in piece.notes:
        bench.note(note, name="piece")
    proved = _proved(found, request, bench)
    figures = proved.figures(bench)
    ((report, written),) = write_parcels([proved.parcel(request["outputs"], request.get("picture"))], request, bench)
    reasons = tuple(str(defect) for defect in report.defects)
    answer = result(
        command,
        inputs=request["inputs"],
        outputs=written,
        reasons=reasons,
        kernel=report.as_json(),
        seconds=bench.seconds | {"total": bench.elapsed()},
        error=statistics(piece.sample_distance, unit="mm", against=SAMPLES),
        room=figures | dict(room(piece)),
        notes=bench.notes,
    )
    return (Exit.REFUSED if reasons else Exit.WRITTEN), answer, reasons


def _patch_all(
    sherds: Sequence[TriangleMesh], options: PatchOptions, request: Mapping[str, Any], bench: Bench
) -> Answer:
    """A piece for every hole that can be patched, all written or none; the other holes are named with their reasons."""
    with bench.phase("reconstruct", "finding the holes"):
        attempts = patch_holes(sherds, options, doing=bench.doing)
    made = [(a.number, a.piece) for a in attempts if a.piece is not None]
    refused = [a for a in attempts if a.piece is None]
    if not made:
        raise NoHole("no hole can be patched: " + " ".join(f"hole {a.number}: {a.reason}" for a in refused))
    for attempt in refused:
        bench.note(f"hole {attempt.number} gets no piece: {attempt.reason}", name="hole-left-out")
    proved = {}
    for number, piece in made:
        name = f"hole {number}: "
        proved[number] = _proved(built(iter([piece]), bench, name=name), request, bench, name=name)
    parcels = [p.parcel(*_numbered(number, request)) for number, p in proved.items()]
    delivered = dict(zip(proved, write_parcels(parcels, request, bench)))
    reasons = tuple(f"hole {n}: {defect}" for n, (report, _) in delivered.items() for defect in report.defects)
    pieces = [_piece_entry(n, proved[n], *delivered[n], bench) for n in proved]
    left_out = [
        {"hole": a.number, "verdict": "refused", "reasons": [a.reason], "outputs": [], **hole_figures(a.hole)}
        for a in refused
    ]
    answer = result(
        "patch",
        inputs=request["inputs"],
        outputs=[path for _, paths in delivered.values() for path in paths],
        reasons=reasons,
        kernel=kernel_of_all([report.as_json() for report, _ in delivered.values()]),
        seconds=bench.seconds | {"total": bench.elapsed()},
        error=statistics(np.concatenate([p.sample_distance for _, p in made]), unit="mm", against=SAMPLES),
        room={"holes": len(attempts), "pieces": sorted(pieces + left_out, key=lambda entry: entry["hole"])},
        notes=bench.notes,
    )
    return (Exit.REFUSED if reasons else Exit.WRITTEN), answer, reasons


def _numbered(number: int, request: Mapping[str, Any]) -> tuple[list[str], str | None]:
    """The files of one hole's piece: piece.step becomes piece-0.step."""

    def numbered(name: str) -> str:
        return str(Path(name).with_stem(f"{Path(name).stem}-{number}"))

    outputs, picture = [numbered(path) for path in request["outputs"]], request.get("picture")
    picture = None if picture is None else numbered(picture)
    check_destinations({**request, "outputs": outputs, "picture": picture})
    return outputs, picture


def _piece_entry(
    number: int, proved: _Proved, report: CheckReport, written: Sequence[str], bench: Bench
) -> dict[str, Any]:
    reasons = [str(defect) for defect in report.defects]
    return {
        "hole": number,
        "verdict": "refused" if reasons else "pass",
        "reasons": reasons,
        "outputs": list(written),
        "kernel": report.as_json(),
        "error": statistics(proved.piece.sample_distance, unit="mm", against=SAMPLES),
        "notes": list(proved.piece.notes),
        **proved.figures(bench),
    }


def _proved(found: BuiltPiece, request: Mapping[str, Any], bench: Bench, *, name: str = "") -> _Proved:
    """How far a piece may be trusted; notes about it begin with the name."""
    piece = found.piece
    _refuse_open_print(piece, request)
    thickness = _thickness_of(piece)
    if thickness is not None:
        _warn_of_thin_places(thickness, request.get("min_wall", 0.0), bench, name)
    with bench.phase("reconstruct", f"{name}fitting again without each sherd"):
        trust = confidence(piece)
        triangles = found.report.triangulation
        errors = None if triangles is None else trust.of(triangles)
    proved = _Proved(found, thickness, trust, errors, name)
    proved.tell(bench)
    return proved


def _refuse_open_print(piece: MissingPiece, request: Mapping[str, Any]) -> None:
    open_prints = print_formats(request) if isinstance(piece.shape, TrimmedSurface) else []
    if open_prints and not request["allow_open"]:
        raise NoWall(
            f"{open_prints[0]} is meant for printing, which needs a closed body, and only the outer wall was scanned; "
            "give its thickness in mm with --thickness, or write the open face with --allow-open."
        )


def _thickness_of(piece: MissingPiece) -> Thickness | None:
    if isinstance(piece.shape, LipPiece):
        return lip_thickness(piece.outer)
    return None if piece.inner is None else piece_thickness(piece.outer, piece.inner)


def _warn_of_thin_places(thickness: Thickness, limit: float, bench: Bench, name: str) -> None:
    share, (x, y, z) = thickness.thinner_than(limit)
    if share > 0.0:
        bench.note(
            f"{name}the wall is thinner than {limit:g} mm over {100.0 * share:.0f} % of the piece; it is thinnest, "
            f"{thickness.least:.2f} mm, near ({x:.1f}, {y:.1f}, {z:.1f}).",
            name="thin-wall",
        )


def _fit(proved: _Proved, bench: Bench) -> dict[str, Any]:
    """How a closed piece lies between its neighbours, and the way in which it is set in."""
    placing = proved.found.placing
    if placing is None:
        return {}
    for note in placing.notes:
        bench.note(f"{proved.name}{note}", name="placing")
    return placing_figures(placing)


def _colours(expected: NDArray[np.float64] | None, outputs: Sequence[str]) -> NDArray[np.uint8] | None:
    """Of the piece's vertices; the pictures are loaded only where a file holds colours."""
    if expected is None or not any(str(path).lower().endswith(".glb") for path in outputs):
        return None
    from brep_export.app.pictures import colours_of

    return colours_of(expected)


def _measured(sherds: Sequence[TriangleMesh], trust: Confidence) -> Measured:
    from brep_export.app.pictures import CLAY

    parts = [mesh_part(f"sherd {i}", mesh, CLAY[i % len(CLAY)]) for i, mesh in enumerate(sherds, 1)]
    return Measured(parts, trust.at, "expected error, mm")


def _paint(
    sherds: Sequence[TriangleMesh], report: CheckReport, expected: NDArray[np.float64] | None, path: Path
) -> None:
    from brep_export.app.pictures import draw, vessel_views

    lines = [np.array(line) for line in report.free_edges] if report.expected is ShapeKind.SOLID else []
    draw(path, vessel_views(sherds, report.triangles(), lines, expected))
