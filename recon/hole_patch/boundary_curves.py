"""The four boundary curves of the base patch: one least-squares cubic a section, brought together at the box's edges.

    height ^  .  .-'-.  .          dots: the section; the cubic F(t) = a0 + a1 t + a2 t² + a3 t³ comes
           | .-'       '-.         as four Bezier ordinates, at t = 0, 1/3, 2/3, 1
           +--------------> t

Two neighbouring curves cross the box edge they share at different heights; both are fitted again through the mean.
Where the wall ends before the box does, a cubic would swing out freely: the degree is lowered by what is covered.

Paper  [kinoshita], section 3.2 step 3, equations (6) to (10).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from recon.hole_patch.cutting_planes import Section
from recon.numerics.bernstein import bernstein, degree_elevation

__all__ = ["fit_cubic", "boundary_ordinates"]

Floats = NDArray[np.float64]
FULL_COVERAGE = 0.75
HALF_COVERAGE = 0.4
CLEAR = 0.05
# Corner c of the patch: (side, end of it) twice, end 0 where the side starts.
CORNER_ENDS = (((0, 0), (3, 0)), ((0, 1), (1, 0)), ((1, 1), (2, 1)), ((2, 0), (3, 1)))


def fit_cubic(
    section: Section, *, start: float | None = None, end: float | None = None, degree: int | None = None
) -> Floats:
    """(4,) Bezier ordinates of the least-squares cubic through a section, its end values fixed where they are given.

    degree   of the polynomial, at most 3; by default 3, or less where the section covers too little of the side
    Paper    [kinoshita], section 3.2 step 3; in the Bernstein basis, which is better conditioned.
    """
    degree = _degree_for(section) if degree is None else degree
    fixed = np.array([np.nan if x is None else x for x in (start, *[None] * (degree - 1), end)], dtype=np.float64)
    free = np.isnan(fixed)
    weight = np.sqrt(section.trust)
    rows = bernstein(degree, section.t) * weight[:, None]
    known = rows[:, ~free] @ fixed[~free]
    fixed[free] = np.linalg.lstsq(rows[:, free], section.height * weight - known, rcond=None)[0]
    return np.asarray(degree_elevation(degree, 3) @ fixed)


def boundary_ordinates(sections: Sequence[Section]) -> Floats:
    """(4, 4) Bezier ordinates of the four boundary curves, sides 0 to 3, each in its side's direction.

    Promises  neighbouring curves have the same height at the corner they share.
    """
    first = np.array([fit_cubic(section) for section in sections])
    corners = [_meeting(first, sections, ends) for ends in CORNER_ENDS]
    fixed = np.zeros((4, 2))
    for height, ends in zip(corners, CORNER_ENDS):
        for side, end in ends:
            fixed[side, end] = height
    return np.array([fit_cubic(s, start=a, end=b) for s, (a, b) in zip(sections, fixed)])


def _degree_for(section: Section) -> int:
    coverage = section.coverage()
    return 3 if coverage >= FULL_COVERAGE else 2 if coverage >= HALF_COVERAGE else 1


def _meeting(ordinates: Floats, sections: Sequence[Section], ends: Sequence[tuple[int, int]]) -> float:
    """Height at a corner: the mean of both crossings, the less of a curve the farther it was extrapolated."""
    heights = [ordinates[side, -end] for side, end in ends]
    gaps = [np.abs(sections[side].t - end).min(initial=1.0) for side, end in ends]
    weights = [1.0 / max(gap, CLEAR) ** 2 for gap in gaps]
    return float(np.average(heights, weights=weights))
