"""All splines of one degree over the same breaks, open or periodic: rows of weights, more breaks, the curve itself.

open      b_0 = first, b_m = last, clamped: the first and last control points lie on the curve
periodic  b_m is b_0 again, one period later; m control points, and the basis functions run around

breaks    (m + 1,) increasing
rows      sparse matrices that map control points to points or derivatives
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import make_interp_spline
from scipy.sparse.linalg import splu

from recon.geometry.bspline import BSplineCurve
from recon.numerics.bspline_basis import basis_matrix, clamped_knots, greville

__all__ = ["SplineSpace"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

EVENINGS = 4  # times that the size of each span becomes more like those beside it


@dataclass(frozen=True, eq=False)
class SplineSpace:
    """Splines with simple inner knots at the breaks; a periodic one needs more breaks than its degree."""

    degree: int
    breaks: Floats
    periodic: bool = False

    @property
    def n_control(self) -> int:
        """Number of control points."""
        return len(self.breaks) - 1 + (0 if self.periodic else self.degree)

    @property
    def knots(self) -> Floats:
        """Knot vector; of a periodic space it goes on by `degree` breaks on either side."""
        if not self.periodic:
            return clamped_knots(self.breaks, self.degree)
        period = self.breaks[-1] - self.breaks[0]
        inner, p = self.breaks[:-1], self.degree
        return np.concatenate([inner[len(inner) - p :] - period, self.breaks, inner[1 : p + 1] + period])

    def rows(self, t: Floats, derivative: int = 0) -> sparse.csr_array:
        """(m, n_control) weights at parameters (m,); those of an open space are clamped to it, others run around."""
        if not self.periodic:
            return basis_matrix(self.knots, self.degree, t, derivative)
        return self._around(basis_matrix(self.knots, self.degree, self.within(t), derivative))

    def _around(self, rows: sparse.csr_array) -> sparse.csr_array:
        """The last `degree` basis functions are the first ones again."""
        n = self.n_control
        around = np.arange(rows.shape[1])
        fold = sparse.csr_array((np.ones(len(around)), (around, around % n)), shape=(len(around), n))
        return sparse.csr_array(rows @ fold)

    def within(self, t: Floats) -> Floats:
        """Parameters brought into the range of the breaks."""
        first, last = self.breaks[0], self.breaks[-1]
        return first + np.mod(t - first, last - first) if self.periodic else np.clip(t, first, last)

    def span(self, t: Floats) -> Ints:
        """(m,) number of the span in which each parameter lies."""
        return np.clip(np.searchsorted(self.breaks, self.within(t), side="right") - 1, 0, len(self.breaks) - 2)

    def abscissae(self) -> Floats:
        """(n_control,) Greville abscissae: a parameter for every control point, at which curves interpolate."""
        if not self.periodic:
            return np.clip(greville(self.knots, self.degree), self.breaks[0], self.breaks[-1])
        return self.within(greville(self.knots, self.degree)[: self.n_control])

    def with_breaks(self, more: Floats, control: Floats) -> tuple["SplineSpace", Floats]:
        """The space with more breaks, and the control points there of the same curve."""
        finer = SplineSpace(self.degree, np.unique(np.concatenate([self.breaks, more])), self.periodic)
        return finer, finer.interpolated(self.rows(finer.abscissae()) @ control)

    def interpolated(self, values: Floats) -> Floats:
        """(n_control, d) control points of the curve that takes the values at the abscissae."""
        return np.asarray(splu(sparse.csc_array(self.rows(self.abscissae()))).solve(np.asarray(values)))

    def curve(self, control: Floats) -> BSplineCurve:
        """The clamped B-spline curve of control points (n_control, d); a periodic one begins and ends at its seam."""
        return BSplineCurve(self.degree, clamped_knots(self.breaks, self.degree), self.clamped(control))

    def clamped(self, control: Floats) -> Floats:
        """(m, d) control points over a clamped knot vector; those of a periodic space begin and end at its seam."""
        if not self.periodic:
            return control
        knots = clamped_knots(self.breaks, self.degree)
        at = np.clip(greville(knots, self.degree), knots[0], knots[-1])
        clamped = make_interp_spline(at, self.rows(at) @ control, k=self.degree, t=knots).c
        clamped[-1] = clamped[0]
        return np.asarray(clamped)

    def evened(self) -> "SplineSpace":
        """The space with breaks moved so that spans grow and shrink from one to the next by little."""
        sizes = np.log(np.diff(self.breaks))
        for _ in range(EVENINGS):
            wide = np.pad(sizes, 1, mode="wrap" if self.periodic else "edge")
            sizes = 0.25 * wide[:-2] + 0.5 * wide[1:-1] + 0.25 * wide[2:]
        length = self.breaks[-1] - self.breaks[0]
        inner = np.cumsum(np.exp(sizes))[:-1] * length / np.exp(sizes).sum()
        return SplineSpace(
            self.degree, np.concatenate([self.breaks[:1], self.breaks[0] + inner, self.breaks[-1:]]), self.periodic
        )

    def rolled(self, number: int, control: Floats) -> tuple["SplineSpace", Floats]:
        """A periodic space with its seam at another of its breaks, and the control points there of the same curve."""
        period = self.breaks[-1] - self.breaks[0]
        breaks = np.concatenate([self.breaks[number:-1], self.breaks[: number + 1] + period])
        return SplineSpace(self.degree, breaks, True), np.roll(control, -number, axis=0)
