"""The JSON object that every command answers with, and the short summary of it for a person.

Keys are a contract: new ones may be added, none is renamed.
"""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from recon.version import __version__

__all__ = ["kernel_of_all", "peak_memory_mb", "refusal", "result", "statistics", "summary"]

_PHASES = ("read", "reconstruct", "brep", "check", "write")


def result(
    command: str,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    reasons: Sequence[str],
    kernel: Mapping[str, Any],
    seconds: Mapping[str, float],
    error: Mapping[str, Any] | None = None,
    room: Mapping[str, Any] | None = None,
    notes: Sequence[str] = (),
) -> dict[str, Any]:
    """Put the figures of one run together; the verdict is `pass` when there is no reason against it."""
    times = {phase: round(seconds.get(phase, 0.0), 4) for phase in _PHASES}
    return {
        "command": command,
        "version": __version__,
        "inputs": list(inputs),
        "outputs": list(outputs),
        "verdict": "refused" if reasons else "pass",
        "reasons": list(reasons),
        "kernel": dict(kernel),
        "error": None if error is None else dict(error),
        "room": dict(room or {}),
        "notes": list(notes),
        "seconds": times | {"total": round(seconds.get("total", sum(times.values())), 4)},
        "peak_memory_mb": peak_memory_mb(),
    }


def refusal(command: str, inputs: Sequence[str], reasons: Sequence[str], *, cause: str = "") -> dict[str, Any]:
    """The object of a run that ended before there was anything to measure; `cause` as in an Outcome."""
    return result(command, inputs=inputs, outputs=(), reasons=reasons, kernel={}, seconds={}) | {"cause": cause}


def kernel_of_all(kernels: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The `kernel` object of several shapes: sums of counts and sizes, the box around all, the worst of the rest."""
    if len(kernels) == 1:
        return dict(kernels[0])
    found: dict[str, Any] = {"type": "compound"}
    for key in ("valid", "closed"):
        found[key] = all(kernel[key] for kernel in kernels)
    for key in ("solids", "shells", "faces", "edges", "free_edges", "volume", "area", "self_intersections"):
        found[key] = sum(kernel[key] or 0 for kernel in kernels)
    boxes = [kernel["bounding_box"] for kernel in kernels if kernel["bounding_box"]]
    found["bounding_box"] = [[pick(c) for c in zip(*side)] for pick, side in zip((min, max), zip(*boxes))] or None
    for key in ("max_tolerance", "max_gap", "max_edge_angle_deg"):
        found[key] = max((kernel[key] for kernel in kernels if kernel[key] is not None), default=None)
    read = [kernel["read_back"] for kernel in kernels if kernel["read_back"]]
    changes = [entry["volume_change"] for entry in read if entry["volume_change"] is not None]
    worst = {"same": all(entry["same"] for entry in read), "volume_change": max(changes, key=abs, default=None)}
    return found | {"read_back": worst if read else None, "gate": _gate_of_all([kernel["gate"] for kernel in kernels])}


def _gate_of_all(gates: Sequence[Sequence[Mapping[str, Any]]]) -> list[dict[str, Any]]:
    """Every line, passed where all shapes passed it; None where it was drawn on none."""
    drawn = [[entry["passed"] for entry in column if entry["passed"] is not None] for column in zip(*gates)]
    return [{"line": entry["line"], "passed": all(d) if d else None} for entry, d in zip(gates[0], drawn)]


def statistics(distances: Any, *, unit: str, against: str) -> dict[str, Any]:
    """Mean, root mean square, 95th percentile and maximum of absolute distances."""
    import numpy as np

    d = np.abs(np.asarray(distances, dtype=np.float64))
    return {
        "mean": float(d.mean()),
        "rms": float(np.sqrt((d * d).mean())),
        "p95": float(np.quantile(d, 0.95)),
        "max": float(d.max()),
        "unit": unit,
        "against": against,
    }


def peak_memory_mb() -> float | None:
    """Largest resident memory of this process so far, and of the largest that it started and outlived, in MiB.

    None where the system does not tell.
    """
    if sys.platform == "win32":
        return None
    import resource

    peak = sum(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return round(peak / (2**20 if sys.platform == "darwin" else 2**10), 1)


def summary(answer: Mapping[str, Any]) -> str:
    """A few lines for a person: the verdict, what the shape is, how far off it is, where it was written."""
    lines = [f"{answer['command']}: {answer['verdict']}"]
    lines += [f"  reason    {reason}" for reason in answer["reasons"]]
    if answer["kernel"] and answer["kernel"]["type"] is not None:
        lines.append(f"  shape     {_shape_line(answer['kernel'])}")
    if answer["error"]:
        e = answer["error"]
        lines.append(f"  error     mean {e['mean']:.3f}, max {e['max']:.3f} {e['unit']} against {e['against']}")
    lines += [f"  {key:<9} {_figures(value)}" for key, value in answer["room"].items() if _is_short(value)]
    lines += [f"  wrote     {path}" for path in answer["outputs"]]
    lines.append(f"  time      {answer['seconds']['total']:.1f} s")
    return "\n".join(lines)


def _is_short(value: Any) -> bool:
    """Whether a figure fits a line: lists of objects are for the JSON alone."""
    return value not in (None, []) and not (isinstance(value, list) and isinstance(value[0], Mapping))


def _shape_line(kernel: Mapping[str, Any]) -> str:
    state = f"{'closed' if kernel['closed'] else 'open'}, {'valid' if kernel['valid'] else 'NOT valid'}"
    size = f"volume {kernel['volume']:.6g}, " if kernel["volume"] is not None else ""
    return (
        f"{state} {kernel['type']}; faces {kernel['faces']}, edges {kernel['edges']}; {size}area {kernel['area']:.6g}"
    )


def _figures(value: Any) -> str:
    if isinstance(value, list):
        return " ".join(_figures(item) for item in value)
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {_figures(v)}" for k, v in value.items() if v is not None)
    return f"{value:.4g}" if isinstance(value, float) else str(value)
