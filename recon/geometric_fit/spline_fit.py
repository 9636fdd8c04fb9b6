"""From a scan to one B-spline or NURBS surface, by the steps of [maekawa2009].

    1. unroll       the scan into a rectangle (`unrolling`); a coarse net through it, made finer
    2. foot points  nearest points of the surface, for every point of the scan
    3. move         control points move by the error vectors; by which rule, `Update` says
    4. errors       mean, root mean square and largest distance
    5. refine       knots where the error is, until the tolerance or the number of control points is met

With NURBS the weights are free as well: half as many rounds again move them, too, where that helps.
PATENT and BASIS are one rule here: the patent weighs error vectors of a spline with its basis functions.
"""

from collections.abc import Callable
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from recon.errors import NoSurface
from recon.geometric_fit.convergence import Norms, Round, StoppedBy, norms
from recon.geometric_fit.first_net import first_net, usual_stiffness
from recon.geometric_fit.folding import smoothed_out, stepped
from recon.geometric_fit.growth import Growth
from recon.geometric_fit.knot_gains import knot_gains
from recon.geometric_fit.net_guards import NetEnergy, NetGuards, net_means
from recon.geometric_fit.net_weights import moved_weights
from recon.geometric_fit.reweighting import reweighed
from recon.geometric_fit.scan_data import ScanData, refuse_tangles, scan_data
from recon.geometric_fit.scan_kind import ScanKind
from recon.geometric_fit.spline_options import FittedSheet, SplineKind, SplineOptions
from recon.geometric_fit.tangent_distance import BasisRows
from recon.geometric_fit.tensor_space import (
    EXACT,
    NetFeet,
    TensorSpace,
    homogeneous,
    nearest_net_feet,
    net_rows,
    walk_net_feet,
)
from recon.geometric_fit.unrolling import Unrolled, unrolled
from recon.geometric_fit.updates import Pull, Updater
from recon.geometry.mesh import TriangleMesh
from recon.numerics.rows import unit_vectors

