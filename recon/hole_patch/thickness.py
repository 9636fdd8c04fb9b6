"""How thick a piece is, and its inner wall where only the outer one is known: that one, moved inward.

    κ       principal curvature; the offset by h folds where 1 - h κ <= 0

Paper  [docarmo1976], parallel surfaces.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline, make_lsq_spline

from recon.errors import BadOption, NoWall
from recon.geometry.bspline import BSplineSurface
from recon.geometry.trimmed import TrimmedSurface
from recon.hole_patch.sheet import Sheet
from recon.numerics.bspline_basis import greville, uniform_knots
from recon.numerics.foot_points import foot_points
from recon.numerics.polygons import within

__all__ = ["Thickness", "check_apart", "offset_sheet", "piece_thickness"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SAFE = 0.05  # least share of its width that the offset wall must keep everywhere
ROUNDED = 0.35  # of the thickness: how far a sharp bend may be rounded before it is moved


@dataclass(frozen=True, eq=False)
class Thickness:
    """Thickness of a piece in millimetres.

    places  (m, 3) points of the outer wall, evenly spread
    depths  (m,) distance of each to its foot point on the inner wall
    """

    places: Floats
    depths: Floats

    @property
    def least(self) -> float:
        return float(self.depths.min())

    @property
    def mean(self) -> float:
        return float(self.depths.mean())

    @property
    def greatest(self) -> float:
        return float(self.depths.max())

    def thinner_than(self, limit: float) -> tuple[float, Floats]:
        """Share of the piece that is thinner than a length, and the (3,) place where it is thinnest."""
        return float((self.depths < limit).mean()), np.asarray(self.places[self.depths.argmin()])


def offset_sheet(outer: Sheet, thickness_mm: float) -> Sheet:
    """The inner wall of a piece of which only the outer wall is known: the outer one moved inward along its normal.

    What the outer face gave way to at the edge, relief and chips, is no part of the inner wall: where the sheet keeps a
    smoother face on the same parameters, that one is moved. Where a sharp bend would fold the moved face, the face is
    rounded first, by at most `ROUNDED` of the thickness.
    Promises  the same parameters, the same loop in them, normals to the same side; `edge_distance` is empty, since no
              edge was measured; the notes say so, and by how much the face was rounded.
    Raises    BadOption when the thickness is not positive; NoWall when the wall is curved too sharply for it.
    """
    if not thickness_mm > 0.0:
        raise BadOption("thickness", f"must be positive, not {thickness_mm} mm")
    surface = outer.base if outer.base is not None and outer.box_angle_deg is None else outer.trimmed.surface
    uv = _places(outer.trimmed.loops[0].polygon(), 60)
    rounded = _rounded_enough(surface, uv, thickness_mm)
    notes = [f"The inner wall was not measured: it is the outer one moved inward by {thickness_mm:g} mm."]
    if rounded is not surface:
        change = float(np.linalg.norm(rounded.point(uv) - surface.point(uv), axis=1).max())
        notes.append(f"The inner wall was rounded by up to {change:.2f} mm at a bend sharper than the wall is thick.")
    moved = TrimmedSurface(_parallel(rounded, thickness_mm), outer.trimmed.loops)
    return Sheet(moved, np.zeros(0), 0, 0, notes=tuple(notes))


def piece_thickness(outer: Sheet, inner: Sheet) -> Thickness:
    """Thickness of the piece between two sheets, measured on a grid of points of the outer one within its loop."""
    return Thickness(*_depths(outer, inner))


def check_apart(outer: Sheet, inner: Sheet) -> None:
    """Raises  NoWall when the inner sheet does not lie inside the outer one everywhere."""
    points, depth = _depths(outer, inner)
    if depth.min() <= 0.0:
        x, y, z = points[int(depth.argmin())]
        raise NoWall(
            f"The inner wall comes out through the outer one by {-depth.min():.2f} mm near ({x:.1f}, {y:.1f}, {z:.1f}):"
            " check which walls the sherds' faces were taken for, or give a thickness."
        )


def _depths(outer: Sheet, inner: Sheet) -> tuple[Floats, Floats]:
    """(m, 3) points of the outer sheet within its loop, and (m,) how deep under them the inner sheet lies."""
    surface = outer.trimmed.surface
    uv = _places(outer.trimmed.loops[0].polygon(), 26)
    points = surface.point(uv)
    foot = foot_points(inner.trimmed.surface, points)
    # where the fracture slants, the outer sheet reaches beyond the inner one: there the border says nothing about depth
    low, high = np.array(inner.trimmed.surface.domain).T
    covered = ((foot > low) & (foot < high)).all(axis=1)
    if not covered.any():
        raise NoWall("The inner wall lies nowhere under the outer one: the holes found in both walls do not match.")
    points, under = points[covered], inner.trimmed.surface.point(foot[covered])
    # by the inner wall's normal: the outer one faces any way on a foot ring
    side = np.sign(np.einsum("ij,ij->i", points - under, inner.trimmed.surface.normal(foot[covered])))
    return points, side * np.linalg.norm(points - under, axis=1)


def _places(polygon: Floats, n: int) -> Floats:
    """(m, 2) points of an n x n grid within a closed polygon, and points on it."""
    steps = np.linspace(polygon.min(axis=0), polygon.max(axis=0), n + 2)[1:-1]
    grid = np.stack(np.meshgrid(*steps.T, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.concatenate([grid[within(polygon, grid)], polygon[:: max(1, len(polygon) // (4 * n))]])


def _rounded_enough(surface: BSplineSurface, uv: Floats, thickness: float) -> BSplineSurface:
    """The surface itself where its offset does not fold, else the least coarse fit to it whose offset does not.

    A parallel surface keeps 1 - h κ of its width in each principal direction.
    """
    curvature = _greatest_curvature(surface, uv)
    rounded = surface
    spans = np.array(surface.control_net.shape[:2]) - [surface.degree_u, surface.degree_v]
    while 1.0 - thickness * _greatest_curvature(rounded, uv).max() < SAFE:
        spans = (2 * spans) // 3
        if spans.max() < 2:
            break
        rounded = _coarser(surface, np.maximum(spans, 1))
        if np.linalg.norm(rounded.point(uv) - surface.point(uv), axis=1).max() > ROUNDED * thickness:
            break
    else:
        return rounded
    x, y, z = surface.point(uv[[int(curvature.argmax())]])[0]
    raise NoWall(
        f"A wall {thickness:g} mm thick would fold near ({x:.1f}, {y:.1f}, {z:.1f}), where the outer wall is curved"
        f" with a radius of {1.0 / curvature.max():.2f} mm: give a smaller thickness, or the sherds' inner walls."
    )


def _coarser(surface: BSplineSurface, spans: Ints) -> BSplineSurface:
    """Least squares with fewer knots, over the same parameters."""
    (u0, u1), (v0, v1) = surface.domain
    u, v = np.linspace(u0, u1, 129), np.linspace(v0, v1, 129)
    knots_u, knots_v = uniform_knots(spans[0] + 3, 3, u0, u1), uniform_knots(spans[1] + 3, 3, v0, v1)
    rows = make_lsq_spline(u, surface.grid(u, v), knots_u, k=3).c
    net = make_lsq_spline(v, rows.transpose(1, 0, 2), knots_v, k=3).c.transpose(1, 0, 2)
    return BSplineSurface(3, 3, knots_u, knots_v, net)


def _parallel(surface: BSplineSurface, thickness: float) -> BSplineSurface:
    """Interpolates the moved points at the products of the surface's Greville abscissae."""
    degrees, knots = (surface.degree_u, surface.degree_v), (surface.knots_u, surface.knots_v)
    # the mean of equal knots may round to a value beyond them, which the interpolation refuses
    u, v = (np.clip(greville(t, p), t[0], t[-1]) for t, p in zip(knots, degrees))
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    moved = (surface.point(uv) - thickness * surface.normal(uv)).reshape(len(u), len(v), 3)
    rows = make_interp_spline(u, moved, k=degrees[0], t=knots[0]).c
    net = make_interp_spline(v, rows.transpose(1, 0, 2), k=degrees[1], t=knots[1]).c.transpose(1, 0, 2)
    return BSplineSurface(*degrees, *knots, net)


def _greatest_curvature(surface: BSplineSurface, uv: Floats) -> Floats:
    """(m,) the greater principal curvature, positive where the surface bends away from its normal, as a ball does."""
    su, sv = surface.derivative(uv, 1, 0), surface.derivative(uv, 0, 1)
    normal = surface.normal(uv)
    e, f, g = (np.einsum("ij,ij->i", a, b) for a, b in ((su, su), (su, sv), (sv, sv)))
    uu, uw, ww = (-np.einsum("ij,ij->i", surface.derivative(uv, *order), normal) for order in ((2, 0), (1, 1), (0, 2)))
    area = e * g - f * f
    mean, gauss = (e * ww - 2 * f * uw + g * uu) / (2 * area), (uu * ww - uw * uw) / area
    return np.asarray(mean + np.sqrt(np.maximum(mean**2 - gauss, 0.0)))
