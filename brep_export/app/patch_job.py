"""The job behind `recon patch`: scans to the missing piece, through the gate, to files."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OCP.TopoDS import TopoDS_Shape

from brep_export.app.deliver import gate, print_formats, write_files
from brep_export.app.result import result, statistics
from brep_export.app.workshop import Bench, Exit
from brep_export.check import CheckReport, ShapeKind
from brep_export.faces import trimmed_face
from brep_export.solids import lip_solid, thick_solid
from recon.errors import BadOption, NoWall
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import LipPiece, ThickPiece, TrimmedSurface
from recon.hole_patch.confidence import BOUND, SHARE, Confidence, confidence
from recon.hole_patch.lip_piece import lip_thickness
from recon.hole_patch.pipeline import (
    MissingPiece,
    PatchMethod,
    PatchOptions,
    Relief,
    WallThickness,
    patch_hole,
)
from recon.hole_patch.placing import place
from recon.hole_patch.sherds import find_holes
from recon.hole_patch.thickness import Thickness, piece_thickness
from recon.readers.meshes import read_mesh
from recon.readers.picks import read_picks
from recon.tolerance import Tolerance

__all__ = ["TOLERANCE", "kernel_piece", "patch", "patch_answer"]

# a twentieth of a millimetre: half of what a scanner resolves, and what a kernel edge may stray from its faces
TOLERANCE = Tolerance(merge=1e-4, fit=0.05)

Answer = tuple[Exit, dict[str, Any], tuple[str, ...]]


def patch(request: Mapping[str, Any], bench: Bench) -> Answer:
    """Read the sherds, find the piece, prove it, write it."""
    options = PatchOptions(
        method=PatchMethod(request["method"]),
        thickness=_thickness(request["thickness"]),
        picks=None if request["picks"] is None else read_picks(request["picks"]),
        pass_band=request["pass_band"],
        hole=request["hole"],
        relief=Relief(request["relief"]),
        clearance=request["clearance"],
        settle=request["settle"],
    )
    with bench.phase("read", "reading the scans"):
        sherds = _read(request, bench)
    if request["list_holes"]:
        return _listed(sherds, request, bench)
    with bench.phase("reconstruct", "finding the hole"):
        piece = patch_hole(sherds, options, doing=bench.doing)
    for note in piece.notes:
        bench.note(note)
    return patch_answer("patch", piece, request, bench)


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
            bench.note(f"{path}: {note}")
    return [file.mesh for file in files]


def _listed(sherds: Sequence[TriangleMesh], request: Mapping[str, Any], bench: Bench) -> Answer:
    """Every hole with its number, place and size, and why it cannot be patched, if so; nothing is made."""
    with bench.phase("reconstruct", "finding the holes"):
        holes = find_holes(sherds)
    room = {
        f"hole {number}": {
            "edge_mm": hole.length,
            "near": " ".join(f"{x:.4g}" for x in hole.place),
            "kind": str(hole.kind),
            "walls": hole.n_walls,
            "problem": hole.problem or None,
        }
        for number, hole in enumerate(holes)
    }
    seconds = bench.seconds | {"total": bench.elapsed()}
    answer = result(
        "patch",
        inputs=request["inputs"],
        outputs=(),
        reasons=(),
        kernel={},
        seconds=seconds,
        room=room,
        notes=bench.notes,
    )
    return Exit.WRITTEN, answer, ()


def kernel_piece(piece: MissingPiece) -> tuple[TopoDS_Shape, ShapeKind]:
    """The kernel shape of the piece, and what it is meant to be: a solid, or the face of the outer wall alone."""
    if isinstance(piece.shape, ThickPiece):
        return thick_solid(piece.shape, TOLERANCE), ShapeKind.SOLID
    if isinstance(piece.shape, LipPiece):
        return lip_solid(piece.shape, TOLERANCE), ShapeKind.SOLID
    return trimmed_face(piece.shape, TOLERANCE), ShapeKind.FACE


def patch_answer(
    command: str,
    piece: MissingPiece,
    request: Mapping[str, Any],
    bench: Bench,
    *,
    room: Mapping[str, Any] | None = None,
) -> Answer:
    """Build, prove and write the piece; `room` holds further figures for the answer."""
    _refuse_open_print(piece, request)
    thickness = _thickness_of(piece)
    if thickness is not None:
        _warn_of_thin_places(thickness, request.get("min_wall", 0.0), bench)
    with bench.phase("brep", "building the shape"):
        shape, kind = kernel_piece(piece)
    report = gate(shape, TOLERANCE, kind, bench)
    with bench.phase("reconstruct", "fitting again without each sherd"):
        trust = confidence(piece)
    expected = None if report.triangulation is None else trust.at(report.triangulation.vertices)
    report, written = write_files(
        shape,
        report,
        request,
        bench,
        paint=partial(_paint, piece.sherds, report, expected),
        colours=_colours(expected, request),
    )
    reasons = tuple(str(defect) for defect in report.defects)
    answer = result(
        command,
        inputs=request["inputs"],
        outputs=written,
        reasons=reasons,
        kernel=report.as_json(),
        seconds=bench.seconds | {"total": bench.elapsed()},
        error=statistics(
            piece.sample_distance, unit="mm", against="the walls as scanned within 2 mm of the hole's edge"
        ),
        room=_figures(piece, thickness) | _trust(trust) | _fit(piece.sherds, report, bench) | dict(room or {}),
        notes=bench.notes,
    )
    return (Exit.REFUSED if reasons else Exit.WRITTEN), answer, reasons


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


def _warn_of_thin_places(thickness: Thickness, limit: float, bench: Bench) -> None:
    share, (x, y, z) = thickness.thinner_than(limit)
    if share > 0.0:
        bench.note(
            f"the wall is thinner than {limit:g} mm over {100.0 * share:.0f} % of the piece; it is thinnest, "
            f"{thickness.least:.2f} mm, near ({x:.1f}, {y:.1f}, {z:.1f})."
        )


def _figures(piece: MissingPiece, thickness: Thickness | None) -> dict[str, Any]:
    edge = piece.outer.edge_distance
    axis, settling = piece.around.axis, piece.settling
    return {
        "holes": piece.around.n_holes,
        "method": str(piece.method),
        "axis": None
        if axis is None
        else {
            "point": axis.point.tolist(),
            "direction": axis.direction.tolist(),
            "quality": axis.quality,
            "support": axis.support,
        },
        "settled": None
        if settling is None
        else [{"shift_mm": m.shift_mm, "turn_deg": m.turn_deg, "bounded": m.bounded} for m in settling.moves],
        "sides": piece.outer.sides,
        "box_angle_deg": piece.outer.box_angle_deg,
        "boundary": {"mean": float(edge.mean()), "max": float(edge.max()), "unit": "mm"},
        "edge": {
            "mean": float(edge.mean()),
            "max": float(edge.max()),
            "rejected": piece.outer.rejected,
            "unit": "mm, share",
        },
        "samples": len(piece.sample_distance),
        "thickness": None
        if thickness is None
        else {"min": thickness.least, "mean": thickness.mean, "max": thickness.greatest},
        "relief": None
        if piece.relief is None
        else {"source": str(piece.relief.source), "explained": piece.relief.explained, "depth_mm": piece.relief.depth},
    }


def _trust(trust: Confidence) -> dict[str, Any]:
    """By how much the walls of the piece may be off, over the hole."""
    sigma = trust.over_walls()
    return {
        "confidence": {
            "expected_error_mm": {
                "median": float(np.median(sigma)),
                "p95": float(np.quantile(sigma, 0.95)),
                "max": float(sigma.max()),
            },
            "share": SHARE,
            "within": BOUND,
            "sherds_left_out": trust.outer.n_left_out,
        }
    }


def _fit(sherds: Sequence[TriangleMesh], report: CheckReport, bench: Bench) -> dict[str, Any]:
    """How a closed piece lies between its neighbours, and the way in which it is set in."""
    if report.expected is not ShapeKind.SOLID or not report.passed:
        return {}
    with bench.phase("check", "setting the piece in"):
        placing = place(report.triangles(), sherds)
    gaps = [neighbour.gap_mm for neighbour in placing.neighbours]
    overlaps = [n.overlap_share for n in placing.neighbours if n.overlap_share is not None]
    way = placing.insert_direction
    return {
        "gap": {"min": min(gaps, default=None), "overlap": sum(overlaps) if overlaps else None, "unit": "mm, share"},
        "insert_direction": None if way is None else [float(x) for x in way],
        "undercut_mm": placing.undercut_mm,
        "collision_free": placing.collision_free,
    }


def _colours(expected: NDArray[np.float64] | None, request: Mapping[str, Any]) -> NDArray[np.uint8] | None:
    """Of the piece's vertices; the pictures are loaded only where a file holds colours."""
    if expected is None or not any(str(path).lower().endswith(".glb") for path in request["outputs"]):
        return None
    from brep_export.app.pictures import colours_of

    return colours_of(expected)


def _paint(
    sherds: Sequence[TriangleMesh], report: CheckReport, expected: NDArray[np.float64] | None, path: Path
) -> None:
    from brep_export.app.pictures import draw, vessel_views

    lines = [np.array(line) for line in report.free_edges] if report.expected is ShapeKind.SOLID else []
    draw(path, vessel_views(sherds, report.triangles(), lines, expected))
