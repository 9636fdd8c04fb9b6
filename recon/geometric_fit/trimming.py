"""Where a fitted surface is cut: smooth loops along the borders of the scan, in the plane of the parameters.

The feet of a border's points are a polygon, ragged as the border is. What lies between two borders closer than half an
edge is no longer told apart, and each border becomes one closed curve with control points about an edge apart:

     _/\\_/\\__/\\_              .--------.
    <           >    ----->   (   .--.   )     outer loop counter-clockwise, holes clockwise
     \\_/\\__/\\__/               '--------'

A surface that runs around has no outer loop; its seam is laid where no hole is.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from shapely import (
    LinearRing,
    MultiPolygon,
    Polygon,
    box,
    hausdorff_distance,
    line_interpolate_point,
    make_valid,
    orient_polygons,
    union_all,
)

from recon.errors import NoSurface
from recon.geometric_fit.scan_kind import ScanKind
from recon.geometric_fit.spline_fit import FittedSheet
from recon.geometric_fit.spline_space import SplineSpace
from recon.geometric_fit.tensor_space import TensorSpace
from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.trimmed import TrimLoop

__all__ = ["TrimmedSheet", "end_caps", "trimmed_sheet"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NARROW = 0.25  # of a mean edge: half of what is too narrow to be told apart outside, and a quarter of it inside
CONE = np.array([0.0, 0.0, 1.0, 1.0])  # knots along a cone
FEWEST = 12  # control points of a loop
STEPS = (1.0, 0.5, 0.25)  # of a mean edge, between control points of a loop; shorter where loops would cross


class TrimmedSheet(NamedTuple):
    """A surface and the loops that cut it.

    surface  clamped; where the scan runs around, with a seam
    loops    of a disc its border and then its holes; of others the holes
    off      how far the loops are from the borders of the scan in the plane of the parameters, in its unit of length
    n_lost   holes too narrow to be cut
    """

    surface: BSplineSurface
    loops: tuple[TrimLoop, ...]
    off: float
    n_lost: int


def trimmed_sheet(fit: FittedSheet, *, with_holes: bool = True) -> TrimmedSheet:
    """The surface of a fit with loops along the borders of the scan.

    with_holes  whether the surface is cut out where the scan has holes, or goes on over them
    Raises  NoSurface when there is no place for a seam, or the loops would cross.
    """
    sheet = fit.sheet
    holes = sheet.holes if with_holes else ()
    if sheet.kind is not ScanKind.DISC and not holes:
        return TrimmedSheet(fit.surface, (), 0.0, 0)
    rows = [fit.places[loop] for loop in (*sheet.rims, *holes)]
    if sheet.kind is ScanKind.DISC:
        space, net = fit.space, fit.net
    else:
        rows = [_unwrapped(row, fit.space) for row in rows[len(sheet.rims) :]]
        space, net, rows = _with_free_seam(fit.space, fit.net, rows)
    surface = space.surface(net)
    scale, edge = _scale(surface, np.concatenate(rows)), _mean_edge(fit)
    region = _region([row * scale for row in rows], sheet.kind is ScanKind.DISC, edge, _domain(surface, scale))
    loops, off = _loops(region, edge, scale, sheet.kind is ScanKind.DISC)
    return TrimmedSheet(surface, loops, off, len(rows) - len(loops))


def end_caps(surface: BSplineSurface) -> tuple[BSplineSurface, BSplineSurface]:
    """Cones from both ends of a tube to the middles of its rims; the tube runs around in u."""
    caps = []
    for end in (0, -1):
        rim = surface.control_net[:, end]
        net = np.stack([rim, np.broadcast_to(rim[:-1].mean(axis=0), rim.shape)], axis=1)
        weights = None if surface.weights is None else np.repeat(surface.weights[:, [end]], 2, axis=1)
        caps.append(BSplineSurface(surface.degree_u, 1, surface.knots_u, CONE, net, weights))
    return caps[0], caps[1]


def _unwrapped(row: Floats, space: TensorSpace) -> Floats:
    """A closed row of places with no step over a seam."""
    row = row.copy()
    for k, each in enumerate((space.u, space.v)):
        if each.periodic:
            period = each.breaks[-1] - each.breaks[0]
            steps = np.diff(row[:, k])
            row[1:, k] = row[0, k] + np.cumsum(steps - period * np.round(steps / period))
    return row


def _with_free_seam(space: TensorSpace, net: Floats, rows: list[Floats]) -> tuple[TensorSpace, Floats, list[Floats]]:
    """Space and net with the seams at breaks that no hole covers, and the holes within that domain."""
    spaces = [space.u, space.v]
    for k, each in enumerate(spaces):
        if not each.periodic:
            continue
        period = each.breaks[-1] - each.breaks[0]
        number = _free_break(each, [row[:, k] for row in rows])
        turned = np.moveaxis(net, k, 0)
        spaces[k], rolled = each.rolled(number, turned)
        net = np.moveaxis(rolled, 0, k)
        first = spaces[k].breaks[0]
        shift = [period * np.floor((row[:, k].min() - first) / period) for row in rows]
        rows = [row - np.eye(2)[k] * s for row, s in zip(rows, shift)]
    return TensorSpace(*spaces), np.ascontiguousarray(net), rows


def _free_break(space: SplineSpace, rows: list[Floats]) -> int:
    """Number of the break that is farthest from all holes."""
    period = space.breaks[-1] - space.breaks[0]
    away = np.full(len(space.breaks) - 1, np.inf)
    for row in rows:
        middle, half = 0.5 * (row.max() + row.min()), 0.5 * float(np.ptp(row))
        off = np.abs((space.breaks[:-1] - middle + 0.5 * period) % period - 0.5 * period)
        away = np.minimum(away, off - half)
    best = int(np.argmax(away))
    if away[best] <= 0.0:
        raise NoSurface("the holes of the scan leave no place for a seam around the surface; close them by --close.")
    return best


def _scale(surface: BSplineSurface, uv: Floats) -> Floats:
    """(2,) mean lengths of the surface's derivatives at places."""
    return np.array([np.linalg.norm(surface.derivative(uv, *o), axis=1).mean() for o in ((1, 0), (0, 1))])


