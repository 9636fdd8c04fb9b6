"""How near two places of a drawing must be to be one, when nobody says.

Every vertex of a solid shows its x in the front view and in the top view, its y in top and side, its z in front and
side. A coordinate that only one of its two views has is off by a draughtsman's error, or a file's last digit:

    front x   10.000     25.010      37.5            x: 10 is shared; 25 is, once 0.01 apart is near enough; 37.5 is not
    top x     10.000     25.000

The finest of a few lengths is taken at which about as many coordinates are shared as at any of them.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from recon.geometry.views import ThreeViews

__all__ = ["shared_coordinates", "snap_lengths", "unequal_spans"]

Floats = NDArray[np.float64]

LEVELS = tuple(3e-6 * 2.0**k for k in range(9))  # of the drawing's size; its least features may be a few errors long
SPARE = 0.1  # share of the coordinates; too fine a length finds no solid, and the next one is tried


def snap_lengths(drawing: ThreeViews) -> list[float]:
    """Lengths to try, the most likely first, then coarser ones."""
    lengths = [level * drawing.extent() for level in LEVELS]
    shares = [shared_coordinates(drawing, length) for length in lengths]
    first = next(k for k, share in enumerate(shares) if share >= max(shares) - SPARE)
    return lengths[first:]


def shared_coordinates(drawing: ThreeViews, snap: float) -> float:
    """Share of the ends of lines whose coordinates lie within `snap` of one in the other view that shows them."""
    near = total = 0
    for axis in range(3):
        one, other = (v.segments[:, :, p.axes.index(axis)].ravel() for p, v in drawing if axis in p.axes)
        for wanted, values in ((one, np.sort(other)), (other, np.sort(one))):
            at = np.clip(np.searchsorted(values, wanted), 1, len(values) - 1)
            away = np.minimum(np.abs(values[at] - wanted), np.abs(values[at - 1] - wanted))
            near += int((away <= snap).sum())
            total += len(wanted)
    return near / total


def unequal_spans(drawing: ThreeViews, snap: float) -> Iterator[str]:
    """In words, each axis along which the two views that show it begin or end more than two snaps apart."""
    for axis, name in enumerate("xyz"):
        spans = []
        for projection, view in drawing:
            if axis in projection.axes:
                values = view.segments[:, :, projection.axes.index(axis)]
                spans.append((projection.name, float(values.min()), float(values.max())))
        (one, low, high), (other, least, most) = spans
        if max(abs(low - least), abs(high - most)) > 2 * snap:
            yield (
                f"{name} runs from {low:.6g} to {high:.6g} in the {one} view,"
                f" from {least:.6g} to {most:.6g} in the {other} view"
            )
