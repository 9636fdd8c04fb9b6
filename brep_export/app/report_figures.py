"""The figures of a report in words: the three answers at its head, and rows of names, values and units.

Light on purpose: the front desk imports it.
"""

from collections.abc import Iterator, Mapping
from typing import Any

__all__ = ["answers", "figure", "flat"]

# units of figures whose names say them not; {} stands for the shape's unit of length
OF_THE_SHAPE = {
    "volume": "{}³",
    "area": "{}²",
    "bounding_box": "{}",
    "max_tolerance": "{}",
    "max_gap": "{}",
    "mean": "{}",
    "rms": "{}",
    "p95": "{}",
    "max": "{}",
    "min": "{}",
    "spacing": "{}",
    "tolerance": "{}",
}
ENDINGS = {
    "_mm3": "mm³",
    "_mm": "mm",
    "_deg": "°",
    "_percent": "%",
    "_voxels": "voxels",
    "_mb": "MB",
    "_in_edges": "mean edges",
    "_s": "s",
}
EXACT = "nothing is off: drawn again, it gives the drawing, line by line"
UNMEASURED = "nothing was measured beside it"


def answers(result: Mapping[str, Any], unit: str) -> Iterator[tuple[str, str, str]]:
    """What a user asks first, each with its answer and whether that is yes, no or neither."""
    kernel = result["kernel"]
    if kernel.get("type") is not None:
        yield "Is it closed?", *_closed(kernel)
    far = _far_off(result)
    if far:
        yield "How far off is it?", far, "known"
    if kernel.get("type") is not None:
        yield "Can I print it?", *_printable(kernel, result["verdict"] == "pass", unit)


def _closed(kernel: Mapping[str, Any]) -> tuple[str, str]:
    if kernel["type"] == "edge":
        return ("yes, a closed curve", "yes") if kernel["closed"] else ("no, an open curve", "known")
    if kernel["closed"]:
        return f"yes: {_counted(kernel['solids'], 'closed solid')}, {_counted(kernel['faces'], 'face')}", "yes"
    free = kernel["free_edges"]
    if not free:
        return "no: see what is broken in the gate", "no"
    return f"no: {_counted(free, 'free edge')}, in red in the view", "no"


def _far_off(result: Mapping[str, Any]) -> str:
    error = result["error"]
    if error:
        unit = error["unit"]
        return f"{_off(error, unit)}, against {error['against']}"
    contours = result["room"].get("contour_error")
    if contours:
        return (
            f"{figure(contours['mean'])} m on average, {figure(contours['max'])} m at most, from the contours, in plan"
        )
    if not result["kernel"]:
        return ""
    return EXACT if result["command"] == "views" and result["verdict"] == "pass" else UNMEASURED


def _off(error: Mapping[str, Any], unit: str) -> str:
    return f"{error['mean']:.2g} {unit} on average, {error['max']:.2g} {unit} at most"


def _printable(kernel: Mapping[str, Any], passed: bool, unit: str) -> tuple[str, str]:
    if kernel["type"] == "edge":
        return "no: a curve has no body", "known"
    if not (kernel["closed"] and kernel["solids"]):
        return "no: it has no closed body", "no"
    if not passed:
        return "no: the gate refused it, see the reasons", "no"
    return f"yes{_size(kernel['bounding_box'], unit)}", "yes"


def _size(box: Any, unit: str) -> str:
    if not box:
        return ""
    return ": " + " × ".join(f"{high - low:.3g}" for low, high in zip(*box)) + f" {unit}"


def _counted(n: int, what: str) -> str:
    return f"{n} {what}{'' if n == 1 else 's'}"


def flat(figures: Mapping[str, Any], unit: str, above: str = "") -> Iterator[tuple[str, Any, str]]:
    """Rows of a nested object: name, value, unit; keys are joined by dots; lists of objects are numbered.

    unit  of lengths; an object that has a `unit` of its own, and one alone, goes by that
    """
    own = str(figures.get("unit", unit))
    unit = own if "," not in own else ""
    for key, value in figures.items():
        if key == "unit" and unit:
            continue
        if isinstance(value, Mapping):
            yield from flat(value, unit, f"{above}{_spoken(key)}. ")
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            yield from flat({str(i): entry for i, entry in enumerate(value)}, unit, f"{above}{_spoken(key)} ")
        elif value is not None:
            yield f"{above}{_spoken(key)}", value, _unit(key, value, unit)


def _spoken(key: str) -> str:
    ending = next((ending for ending in ENDINGS if key.endswith(ending)), "")
    return key.removesuffix(ending).replace("_", " ")


def _unit(key: str, value: Any, unit: str) -> str:
    if isinstance(value, bool | str):
        return ""
    named = next((ENDINGS[ending] for ending in ENDINGS if key.endswith(ending)), None)
    return named if named is not None else OF_THE_SHAPE.get(key, "").format(unit)


def figure(value: Any) -> str:
    """A value as text."""
    if isinstance(value, list | tuple):
        return ", ".join(figure(entry) for entry in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
