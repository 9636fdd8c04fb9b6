"""What the answer of `recon patch` says of a piece in figures: how it was made, how far to trust it, how it fits in."""

from typing import Any

import numpy as np

from recon.hole_patch.confidence import ASSUMED, BOUND, SHARE, Confidence
from recon.hole_patch.pipeline import MissingPiece
from recon.hole_patch.placing import Placing
from recon.hole_patch.thickness import Thickness

__all__ = ["piece_figures", "placing_figures", "trust_figures"]


def piece_figures(piece: MissingPiece, thickness: Thickness | None) -> dict[str, Any]:
    """How it was made, how it meets the hole's edge, and how thick it is."""
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


def trust_figures(trust: Confidence, volume_off: float | None) -> dict[str, Any]:
    """By how much the walls of the piece may be off, over the hole, and its volume."""
    sigma = trust.over_walls()
    return {
        "confidence": {
            "expected_error_mm": {
                "median": float(np.median(sigma)),
                "p95": float(np.quantile(sigma, 0.95)),
                "max": float(sigma.max()),
            },
            "expected_volume_error": volume_off,
            "share": SHARE,
            "within": BOUND,
            "sherds_left_out": trust.outer.n_left_out,
            "assumed": ASSUMED,
        }
    }


def placing_figures(placing: Placing) -> dict[str, Any]:
    """Sherds are named by their number among those given, or, where a file held several, among all of them."""
    gaps = [neighbour.gap_mm for neighbour in placing.neighbours]
    overlaps = [n.overlap_share for n in placing.neighbours if n.overlap_share is not None]
    way = placing.insert_direction
    return {
        "gap": {
            "min": min(gaps, default=None),
            "usual": placing.usual_gap_mm,
            "overlap": sum(overlaps) if overlaps else None,
            "unit": "mm, share",
        },
        "neighbours": [
            {
                "sherd": n.sherd,
                "gap": {"min": n.gap_mm, "usual": n.usual_gap_mm},
                "overlap": {"mm3": n.overlap_mm3, "share": n.overlap_share},
                "holds": n.sherd in placing.held_by,
            }
            for n in placing.neighbours
        ],
        "insert_direction": None if way is None else [float(x) for x in way],
        "undercut_mm": placing.undercut_mm,
        "held_share": placing.held_share,
        "tolerance_mm": placing.tolerance_mm,
        "collision_free": placing.collision_free,
    }
