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
from scipy import sparse

from recon.geometric_fit.borders import BorderPull, Borders, sideways
from recon.geometric_fit.convergence import Norms, Round, norms
from recon.geometric_fit.folding import stepped, unfolded
from recon.geometric_fit.foot_points import Feet, Places, joined, nearest_feet, walk_feet, walk_on
from recon.geometric_fit.guards import Guards, Strays, fairness
from recon.geometric_fit.options import FitOptions
from recon.geometric_fit.patch_rows import PatchColumns, patch_columns, patch_part
from recon.geometric_fit.reweighting import GENTLE, STEEP, reweighed
from recon.geometric_fit.sampling import Sample
from recon.geometric_fit.scan_data import ScanData
from recon.geometric_fit.updates import METRICS, PatchPull, Pull, Updater, rows_for
from recon.geometry.control_mesh import ControlMesh
from recon.numerics.rows import row_distances
from recon.subdivision.evaluation import points_at
from recon.subdivision.limit_surface import LimitPatches

__all__ = ["Ground", "Rounds"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SEED_STEP = 1e-5  # of the size of the data: the last step of a walk from a seed
FAIRNESS, LEAST_FAIRNESS = 1e-3, 1.5e-4  # weight of the control mesh's own energy, as a share of the data's
CALMER = 0.8  # times as much of it from round to round
STIFFER, STIFFEST = 4.0, 1024.0  # times stiffer where the surface would fold, in one round and in all
EASING = 1.4  # times less stiff a round where it would not
WORSE, SHORTENINGS = 1.5, 3  # times the rms error after which a step is halved, and how often
STRAY, STRAY_WEIGHT = 2.5, 0.15  # rms errors from where on surface strays, and what one sample of it weighs


class Ground(NamedTuple):
    """A control mesh with what depends on its connections alone."""

    mesh: ControlMesh
    patches: LimitPatches
    guards: Guards
    borders: Borders


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
        mesh, patches, guards, borders = ground
        scan, data, columns = self._scan, sample.points, patch_columns(patches)
        # a step is only allowed to keep what is not folded so: start without folds; but where a start was given, tips
        # would be smoothed away with them, and most folds leave in the rounds
        points = mesh.vertices if self._options.start is not None else unfolded(mesh, guards)[0].vertices
        placed = patches.points @ points
        if start is None:
            feet = nearest_feet(patches, placed, data, step=SEED_STEP)
        else:
            feet = walk_feet(patches, placed, data, start)
        distance = row_distances(feet.positions, data)
        stiffer, updater = np.ones(mesh.n_vertices), Updater(self._options.update)
        strays: Strays | None = None
        best, number_of_best = ((mesh.n_vertices + 1, np.inf), points, feet.places()), -1
        for number in range(n_rounds):
            if number % 2 == 0 or strays is None:
                strays = guards.strays(points, STRAY * _rms(distance, sample))
            energy = fairness(mesh, stiffer * self._fairness() * scan.n_measured / mesh.n_vertices)
            more = self._more(patches, (points, feet), (sample, weights), (strays, borders.pull(points)))
            new = updater.moved(points, self._pull(ground, columns, (feet, data, weights), more, energy))
            step = stepped(guards, points, new)
            if step.folding.any():
                eased = np.maximum(stiffer / EASING, 1.0)
                stiffer = np.where(step.folding, np.minimum(STIFFER * stiffer, STIFFEST), eased)
            old, before = points, _rms(distance, sample)
            for halving in range(SHORTENINGS + 1):
                if halving:  # points slid away along the surface, as they may at a border
                    step = stepped(guards, old, 0.5 * (old + points))
                points = step.points
                placed = patches.points @ points
                walk_on(patches, placed, data, feet)
                feet = borders.hopped(placed, data, feet)
                distance = row_distances(feet.positions, data)
                if _rms(distance, sample) <= WORSE * before:
                    break
            errors = self._note(mesh, distance, sample)
            # the largest error jumps from round to round where the scan has two sheets close together
            merit = (int(step.folded.sum()), errors.rms * errors.maximum)
            if merit <= best[0]:
                best, number_of_best = (merit, points, feet.places()), number
            if reweighs or self._options.robust:
                growth = GENTLE if scan.is_open or len(scan.sharp_edges) else STEEP
                weights = reweighed(
                    weights, sample.weights, distance, sample.counts, growth=growth, robust=self._options.robust
                )
        if number_of_best < n_rounds - 1:
            points, feet = best[1], walk_feet(patches, patches.points @ best[1], data, best[2])
        return ground._replace(mesh=mesh.with_vertices(points)), feet, weights

    def _fairness(self) -> float:
        """Less from round to round: what keeps the first rounds calm only keeps the last ones from the data."""
        return max(FAIRNESS * CALMER ** len(self.record), LEAST_FAIRNESS)

    def _more(
        self,
        patches: LimitPatches,
        at: tuple[Floats, Feet],
        data: tuple[Sample, Floats],
        guarded: tuple[Strays, BorderPull],
    ) -> tuple[Feet, Floats, Floats]:
        """Feet, targets and weights beside those of the data points: of those that pull sideways, and of samples
        that stay where they are in their patches."""
        (control_points, feet), (sample, weights), (strays, border) = at, data, guarded
        scan, points = self._scan, patches.points @ control_points
        astray = strays.feet
        positions = points_at(patches.arrays, points, astray.patch, astray.v, astray.w, 1)[:, 0]
        beside, conormals = sideways(patches, points, feet)
        again = feet.chosen(beside)._replace(normals=conormals)
        # as much as the data points along it
        along = np.sqrt(scan.n_measured / len(control_points)) / 4.0
        others = np.repeat([STRAY_WEIGHT, along], [len(astray.patch), len(border.targets)])
        return (
            joined((again, astray._replace(positions=positions), border.feet)),
            np.concatenate([sample.points[beside], strays.targets, border.targets]),
            np.concatenate([weights[beside], others]),
        )

    def _pull(
        self,
        ground: Ground,
        columns: PatchColumns,
        data: tuple[Feet, Floats, Floats],
        more: tuple[Feet, Floats, Floats],
        energy: sparse.csr_array,
    ) -> Pull | PatchPull:
        """Data points, and what is beside them."""
        if self._options.update in METRICS:
            metric = METRICS[self._options.update]
            return PatchPull(tuple(patch_part(columns, *part, metric) for part in (data, more)), energy)
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


def _rms(distance: Floats, sample: Sample) -> float:
    return float(np.sqrt(np.average(distance**2, weights=sample.counts)))


def _faces(mesh: ControlMesh) -> Ints:
    """(F, k) the control faces, which all have as many corners."""
    return mesh.faces_of(int(mesh.face_starts[1]))
