"""The job behind `recon patch`: scans to the missing piece, through the gate, to files."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from OCP.TopoDS import TopoDS_Shape
from threadpoolctl import threadpool_limits

from brep_export.app.deliver import gate, print_formats, write_files
from brep_export.app.result import result, statistics
from brep_export.app.workshop import Bench, Exit
from brep_export.check import CheckReport, ShapeKind
from brep_export.faces import trimmed_face
from brep_export.solids import lip_solid, thick_solid
from recon.errors import BadOption, NoWall
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import LipPiece, ThickPiece, TrimmedSurface
from recon.hole_patch.lip_piece import lip_thickness
from recon.hole_patch.pipeline import MissingPiece, PatchMethod, PatchOptions, Relief, patch_hole
from recon.hole_patch.placing import place
from recon.hole_patch.settling import settle
from recon.hole_patch.sherds import find_holes
from recon.hole_patch.thickness import piece_thickness
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
        thickness=request["thickness"],
        picks=None if request["picks"] is None else read_picks(request["picks"]),
        pass_band=request["pass_band"],
        hole=request["hole"],
        relief=Relief(request["relief"]),
    )
    with bench.phase("read", "reading the scans"):
        sherds = _read(request, bench)
    if request["list_holes"]:
        return _listed(sherds, request, bench)
    room: dict[str, Any] = {}
    if request["settle"]:
        with bench.phase("reconstruct", "settling the sherds"):
            sherds, room = _settled(sherds, bench)
    with bench.phase("reconstruct", "finding the hole"):
        piece = patch_hole(sherds, options, doing=bench.doing)
    for note in piece.notes:
        bench.note(note)
    return patch_answer("patch", sherds, piece, request, bench, room=room)


def _read(request: Mapping[str, Any], bench: Bench) -> list[TriangleMesh]:
    if len(set(map(Path, request["inputs"]))) < len(request["inputs"]):
        raise BadOption("sherds", "the same file is named twice")
    files = [read_mesh(path, unit=request["unit"]) for path in request["inputs"]]
    for path, file in zip(request["inputs"], files):
        for note in file.notes:
            bench.note(f"{path}: {note}")
    return [file.mesh for file in files]


def _settled(sherds: list[TriangleMesh], bench: Bench) -> tuple[list[TriangleMesh], dict[str, Any]]:
    """The sherds settled against each other, and how far each was moved; the piece is made for them as settled."""
    with threadpool_limits(limits=1, user_api="blas"):
        settling = settle(sherds)
    bench.note(settling.summary())
    moves = [{"shift_mm": m.shift_mm, "turn_deg": m.turn_deg, "bounded": m.bounded} for m in settling.moves]
    return list(settling.sherds), {"settled": moves}


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
    sherds: Sequence[TriangleMesh],
    piece: MissingPiece,
    request: Mapping[str, Any],
    bench: Bench,
    *,
    room: Mapping[str, Any] | None = None,
) -> Answer:
    """Build, prove and write the piece; `room` holds further figures for the answer."""
    _refuse_open_print(piece, request)
    with bench.phase("brep", "building the shape"):
        shape, kind = kernel_piece(piece)
    report = gate(shape, TOLERANCE, kind, bench)
    report, written = write_files(shape, report, request, bench, paint=partial(_paint, sherds, report))
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
        room=_figures(piece) | _fit(sherds, report, bench) | dict(room or {}),
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


def _figures(piece: MissingPiece) -> dict[str, Any]:
    edge = piece.outer.edge_distance
    thickness = None if piece.inner is None else piece_thickness(piece.outer, piece.inner)
    if isinstance(piece.shape, LipPiece):
        thickness = lip_thickness(piece.outer)
    return {
        "holes": piece.around.n_holes,
        "method": str(piece.method),
        "sides": piece.outer.sides,
        "box_angle_deg": piece.outer.box_angle_deg,
        "boundary": {"mean": float(edge.mean()), "max": float(edge.max()), "unit": "mm"},
        "samples": len(piece.sample_distance),
        "thickness": None
        if thickness is None
        else {"min": thickness.least, "mean": thickness.mean, "max": thickness.greatest},
        "relief": None
        if piece.relief is None
        else {"source": str(piece.relief.source), "explained": piece.relief.explained, "depth_mm": piece.relief.depth},
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


def _paint(sherds: Sequence[TriangleMesh], report: CheckReport, path: Path) -> None:
    from brep_export.app.pictures import draw, vessel_views

    lines = [np.array(line) for line in report.free_edges] if report.expected is ShapeKind.SOLID else []
    draw(path, vessel_views(sherds, report.triangles(), lines))
