"""The job behind `recon demo`: a vessel that the package makes, breaks and mends, so that the truth is known."""

from collections.abc import Mapping
from typing import Any

import manifold3d
import numpy as np

from brep_export.app.patch_job import TOLERANCE, Answer, kernel_piece, patch_answer
from brep_export.app.workshop import Bench
from brep_export.faces import trimmed_face
from brep_export.triangulation import triangulate
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.pipeline import MissingPiece, patch_readings
from recon.hole_patch.sample_vessel import BrokenVessel, VesselOptions, broken_vessel
from recon.numerics.distance import closest_points

__all__ = ["common_over_union", "demo"]


def demo(request: Mapping[str, Any], bench: Bench) -> Answer:
    """Make, break, mend, and compare with the sherd that was left out."""
    with bench.phase("read", "making a vessel and breaking it"):
        vessel = broken_vessel(VesselOptions(seed=request["seed"]))
    pieces = patch_readings(vessel.sherds, doing=bench.doing)
    return patch_answer("demo", pieces, request, bench, room=lambda piece: {"truth": _against_truth(piece, vessel)})


def _against_truth(piece: MissingPiece, vessel: BrokenVessel) -> dict[str, Any]:
    """How near the piece came to the lost sherd: volume in common, and the outer face to the vessel without relief."""
    shape, _ = kernel_piece(piece)
    made = triangulate(shape, 0.02).mesh
    outer = triangulate(trimmed_face(piece.outer.trimmed, TOLERANCE), 0.02).mesh
    away = closest_points(outer.vertices, vessel.plain.vertices, vessel.plain.face_vertices).distances
    return {
        "volume_mm3": vessel.lost.volume(),
        "common_over_union": common_over_union(made, vessel.lost),
        "outer_wall_mm": {"mean": float(away.mean()), "max": float(away.max())},
    }


def common_over_union(a: TriangleMesh, b: TriangleMesh) -> float:
    """Volume of the intersection of two closed meshes over that of their union."""
    x, y = (
        manifold3d.Manifold(manifold3d.Mesh64(m.vertices.copy(), m.face_vertices.astype(np.uint64))) for m in (a, b)
    )
    return float((x ^ y).volume() / (x + y).volume())
