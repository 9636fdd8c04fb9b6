"""Rounds on one control mesh: pull, move, find the feet again, note the errors; the best state is kept.

    sample of the data        -->  pull  -->  move  -->  fold?  shorten  -->  feet  -->  errors  -->  weights
                                     ^                                                                  |
                                     +------------------------------------------------------------------+

After some rounds all points are asked: `seen` walks from the feet of those that stand for them. A walk ends at a point
that is nearest among its neighbours, so those that seem far off are asked again from the samples of the surface next
to them.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.geometric_fit.borders import BorderPull, Borders, sideways
from recon.geometric_fit.convergence import Norms, Round, norms
from recon.geometric_fit.folding import stepped, unfolded
from recon.geometric_fit.foot_points import ROUGH, Feet, Places, joined, nearest_feet, walk_feet, walk_on
from recon.geometric_fit.guards import Guards, Strays, fairness, neighbour_means
from recon.geometric_fit.options import FitOptions
from recon.geometric_fit.patch_rows import PatchColumns, mean_move, patch_columns, patch_part
from recon.geometric_fit.reweighting import GENTLE, STEEP, reweighed
from recon.geometric_fit.sampling import Sample
from recon.geometric_fit.scan_data import ScanData
from recon.geometric_fit.updates import METRICS, PatchPull, Pull, Updater, rows_for
from recon.geometry.control_mesh import ControlMesh
from recon.numerics.halfedges import free_edges, vertex_normals
from recon.numerics.rows import row_distances
from recon.subdivision.evaluation import points_at
from recon.subdivision.limit_surface import LimitPatches, Scheme, limit_patches

__all__ = ["Ground", "Rounds", "ground_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

FAIRNESS, LEAST_FAIRNESS = 1e-3, 1.5e-4  # weight of the control mesh's own energy, as a share of the data's
CALMER = 0.8  # times as much of it from round to round
STIFFER, STIFFEST = 4.0, 1024.0  # times stiffer where the surface would fold, in one round and in all
EASING = 1.4  # times less stiff a round where it would not
WORSE, SHORTENINGS = 1.5, 3  # times the rms error after which a step is halved, and how often
SLIDING, MOST_SLIDING = 0.25, 16.0  # data points that a move along the surface counts as, and times more at folds
SETTLED = 16  # rounds until that is so
STUCK, FAR_OFF = 2, 4.0  # rounds that folds hold a point, and rms errors there, from when on it is loosened
LOOSENINGS, RECOVERY = 3, 2  # passes of that, and rounds that must follow
STRAY, STRAY_WEIGHT = 2.5, 0.15  # rms errors from where on surface strays, and what one sample of it weighs


class Ground(NamedTuple):
    """A control mesh with what depends on its connections alone."""

    mesh: ControlMesh
    patches: LimitPatches
    guards: Guards
    borders: Borders

    def n_folded(self) -> int:
        """How many control points are around folds that the scan does not have."""
        return int(self.guards.folded(self.mesh.vertices).sum())


def ground_of(mesh: ControlMesh, scheme: Scheme, scan: ScanData) -> Ground:
    """A control mesh as ground for the rounds of a fit."""
    patches = limit_patches(mesh, scheme)
    borders = Borders(mesh, patches, scan, has_slits=scheme is Scheme.DOO_SABIN)
    return Ground(mesh, patches, Guards(mesh, patches, scan), borders)


class Rounds:
    """The rounds of one fit: what they have in common, and the record."""

    def __init__(self, scan: ScanData, options: FitOptions, doing: Callable[[str], None]) -> None:
        self._begin = time.perf_counter()
        self._scan, self._options, self._doing = scan, options, doing
        self.record: list[Round] = []

    def settled(
        self, ground: Ground, sample: Sample, weights: Floats, *, n_rounds: int, start: Places | None, reweighs: bool
    ) -> tuple[Ground, Feet, Floats]:
        """The control mesh after some rounds, the feet of the sample, and its weights by then.

        weights   (n,) of the sample
        start     where its feet were; None: they are sought
        reweighs  whether points far off count more from round to round
        """
        mesh, patches, guards, _ = ground
        # a step is only allowed to keep what is not folded so: start without folds; but where a start was given, tips
        # would be smoothed away with them, and most folds leave in the rounds
        points = mesh.vertices if self._options.start is not None else unfolded(mesh, guards)[0].vertices
        placed = patches.points @ points
        if start is None:
            feet = nearest_feet(patches, placed, sample.points, step=ROUGH)
        else:
            feet = walk_feet(patches, placed, sample.points, start)
        at = _State(ground, patch_columns(patches), sample, weights, points, feet)
        updater = Updater(self._options.update)
        best, number_of_best = ((mesh.n_vertices + 1, np.inf), points, feet.places()), -1
        for number in range(n_rounds):
            if number % 2 == 0:
                at.strays = guards.strays(at.points, STRAY * at.rms())
            folded = self._move(at, updater)
            errors = self._note(mesh, at.distance, sample)
            # the largest error jumps from round to round where the scan has two sheets close together
            merit = (folded, errors.rms * errors.maximum)
            if merit <= best[0]:
                best, number_of_best = (merit, at.points, at.feet.places()), number
            if reweighs or self._options.robust:
                self._reweigh(at)
            if n_rounds - number > RECOVERY:
                at.loosen(folded)
        points, feet = at.points, at.feet
        if number_of_best < n_rounds - 1:
            points, feet = best[1], walk_feet(patches, patches.points @ best[1], sample.points, best[2])
        return ground._replace(mesh=mesh.with_vertices(points)), feet, at.weights

    def _move(self, at: "_State", updater: Updater) -> int:
        """One move, shortened where it folds the surface or leads away; how many control points are folded."""
        guards = at.ground.guards
        pull = self._pull(at)
        careful = mean_move(pull.parts) if isinstance(pull, PatchPull) else None
        new = updater.moved(at.points, pull)
        del pull  # its rows are most of the memory of a round
        step = stepped(guards, at.points, new, careful)
        if step.folding.any():
            eased = np.maximum(at.stiffer / EASING, 1.0)
            at.stiffer = np.where(step.folding, np.minimum(STIFFER * at.stiffer, STIFFEST), eased)
        at.held = np.where(step.held, at.held + 1, 0)
        old, before = at.points, at.rms()
        at.go(step.points)
        for _ in range(SHORTENINGS):
            if at.rms() <= WORSE * before:
                break
            # points slid away along the surface, as they may at a border
            step = stepped(guards, old, 0.5 * (old + at.points))
            at.go(step.points)
        return int(step.folded.sum())

    def _reweigh(self, at: "_State") -> None:
        sample, growth = at.sample, GENTLE if self._scan.is_open or len(self._scan.sharp_edges) else STEEP
        at.weights = reweighed(
            at.weights, sample.weights, at.distance, sample.counts, growth=growth, robust=self._options.robust
        )

    def _fairness(self) -> float:
        """Less from round to round: what keeps the first rounds calm only keeps the last ones from the data."""
        return max(FAIRNESS * CALMER ** len(self.record), LEAST_FAIRNESS)

    def _sliding(self, at: "_State") -> Floats:
        """(V, 3, 3) what moves along the surface cost: nothing at first, when they bring points where they should be;
        later as much as some share of one data point, and more where the surface would fold. On borders and creases
        they are free: there a point has to come to a line."""
        normals = vertex_normals(at.points, at.ground.mesh.triangle_mesh().face_vertices)
        along = np.eye(3) - normals[:, :, None] * normals[:, None, :]
        cost = SLIDING * min(len(self.record) / SETTLED, 1.0) ** 2
        costs = cost * np.minimum(at.stiffer, MOST_SLIDING)
        costs[at.on_lines] = 0.0
        return np.asarray(costs[:, None, None] * along)

    def _more(self, at: "_State", border: BorderPull) -> tuple[Feet, Floats, Floats]:
        """Feet, targets and weights beside those of the data points: of those that pull sideways, and of samples
        that stay where they are in their patches."""
        patches, strays, feet = at.ground.patches, at.strays, at.feet
        points, astray = patches.points @ at.points, strays.feet
        positions = points_at(patches.arrays, points, astray.patch, astray.v, astray.w, 1)[:, 0]
        beside, conormals = sideways(patches, points, feet)
        again = feet.chosen(beside)._replace(normals=conormals)
        # as much as the data points along it
        along = np.sqrt(self._scan.n_measured / len(at.points)) / 4.0
        others = np.repeat([STRAY_WEIGHT, along], [len(astray.patch), len(border.targets)])
        return (
            joined((again, astray._replace(positions=positions), border.feet)),
            np.concatenate([at.sample.points[beside], strays.targets, border.targets]),
            np.concatenate([at.weights[beside], others]),
        )

    def _pull(self, at: "_State") -> Pull | PatchPull:
        """Data points, and what is beside them."""
        ground = at.ground
        energy = fairness(ground.mesh, at.stiffer * self._fairness() * self._scan.n_measured / len(at.points))
        data, more = (at.feet, at.sample.points, at.weights), self._more(at, ground.borders.pull(at.points))
        if self._options.update in METRICS:
            metric = METRICS[self._options.update]
            parts = tuple(patch_part(at.columns, *part, metric) for part in (data, more))
            return PatchPull(parts, energy, self._sliding(at))
        all_feet = joined((data[0], more[0]))
        targets, weights = (np.concatenate([data[i], more[i]]) for i in (1, 2))
        rows = rows_for(self._options.update, ground.patches, all_feet, _faces(ground.mesh))
        return Pull(rows, targets - all_feet.positions, all_feet.normals, weights, energy)

    def _note(self, mesh: ControlMesh, distance: Floats, sample: Sample) -> Norms:
        errors = norms(distance, self._scan.diagonal, sample.counts)
        self.record.append(Round(len(self.record) + 1, mesh.n_vertices, errors, time.perf_counter() - self._begin))
        self._doing(
            f"round {len(self.record)}: {mesh.n_vertices} control points, rms {errors.rms:.4f} %, "
            f"largest {errors.maximum:.3f} %"
        )
        return errors


class _State:
    """Where the rounds on one control mesh are.

    stiffer  (V,) how many times stiffer than usual the surface is around each control point
    held     (V,) rounds since each was last free to move
    on_lines the numbers of those on creases and borders
    """

    def __init__(
        self, ground: Ground, columns: PatchColumns, sample: Sample, weights: Floats, points: Floats, feet: Feet
    ) -> None:
        self.ground, self.columns, self.sample, self.weights = ground, columns, sample, weights
        self.points, self.feet = points, feet
        self.distance = row_distances(feet.positions, sample.points)
        self.stiffer, self.held = np.ones(len(points)), np.zeros(len(points), dtype=np.int64)
        self.strays: Strays
        self.on_lines = np.union1d(ground.mesh.crease_edges, free_edges(_faces(ground.mesh)))

    def rms(self) -> float:
        """Of the distances of all measured points, as far as the sample tells."""
        return float(np.sqrt(np.average(self.distance**2, weights=self.sample.counts)))

    def go(self, points: Floats) -> None:
        """Move the control points, and find the feet again."""
        patches, data = self.ground.patches, self.sample.points
        placed, self.points = patches.points @ points, points
        walk_on(patches, placed, data, self.feet)
        self.feet = self.ground.borders.hopped(placed, data, self.feet)
        self.distance = row_distances(self.feet.positions, data)

    def loosen(self, n_folded: int) -> None:
        """Spread control points evenly where every step would fold the surface and the error is large.

        Points that have slid close together there hold each other, and would for good.
        """
        guards = self.ground.guards
        stuck = (self.held >= STUCK) & self._far_off()
        if not stuck.any():
            return
        around, means, points = guards.widened(stuck), neighbour_means(self.ground.mesh), self.points
        for _ in range(LOOSENINGS):
            points = np.where(around[:, None], 0.5 * (points + means @ points), points)
        if guards.folded(points).sum() <= n_folded:
            self.held[around] = 0
            self.go(points)

    def _far_off(self) -> Bools:
        """(V,) the control points of faces with a measured point far off."""
        mesh, measured = self.ground.mesh, self.sample.counts > 0
        worst = np.zeros(mesh.n_faces)
        face = np.minimum(self.feet.patch[measured] // 4, mesh.n_faces - 1)
        np.maximum.at(worst, face, self.distance[measured])
        far = np.zeros(mesh.n_vertices, dtype=np.bool_)
        far[_faces(mesh)[worst > FAR_OFF * self.rms()]] = True
        return far


def _faces(mesh: ControlMesh) -> Ints:
    """(F, k) the control faces, which all have as many corners."""
    return mesh.faces_of(int(mesh.face_starts[1]))