def _mean_edge(fit: FittedSheet) -> float:
    """Mean edge of the borders of the scan."""
    rows = [fit.sheet.mesh.vertices[loop] for loop in (*fit.sheet.rims, *fit.sheet.holes)]
    return float(np.concatenate([np.linalg.norm(np.roll(row, -1, axis=0) - row, axis=1) for row in rows]).mean())


def _domain(surface: BSplineSurface, scale: Floats) -> Polygon:
    (u0, u1), (v0, v1) = surface.domain
    return box(u0 * scale[0], v0 * scale[1], u1 * scale[0], v1 * scale[1])


def _region(rows: list[Floats], is_disc: bool, edge: float, domain: Polygon) -> Polygon:
    """What is kept, without necks and slits that are too narrow to be told apart."""
    shapes = [make_valid(Polygon(row)) for row in rows]
    outer = shapes[0].intersection(domain.buffer(-1e-6 * edge)) if is_disc else domain
    holes = union_all(shapes[1:] if is_disc else shapes)
    region = outer.difference(holes).buffer(NARROW * edge).buffer(-3.0 * NARROW * edge).buffer(2.0 * NARROW * edge)
    if not is_disc:
        # the sides of the domain stay straight
        inner = domain.difference(holes.buffer(-NARROW * edge).buffer(2.0 * NARROW * edge).buffer(-NARROW * edge))
        if not isinstance(inner, Polygon) or not inner.exterior.equals(domain.exterior):
            raise NoSurface("a hole of the scan touches its rim; close the holes by --close, or cut them out of it.")
        region = inner
    parts = region.geoms if isinstance(region, MultiPolygon) else [region]
    largest = max(parts, key=lambda part: part.area)
    if largest.is_empty or not isinstance(largest, Polygon):
        raise NoSurface("the scan is too narrow to be cut out of a surface; fit it with --surface loop.")
    return largest


def _loops(region: Polygon, edge: float, scale: Floats, is_disc: bool) -> tuple[tuple[TrimLoop, ...], float]:
    """Smooth loops along the rings of a region, as near as they must be so as not to cross, and how near that is."""
    ordered = orient_polygons(region, exterior_cw=False)
    rings = [*([ordered.exterior] if is_disc else []), *ordered.interiors]
    for share in STEPS:
        fits = [_smooth(ring, share * edge) for ring in rings]
        if _is_sound([curve for curve, _ in fits], is_disc):
            loops = [TrimLoop((BSplineCurve(c.degree, c.knots, c.control_points / scale),)) for c, _ in fits]
            return tuple(loops), max((off for _, off in fits), default=0.0)
    raise NoSurface("the borders of the scan come too close to each other to be cut along; close its holes by --close.")


def _smooth(ring: LinearRing, step: float) -> tuple[BSplineCurve, float]:
    """A closed cubic with control points along a ring, a step apart, and its distance from the ring.

    It turns no more often than its polygon does: a curve through the points might make loops between them.
    """
    number = max(round(ring.length / step), FEWEST)
    control = np.array([p.coords[0] for p in line_interpolate_point(ring, np.arange(number) / number, normalized=True)])
    curve = SplineSpace(3, np.arange(number + 1.0), periodic=True).curve(control)
    return curve, float(hausdorff_distance(ring, LinearRing(curve.point(np.arange(0.0, number, 0.25)))))


def _is_sound(curves: list[BSplineCurve], is_disc: bool) -> bool:
    """Whether no loop crosses itself or another, and holes lie inside."""
    shapes = [Polygon(TrimLoop((curve,)).polygon(4 * len(curve.control_points))) for curve in curves]
    if not all(shape.is_valid for shape in shapes):
        return False
    holes = shapes[1:] if is_disc else shapes
    apart = abs(union_all(holes).area - sum(hole.area for hole in holes)) <= 1e-9 * sum(s.area for s in shapes)
    return apart and (not is_disc or all(shapes[0].contains(hole) for hole in holes))
