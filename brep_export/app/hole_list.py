"""What `recon patch --list` answers: every hole with its number, size, kind and place, and a picture of them."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from brep_export.app.deliver import exhibit
from brep_export.app.result import result
from brep_export.app.scene import ScenePart, line_part, mesh_part
from brep_export.app.workshop import Bench, Exit
from brep_export.staging import staged
from recon.hole_patch.hole import Hole
from recon.hole_patch.pipeline import HolesFound

__all__ = ["hole_figures", "hole_list"]

COLOURS = ("#d62020", "#1f6fd1", "#0b8a3c", "#8a2fb5", "#d07a00", "#008b94", "#c2186b", "#5b5b00")
MOST_PANELS = 4
SEEN = np.cos(np.radians(50.0))  # a hole is well seen from within this angle of where it faces


def hole_list(found: HolesFound, request: Mapping[str, Any], bench: Bench) -> tuple[Exit, dict[str, Any], tuple[()]]:
    """Every hole with its figures, and why it cannot be patched, if so; nothing is made but the picture asked for."""
    written = []
    if request["picture"] is not None:
        with bench.phase("write", "drawing"), staged(request["picture"], announce=bench.staged) as (temporary,):
            _paint(found, temporary)
        written = [request["picture"]]
    exhibit(request, bench, partial(_shown, found), [partial(_paint, found)])
    answer = result(
        "patch",
        inputs=request["inputs"],
        outputs=written,
        reasons=(),
        kernel={},
        seconds=bench.seconds | {"total": bench.elapsed()},
        room={f"hole {number}": {"number": number, **hole_figures(hole)} for number, hole in enumerate(found.holes)},
        notes=bench.notes,
    )
    return Exit.WRITTEN, answer, ()


def hole_figures(hole: Hole) -> dict[str, Any]:
    """Size, kind and place of a hole, in millimetres, and what keeps it from being patched."""
    return {
        "edge_mm": hole.length,
        "size_mm": [float(x) for x in hole.size],
        "near": " ".join(f"{x:.4g}" for x in hole.place),
        "kind": str(hole.kind),
        "walls": hole.n_walls,
        "problem": hole.problem or None,
    }


def _shown(found: HolesFound) -> list[ScenePart]:
    from brep_export.app.pictures import CLAY

    sherds = [mesh_part(f"sherd {i}", mesh, CLAY[i % len(CLAY)]) for i, mesh in enumerate(found.sherds, 1)]
    edges = [
        line_part(f"hole {number}", [np.vstack([hole.outer.points, hole.outer.points[:1]])], _colour(number))
        for number, hole in enumerate(found.holes)
    ]
    return [*sherds, *edges]


def _colour(number: int) -> str:
    return COLOURS[number % len(COLOURS)]


def _paint(found: HolesFound, path: Path) -> None:
    """The vessel from every side on which there is a hole, each hole's edge in its colour with its number."""
    from brep_export.app.pictures import CLAY, Mark, Part, View, draw

    clay = tuple(Part(mesh, CLAY[i % len(CLAY)], smooth=False) for i, mesh in enumerate(found.sherds))
    up = np.array([0.0, 0.0, 1.0]) if found.reading.axis is None else found.reading.axis.direction
    centre = np.concatenate([mesh.vertices for mesh in found.sherds]).mean(axis=0)
    facing = [_facing(hole, centre) for hole in found.holes]
    panels: list[np.ndarray] = []
    for way in facing:
        if len(panels) < MOST_PANELS and all(way @ other < SEEN for other in panels):
            panels.append(way)
    views = []
    for toward in panels or [np.cross(up, np.eye(3)[np.argmin(np.abs(up))])]:
        marks = tuple(
            Mark(hole.outer.points, str(number), _colour(number))
            for number, hole in enumerate(found.holes)
            if facing[number] @ toward > 0.0
        )
        level = abs(toward @ up) < 0.9
        above = up if level else np.cross(toward, np.cross(np.eye(3)[np.argmin(np.abs(toward))], toward))
        tilted = toward + 0.35 * up if level else toward
        shown = ", ".join(mark.text for mark in marks)
        title = f"holes {shown}" if len(marks) > 1 else f"hole {shown}" if marks else "no hole"
        views.append(View(title, clay, _triple(tilted), _triple(above), marks=marks))
    draw(path, views)


def _facing(hole: Hole, centre: np.ndarray) -> np.ndarray:
    """Unit vector along the normal of the plane of a hole's edge, away from the middle of the vessel."""
    around = hole.outer.points - hole.place
    normal = np.linalg.svd(around, full_matrices=False)[2][2]
    away = hole.place - centre
    return normal if normal @ away >= 0.0 else -normal


def _triple(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(c) for c in vector)
    return x, y, z