__all__ = ["FittedSheet", "SplineKind", "SplineOptions", "fit_sheet"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FIRST_SHARE = 0.6  # of the control points are there from the start, the others come where the error is
ROUNDS = 3  # before each refinement
FILL_WEIGHT = 1e-4  # of what is laid over holes: it may be squeezed into a few spans, beside those of the scan
STIFFER, STIFFEST = 4.0, 1024.0  # times stiffer where the surface would fold, in one round and in all
EASING = 1.4  # times less stiff a round where it would not


def fit_sheet(
    scan: TriangleMesh, options: SplineOptions | None = None, *, doing: Callable[[str], None] = lambda step: None
) -> FittedSheet:
    """The tensor-product surface nearest to a scan that is a disc, a cylinder or a torus, with holes or without.

    scan    triangles of a surface in one part, in any unit
    doing   called with what happens, round by round
    Raises  NoSurface when the scan is of another kind, or cannot be unrolled; NotManifold; BadOption.
    Paper   [maekawa2009], claims 8 and 10.
    """
    chosen = options or SplineOptions()
    if scan.n_faces < 4:
        raise NoSurface(f"{scan.name} has {scan.n_faces} triangles; a surface cannot be fitted to so few.")
    refuse_tangles(scan)
    with threadpool_limits(limits=1, user_api="blas"):
        doing("unrolling the scan")
        return _SheetFit(unrolled(scan), chosen, doing).run()


class _SheetFit:
    """One run, in a box of diagonal 1 around the origin."""

    def __init__(self, flat: Unrolled, options: SplineOptions, doing: Callable[[str], None]) -> None:
        self._begin = perf_counter()
        self._sheet, self._options, self._doing = flat.sheet, options, doing
        sheet = flat.sheet
        measured = sheet.mesh.vertices[: len(sheet.origins)]
        self._middle = measured.mean(axis=0)
        self._diagonal = float(np.linalg.norm(np.ptp(measured, axis=0)))
        mesh = TriangleMesh((sheet.mesh.vertices - self._middle) / self._diagonal, sheet.mesh.face_vertices)
        self._limit = _most_control_points(len(measured), options)
        self._growth = Growth(options.control_points, options.tolerance, options.plain, self._limit)
        self._scan = scan_data(
            mesh, self._limit, n_measured=len(measured), n_sampled=sheet.n_faces, fill_weight=FILL_WEIGHT
        )
        self._rims = np.concatenate(sheet.rims) if sheet.kind is ScanKind.CYLINDER else np.empty(0, dtype=np.int64)
        self._flat = flat
        self._uv = np.concatenate([flat.places, _sample_places(self._scan, flat)])
        self._weights = self._scan.weights.copy()
        self._record: list[Round] = []

    def run(self) -> FittedSheet:
        space, net = first_net(self._scan, self._uv, self._first_count(), self._flat, self._options)
        stopped, cycle, last = None, 0, None
        while stopped is None:
            final = self._options.plain or not self._has_room(space)
            n_rounds = self._options.rounds if final else ROUNDS
            # more knots take the weights back: they are found where the fit may end
            free = self._options.kind is SplineKind.NURBS and (final or self._options.tolerance is not None)
            net, feet, folds = self._settled(space, net, (cycle, n_rounds, -(-n_rounds // 2) if free else 0))
            errors = norms(self._distances(feet), 1.0)
            stopped = self._growth.ended(errors, last, diagonal=self._diagonal, final=final)
            if stopped is None:
                last, cycle = errors, cycle + 1
                finer = self._refined(space, net, feet, cycle)
                stopped = StoppedBy.STAGNATION if finer is None else None
                space, net = (space, net) if finer is None else finer
            self._uv = feet.uv
        return self._finished(space, net, (stopped, folds))

    def _first_count(self) -> int:
        if self._options.plain:
            return self._limit
        if self._growth.toward_tolerance:
            return max(min(self._scan.n_measured // 100, self._limit), self._options.least)
        return max(int(FIRST_SHARE * self._limit), self._options.least)

    def _has_room(self, space: TensorSpace) -> bool:
        return self._limit - space.n_control >= min(space.shape)

    def _settled(self, space: TensorSpace, net: Floats, at: tuple[int, int, int]) -> tuple[Floats, NetFeet, int]:
        """Some rounds on one net: pull, move, find the feet again. The best net, its feet, and its folds.

        at  number of the cycle, of its rounds, and of further rounds in which the weights move, too
        """
        cycle, n_rounds, n_free = at
        scan, weights = self._scan, net[..., 3]
        guards, plate = NetGuards(space, weights, scan, self._uv), NetEnergy(space)
        # a step is only allowed to keep what is not folded so: start without folds
        unfolded, _ = smoothed_out((net[..., :3] / net[..., 3:]).reshape(-1, 3), guards, net_means(space))
        net = homogeneous(unfolded, weights)
        feet = self._feet(space, net, self._uv)
        usual = usual_stiffness(space, self._scan)
        stiffness = np.full(space.n_control, usual)
        energy, updater = plate.matrix(stiffness), Updater(self._options.update)
        best = ((space.n_control + 1, np.inf), net, feet)
        for number in range(n_rounds + n_free):
            if number == n_rounds:  # weights find their way from a good net only
                net, feet, updater = best[1], best[2], Updater(self._options.update)
            points = (net[..., :3] / net[..., 3:]).reshape(-1, 3)
            pull = self._pull(space, net, feet)._replace(fairness=energy)
            step = stepped(guards, points, updater.moved(points, pull))
            if step.folding.any():
                eased = np.maximum(stiffness / EASING, usual)
                stiffness = np.where(step.folding, np.minimum(STIFFER * stiffness, STIFFEST * usual), eased)
                energy = plate.matrix(stiffness)
            net = homogeneous(step.points, net[..., 3])
            feet = self._feet(space, net, feet.uv)
            if number >= n_rounds:
                net, feet = self._weighted(space, net, feet)
            errors = self._note(space, feet)
            merit = (int(step.folded.sum()), errors.rms * errors.maximum)
            if merit <= best[0]:
                best = merit, net, feet
            if cycle > 0 or self._options.robust:
                away = np.linalg.norm(feet.positions - scan.points, axis=1)
                self._weights = reweighed(self._weights, scan.weights, away, scan.counts, robust=self._options.robust)
        return best[1], best[2], best[0][0]

    def _feet(self, space: TensorSpace, net: Floats, uv: Floats) -> NetFeet:
        """Feet of all points; points of a rim have theirs on that side of the surface."""
        feet = walk_net_feet(space, net, self._scan.points, uv)
        if len(self._rims):
            start = feet.uv[self._rims]
            start[:, 1] = np.where(start[:, 1] < 0.5, 0.0, 1.0)
            on_rim = walk_net_feet(space, net, self._scan.points[self._rims], start, along_u=True)
            for column, rows in zip(feet, on_rim):
                column[self._rims] = rows
        return feet

    def _pull(self, space: TensorSpace, net: Floats, feet: NetFeet) -> Pull:
        """The data points, and those beyond a side of the surface once more: there a residual along the surface is an
        error, too, and no pull would stop the surface from sliding off."""
        rows = net_rows(space, net, feet.uv)
        residuals = self._scan.points - feet.positions
        beyond, beside = _beyond_sides(space, feet)
        size = (space.u.degree + 1) * (space.v.degree + 1)
        again = (beyond[:, None] * size + np.arange(size)).ravel()
        return Pull(
            BasisRows(
                np.arange(0, size * (len(residuals) + len(beyond)) + 1, size),
                np.concatenate([rows.columns, rows.columns[again]]),
                np.concatenate([rows.values, rows.values[again]]),
            ),
            np.concatenate([residuals, residuals[beyond]]),
            np.concatenate([feet.normals, beside]),
            np.concatenate([self._weights, self._weights[beyond]]),
            NetEnergy(space).matrix(np.zeros(space.n_control)),
        )

    def _weighted(self, space: TensorSpace, net: Floats, feet: NetFeet) -> tuple[Floats, NetFeet]:
        """Net and feet with other weights, where they bring the surface nearer."""
        moved = moved_weights(space, net, feet, self._scan.points, self._weights)
        again = self._feet(space, moved, feet.uv)
        before, after = (float(np.square(self._distances(each)).sum()) for each in (feet, again))
        return (moved, again) if after < before else (net, feet)

    def _distances(self, feet: NetFeet) -> Floats:
        """(n,) of the measured points."""
        n = self._scan.n_measured
        return np.asarray(np.linalg.norm(feet.positions[:n] - self._scan.points[:n], axis=1))

    def _note(self, space: TensorSpace, feet: NetFeet) -> Norms:
        errors = norms(self._distances(feet), 1.0)
        self._record.append(Round(len(self._record) + 1, space.n_control, errors, perf_counter() - self._begin))
        self._doing(
            f"round {len(self._record)}: {space.shape[0]} x {space.shape[1]} control points, "
            f"rms {errors.rms:.4f} %, largest {errors.maximum:.3f} %"
        )
        return errors

    def _refined(self, space: TensorSpace, net: Floats, feet: NetFeet, cycle: int) -> tuple[TensorSpace, Floats] | None:
        """More knots where the error is; None where no span can be split.

        A knot costs a whole row of control points: what counts is what it would gain for every one of them.
        """
        left, share = self._limit - space.n_control, self._growth.more(space.n_control, cycle)
        (n_u, n_v), n_before = space.shape, space.n_control
        height = np.einsum("ij,ij->i", self._scan.points - feet.positions, feet.normals)
        gains = knot_gains(space, feet.uv, height, self._weights)
        spans = [
            (float(gain), which, 0.5 * float(first + last))
            for which, (each, gain_of) in enumerate(zip((space.u, space.v), gains))
            for gain, first, last in zip(gain_of, each.breaks, each.breaks[1:])
            if gain > 0.0
        ]
        more: tuple[list[float], list[float]] = ([], [])
        for _, which, middle in sorted(spans, reverse=True):
            wider = (n_u + (which == 0)) * (n_v + (which == 1))
            if wider - n_before > left or n_u * n_v - n_before >= share:
                continue
            more[which].append(middle)
            n_u, n_v = n_u + (which == 0), n_v + (which == 1)
        if not any(more):
            return None
        finer, net = space.with_breaks(np.array(more[0]), np.array(more[1]), net)
        # a span beside one of half its size spoils what the smaller one gains, where the scan is smooth
        return finer.evened(net)

    def _finished(self, space: TensorSpace, net: Floats, end: tuple[StoppedBy, int]) -> FittedSheet:
        stopped, folds = end
        n = self._scan.n_measured
        measured = self._scan.points[:n]
        found = (
            nearest_net_feet(space, net, measured),
            walk_net_feet(space, net, measured, self._uv[:n], step=EXACT),
        )
        # two starts, as either may end at a point that is nearest only among its neighbours
        away = np.stack([np.linalg.norm(each.positions - measured, axis=1) for each in found])
        distances = np.full(int(self._sheet.origins.max()) + 1, np.inf)
        np.minimum.at(distances, self._sheet.origins, away.min(axis=0) * self._diagonal)
        distances = distances[np.isfinite(distances)]
        if self._options.tolerance is not None and distances.max() <= self._options.tolerance:
            stopped = StoppedBy.TOLERANCE
        net = net.copy()
        net[..., :3] = self._diagonal * net[..., :3] + self._middle * net[..., 3:]
        return FittedSheet(
            space=space,
            net=net,
            sheet=self._sheet,
            places=self._uv[: self._sheet.mesh.n_vertices],
            distances=distances,
            errors=norms(distances, self._diagonal),
            diagonal=self._diagonal,
            rounds=tuple(self._record),
            stopped_by=stopped,
            stretch=self._flat.stretch,
            folds=folds,
        )


def _beyond_sides(space: TensorSpace, feet: NetFeet) -> tuple[Ints, Floats]:
    """(n,) the feet on a side of the surface, and (n, 3) unit vectors out of it there; at a corner a foot has two."""
    numbers, out = [], []
    for way, (each, along) in enumerate(((space.u, feet.by_v), (space.v, feet.by_u))):
        if each.periodic:
            continue
        at = feet.uv[:, way]
        on = np.flatnonzero((at <= each.breaks[0]) | (at >= each.breaks[-1]))
        numbers.append(on)
        out.append(unit_vectors(np.cross(along[on], feet.normals[on])))
    if not numbers:
        return np.empty(0, dtype=np.int64), np.empty((0, 3))
    return np.concatenate(numbers), np.concatenate(out)


def _sample_places(scan: ScanData, flat: Unrolled) -> Floats:
    """(m, 2) places of the samples on large triangles."""
    faces = scan.mesh.face_vertices[scan.sampled_faces]
    points = scan.points[len(scan.points) - len(faces) :]
    a, b, c = scan.mesh.vertices[faces].transpose(1, 0, 2)
    one, two, off = b - a, c - a, points - a
    aa, ab, bb = (np.einsum("ij,ij->i", x, y) for x, y in ((one, one), (one, two), (two, two)))
    ao, bo = (np.einsum("ij,ij->i", x, off) for x in (one, two))
    determinant = np.maximum(aa * bb - ab * ab, 1e-300)
    v, w = (bb * ao - ab * bo) / determinant, (aa * bo - ab * ao) / determinant
    bary = np.stack([1.0 - v - w, v, w], axis=1)
    corners = flat.face_corners()[scan.sampled_faces]
    return np.asarray(np.einsum("fk,fkx->fx", bary, corners))


def _most_control_points(n_points: int, options: SplineOptions) -> int:
    if options.control_points is not None:
        return options.control_points
    return max(n_points // (3 if options.tolerance is not None else 20), options.least)
