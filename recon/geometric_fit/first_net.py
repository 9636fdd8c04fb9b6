"""The net that the fit of a spline surface starts from: coarse through the unrolled points, then finer.

Paper  [maekawa2009], step 1; the rest is ours.
"""

import numpy as np
from numpy.typing import NDArray

from recon.geometric_fit.net_guards import NetEnergy, NetGuards
from recon.geometric_fit.scan_data import ScanData
from recon.geometric_fit.scan_kind import ScanKind
from recon.geometric_fit.spline_options import SplineOptions
from recon.geometric_fit.spline_space import SplineSpace
from recon.geometric_fit.tangent_distance import Metric, tangent_distance_move
from recon.geometric_fit.tensor_space import TensorSpace, homogeneous, net_rows
from recon.geometric_fit.unrolling import Unrolled

__all__ = ["first_net", "usual_stiffness"]

Floats = NDArray[np.float64]

COARSEST = 8  # spans of the first net at most, in each direction
FAIRNESS = 1e-3  # weight of the net's energy, as a share of the data's
STIFFENING, STIFFENINGS = 2.0, 10  # before the first round: times stiffer, and how often at most


def first_net(
    scan: ScanData, uv: Floats, count: int, flat: Unrolled, options: SplineOptions
) -> tuple[TensorSpace, Floats]:
    """A coarse net through the points at their places, made finer until it has the number to start with.

    uv     (n, 2) places of the points
    count  control points that it may have
    """
    spaces = [_equal_spans(_shape(count, flat.sides, options.least_side), flat.sheet.kind, options.degree)]
    while max(len(s.breaks) - 1 for s in (spaces[0].u, spaces[0].v)) > COARSEST:
        coarser = tuple(max(-(-n // 2), options.least_side) for n in spaces[0].shape)
        spaces.insert(0, _equal_spans(coarser, flat.sheet.kind, options.degree))
    net = np.zeros((*spaces[0].shape, 4))
    net[..., 3] = 1.0
    for before, space in zip([spaces[0], *spaces], spaces):
        net = before.changed(space, net)
        net[..., 3] = 1.0
        net = _interpolating(scan, uv, space, net, np.full(space.n_control, usual_stiffness(space, scan)))
    return spaces[-1], _stiffened(scan, uv, spaces[-1], net)


def usual_stiffness(space: TensorSpace, scan: ScanData) -> float:
    """Of the net at a control point where nothing folds."""
    return FAIRNESS * scan.n_measured / space.n_control


def _stiffened(scan: ScanData, uv: Floats, space: TensorSpace, net: Floats) -> Floats:
    """The net stiffer where it folds: smoothing it there would draw in whatever stands out of the scan."""
    guards, stiffness = NetGuards(space, net[..., 3], scan, uv), np.full(space.n_control, 1.0)
    for _ in range(STIFFENINGS):
        folded = guards.folded(net[..., :3].reshape(-1, 3))
        if not folded.any():
            break
        stiffness[guards.widened(folded)] *= STIFFENING
        net = _interpolating(scan, uv, space, net, stiffness * usual_stiffness(space, scan))
    return net


def _interpolating(scan: ScanData, uv: Floats, space: TensorSpace, net: Floats, stiffness: Floats) -> Floats:
    """The net moved toward the surface nearest to the points at the places where they are."""
    points = net[..., :3].reshape(-1, 3)
    rows = net_rows(space, net, uv)
    residuals = scan.points - rows.matrix(space.n_control) @ points
    metric, energy = Metric(np.zeros_like(residuals), scan.weights, 1.0), NetEnergy(space).matrix(stiffness)
    move = tangent_distance_move(rows, residuals, metric, energy, points, accuracy=1e-2, max_iterations=60)
    return homogeneous(points + move, net[..., 3])


def _shape(count: int, sides: Floats, least: int) -> tuple[int, int]:
    """Numbers of control points in both directions whose product is at most `count`, as the sides are long."""
    n_u = round(float(np.sqrt(count * sides[0] / sides[1])))
    n_u = int(np.clip(n_u, least, count // least))
    return n_u, count // n_u


def _equal_spans(shape: tuple[int, ...], kind: ScanKind, degree: int) -> TensorSpace:
    around = kind in (ScanKind.CYLINDER, ScanKind.TORUS), kind is ScanKind.TORUS
    spans = [n if periodic else n - degree for n, periodic in zip(shape, around)]
    return TensorSpace(*(SplineSpace(degree, np.linspace(0.0, 1.0, n + 1), p) for n, p in zip(spans, around)))
