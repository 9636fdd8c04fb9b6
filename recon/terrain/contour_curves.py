"""Contours as rows of cubic Bezier segments, which a tiling may split but never bends.

    vertex k       segment k        vertex k + 1
       o---------------->---------------o          segment k starts at vertex `start[k]`, ends at vertex `end[k]`

A contour of the map is one spline with continuous curvature; `span` keeps its parameter length, so that derivatives of
neighbouring segments can be compared: dc/ds = (dc/dt) / span.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.numerics.bernstein import bernstein

__all__ = ["ContourCurves", "segments_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ContourCurves:
    """Segments of all contours, contour by contour, along each contour.

    bezier   (M, 4, 2) control points in plan
    span     (M,) length of the segment in its spline's own parameter
    contour  (M,) number of the contour, not decreasing
    closed   (C,) whether the contour closes
    heights  (C,)
    start, end  (M,) vertex at either end; an open contour has one vertex more than segments
    straight    (M,) whether the segment replaces a kink shorter than anybody sees: the ground is level at its ends
    bound       (C,) whether the tangents at the contour's ends are given, so that its segments there stay curves
    """

    bezier: Floats
    span: Floats
    contour: Ints
    closed: NDArray[np.bool_]
    heights: Floats
    start: Ints
    end: Ints
    straight: NDArray[np.bool_]
    bound: NDArray[np.bool_]

    @property
    def n_vertices(self) -> int:
        return int(self.end.max()) + 1 if len(self.end) else 0

    def vertices(self) -> Floats:
        """(V, 2) the points at which segments meet, and the ends of open contours."""
        points = np.empty((self.n_vertices, 2))
        points[self.end] = self.bezier[:, 3]
        points[self.start] = self.bezier[:, 0]
        return points

    def vertex_contours(self) -> Ints:
        """(V,) contour of every vertex."""
        contour = np.empty(self.n_vertices, dtype=np.int64)
        contour[self.end] = self.contour
        contour[self.start] = self.contour
        return contour

    def vertex_derivatives(self) -> tuple[Floats, Floats]:
        """(V, 2) first and second derivative by the spline's parameter at every vertex."""
        b, h = self.bezier, self.span[:, None]
        first, second = np.empty((2, self.n_vertices, 2))
        first[self.end], second[self.end] = 3 * (b[:, 3] - b[:, 2]) / h, 6 * (b[:, 3] - 2 * b[:, 2] + b[:, 1]) / h**2
        first[self.start], second[self.start] = (
            3 * (b[:, 1] - b[:, 0]) / h,
            6 * (b[:, 2] - 2 * b[:, 1] + b[:, 0]) / h**2,
        )
        return first, second

    def kinks(self) -> NDArray[np.bool_]:
        """(V,) whether a vertex ends a straight segment, so that tangent and curvature may jump there."""
        kinked = np.zeros(self.n_vertices, dtype=bool)
        kinked[self.start[self.straight]] = kinked[self.end[self.straight]] = True
        return kinked

    def may_straighten(self) -> NDArray[np.bool_]:
        """(M,) whether a segment may become its chord: it does not lie at an end whose tangent is given."""
        last = np.r_[self.contour[1:] != self.contour[:-1], True][: len(self.contour)]
        return ~(self.bound[self.contour] & (last | np.roll(last, 1)))

    def straightened(self, chosen: NDArray[np.bool_]) -> "ContourCurves":
        """The same curves with the chosen segments replaced by their chords."""
        bezier = self.bezier.copy()
        share = np.linspace(0.0, 1.0, 4)[:, None]
        bezier[chosen] = (1 - share) * bezier[chosen, :1] + share * bezier[chosen, 3:]
        return replace(self, bezier=bezier, straight=self.straight | chosen)

    def lengths(self) -> Floats:
        """(M,) arc length of every segment, by its polygon through nine points."""
        points = np.einsum("tk,mkd->mtd", bernstein(3, np.linspace(0, 1, 9)), self.bezier)
        return np.linalg.norm(np.diff(points, axis=1), axis=2).sum(axis=1)

    def turning(self) -> Floats:
        """(M,) angle in radians by which the control polygon of every segment turns."""
        legs = np.diff(self.bezier, axis=1)
        cross = legs[:, :-1, 0] * legs[:, 1:, 1] - legs[:, :-1, 1] * legs[:, 1:, 0]
        return np.abs(np.arctan2(cross, np.einsum("mkd,mkd->mk", legs[:, :-1], legs[:, 1:]))).sum(axis=1)

    def split(self, chosen: NDArray[np.bool_]) -> "ContourCurves":
        """The same curves with the chosen segments halved at mid-parameter; vertices are numbered anew."""
        rows = np.repeat(np.arange(len(self.bezier)), 1 + chosen)
        second = np.r_[False, rows[1:] == rows[:-1]]
        first = chosen[rows] & ~second
        bezier = self.bezier[rows].copy()
        halves = np.einsum("jk,mkd->mjd", _HALVING, self.bezier[chosen])
        bezier[first], bezier[second] = halves[:, :4], halves[:, 3:]
        halved = segments_of(
            bezier, np.where(chosen, 0.5, 1.0)[rows] * self.span[rows], self.contour[rows], self.closed, self.heights
        )
        return replace(halved, straight=self.straight[rows], bound=self.bound)


_HALVING = (
    np.array([[8, 0, 0, 0], [4, 4, 0, 0], [2, 4, 2, 0], [1, 3, 3, 1], [0, 2, 4, 2], [0, 0, 4, 4], [0, 0, 0, 8]]) / 8.0
)


def segments_of(
    bezier: Floats, span: Floats, contour: Ints, closed: NDArray[np.bool_], heights: Floats
) -> ContourCurves:
    """Segments with their vertices numbered, contour by contour."""
    last = np.r_[contour[1:] != contour[:-1], True]
    first = np.r_[True, last[:-1]]
    opened = np.cumsum(np.r_[0, (last & ~closed[contour])[:-1]])  # open contours that ended before
    start = np.arange(len(contour)) + opened
    head = start[first][np.cumsum(first) - 1]
    end = np.where(last & closed[contour], head, start + 1)
    none = np.zeros(len(contour), dtype=bool)
    return ContourCurves(bezier, span, contour, closed, heights, start, end, none, np.zeros(len(closed), dtype=bool))
