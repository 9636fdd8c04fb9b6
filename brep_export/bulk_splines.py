"""Control points of many splines fetched from the kernel in its binary form, all at once.

One pole after the other costs a microsecond each and more: seconds for a ground of many patches. `BinTools` writes a
row of surfaces, or of curves, into one buffer, little-endian, each once however often it was added:

    surface  type, rational u v, periodic u v | degrees | poles u v, knots u v | poles | knots u | knots v
    curve    type, rational, periodic         | degree  | poles, knots         | poles | knots
    pole     three numbers, and a weight where it is rational;   knot  a number and its multiplicity
"""

from collections.abc import Iterator, Sequence
from io import BytesIO
from struct import Struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from OCP.BinTools import BinTools_CurveSet, BinTools_SurfaceSet
from OCP.Geom import Geom_BSplineCurve, Geom_BSplineSurface

__all__ = ["SplineRecord", "curve_records", "surface_records"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_SURFACE, _CURVE = Struct("<B4B2H4i"), Struct("<B2BH2i")
_KNOT = np.dtype([("value", "<f8"), ("count", "<i4")])


class SplineRecord(NamedTuple):
    """A polynomial spline that is not periodic.

    degrees, counts  one of a curve, two of a surface: of the poles
    n_knots          different ones, in every direction
    poles            (n, 3), of a surface v running first
    tail             the bytes of the knots: the same for splines over the same knots
    """

    degrees: tuple[int, ...]
    counts: tuple[int, ...]
    n_knots: tuple[int, ...]
    poles: Floats
    tail: bytes

    def knots(self) -> list[tuple[Floats, Ints]]:
        """Values and multiplicities in every direction."""
        rows = np.split(np.frombuffer(self.tail, dtype=_KNOT), np.cumsum(self.n_knots)[:-1])
        return [(row["value"].astype(np.float64), row["count"].astype(np.int64)) for row in rows]


def surface_records(surfaces: Sequence[Geom_BSplineSurface]) -> list[SplineRecord | None]:
    """One of each surface; None for one that is rational or periodic."""
    return _records(BinTools_SurfaceSet(), surfaces, _SURFACE)


def curve_records(curves: Sequence[Geom_BSplineCurve]) -> list[SplineRecord | None]:
    """One of each curve; None for one that is rational or periodic."""
    return _records(BinTools_CurveSet(), curves, _CURVE)


def _records(
    into: BinTools_SurfaceSet | BinTools_CurveSet,
    splines: Sequence[Geom_BSplineSurface] | Sequence[Geom_BSplineCurve],
    head: Struct,
) -> list[SplineRecord | None]:
    slots = [into.Add(spline) for spline in splines]
    buffer = BytesIO()
    into.Write(buffer)
    found = list(_walk(buffer.getvalue(), max(slots, default=0), head))
    return [found[slot - 1] for slot in slots]


def _walk(data: bytes, n: int, head: Struct) -> Iterator[SplineRecord | None]:
    at = data.index(b"\n") + 1
    directions = 2 if head is _SURFACE else 1
    for _ in range(n):
        _, *words = head.unpack_from(data, at)
        rational, periodic = words[:directions], words[directions : 2 * directions]
        degrees, counts, n_knots = (tuple(words[i * directions : (i + 1) * directions]) for i in (2, 3, 4))
        n_poles = counts[0] * counts[-1] if directions == 2 else counts[0]
        at += head.size
        knots = at + n_poles * (32 if any(rational) else 24)
        end = knots + sum(n_knots) * _KNOT.itemsize
        if any(rational) or any(periodic):
            yield None
        else:
            poles = np.frombuffer(data, dtype="<f8", count=3 * n_poles, offset=at).reshape(-1, 3)
            yield SplineRecord(degrees, counts, n_knots, poles, data[knots:end])
        at = end
