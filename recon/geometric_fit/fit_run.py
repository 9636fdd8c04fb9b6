"""One fit of a subdivision surface to a scan, from the first control mesh to the last round.

    first control mesh  -->  rounds  -->  all points asked  -->  more control points where they are off  --.
                               ^                                                                           |
                               +---------------------------------------------------------------------------+

Paper  [maekawa2009].
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from recon.geometric_fit.convergence import StoppedBy, norms
from recon.geometric_fit.crossings import without_crossings
from recon.geometric_fit.exact_distances import Seen, exact_distances, seen
from recon.geometric_fit.finer_mesh import FinerMesh
from recon.geometric_fit.foot_points import Feet, Places, seed_feet, surface_samples
from recon.geometric_fit.growth import CYCLES, Growth
from recon.geometric_fit.hole_filling import close_holes
from recon.geometric_fit.options import FitOptions, FittedSurface
from recon.geometric_fit.sampling import Sample, joined_by, sample_of
from recon.geometric_fit.scan_data import scan_data
from recon.geometric_fit.settling import Ground, Rounds, ground_of
from recon.geometric_fit.sharpening import SharpScan, sharpened
from recon.geometric_fit.slits import slit_for
from recon.geometric_fit.start_mesh import first_count, start_mesh
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh

__all__ = ["FitRun"]

Floats = NDArray[np.float64]

ROUNDS = 4  # before each refinement
FINAL_ROUNDS, REFINED_ROUNDS = 6, 12  # on the last control mesh where nobody says how many
LAST_ROUNDS = 2  # when all points far off have joined the sample
FAR = 2.0  # root mean squares from where on they do


class FitRun:
    """One run: the scan, what has been reached, and the record.

    has_creases  whether the control mesh began with sharp edges
    """

    has_creases = False

    def __init__(self, scan: TriangleMesh, options: FitOptions, doing: Callable[[str], None]) -> None:
        self._options, self._doing = options, doing
        self._limit = _most_control_points(scan, options)
        self._growth = Growth(options.control_points, options.tolerance, options.plain, self._limit)
        whole, self._n_closed = close_holes(scan) if options.close else (scan, 0)
        if self._n_closed:
            doing(f"closed {self._n_closed} holes")
        self._whole, self._sharp = whole, SharpScan(whole, np.empty((0, 2), dtype=np.int64))
        if options.crease_angle < np.pi:
            self._sharp = sharpened(whole, options.crease_angle)
        self._scan = scan_data(whole, self._limit, sharp=self._sharp, n_measured=scan.n_vertices)
        self._rounds = Rounds(self._scan, options, doing)
        self._finer = FinerMesh(options.scheme, self._scan)

    @property
    def has_edges_put_back(self) -> bool:
        """Whether the scan has sharp edges, which it may have cut off."""
        return len(self._sharp.edges) > 0

    def run(self) -> FittedSurface:
        self._doing("simplifying the scan")
        ground = self._ground(self._first())
        patches = ground.patches
        seeds = seed_feet(surface_samples(patches, patches.points @ ground.mesh.vertices), self._scan.points).places()
        first = sample = sample_of(self._scan, seeds.patch, len(patches.sheets.faces))
        weights: Floats = sample.weights
        start: Places | None = seeds.chosen(sample.at)
        del seeds  # of a scan of millions of points all room counts
        stopped, cycle, last, grows = None, 0, None, not self._options.plain
        unfolded_mesh: ControlMesh | None = None
        while stopped is None:
            final = not grows or ground.mesh.n_vertices >= self._limit
            n_rounds = self._final_rounds() if final else ROUNDS
            n_last = min(LAST_ROUNDS, n_rounds - 1) if final and cycle and not sample.is_whole else 0
            ground, feet, weights = self._rounds.settled(
                ground, sample, weights, n_rounds=n_rounds - n_last, start=start, reweighs=cycle > 0
            )
            found = self._seen(ground, sample, feet)
            del feet
            if n_last:
                sample, weights = self._with_far(first, (sample, weights), found)
                start = found.places.chosen(sample.at)
                ground, feet, weights = self._rounds.settled(
                    ground, sample, weights, n_rounds=n_last, start=start, reweighs=True
                )
                found = self._seen(ground, sample, feet)
                del feet
            if ground.n_folded() == 0:
                unfolded_mesh = ground.mesh
            errors = norms(found.distances, self._scan.diagonal, self._scan.counts)
            stopped = self._growth.ended(errors, last, diagonal=self._scan.diagonal, final=final)
            if stopped is None:
                last, cycle, mesh = errors, cycle + 1, ground.mesh
                del ground  # a ground is as large as a scan of a hundred points a control point
                ground = self._finer.grown(mesh, found, self._growth.more(mesh.n_vertices, cycle))
                grows = ground.mesh.n_vertices > mesh.n_vertices or cycle < CYCLES
                sample, weights = self._with_far(first, (sample, weights), found)
                del found
                start = None
        if unfolded_mesh is not None and stopped is not StoppedBy.TOLERANCE and ground.n_folded():
            self._doing("going back to fewer control points, as the surface folds with more")
            del ground
            ground, feet, weights = self._rounds.settled(
                self._ground(unfolded_mesh), sample, weights, n_rounds=ROUNDS, start=None, reweighs=True
            )
            found = self._seen(ground, sample, feet)
        if self._options.start is not None:
            self._doing("looking for surface that cuts itself")
            ground = ground._replace(mesh=without_crossings(ground.mesh, ground.patches))
        return self._finished(ground, found, stopped)

    def _final_rounds(self) -> int:
        """Rounds on the last control mesh; points that came late need more, but along sharp edges they stray then."""
        if self._options.rounds is not None:
            return self._options.rounds
        return FINAL_ROUNDS if self._options.plain or self.has_edges_put_back else REFINED_ROUNDS

    def _seen(self, ground: Ground, sample: Sample, feet: Feet) -> Seen:
        """All points, from the feet of those that stand for them."""
        patches, start = ground.patches, feet.places().chosen(sample.nearest)
        return seen(patches, ground.borders, patches.points @ ground.mesh.vertices, self._scan.points, start)

    def _with_far(self, first: Sample, now: tuple[Sample, Floats], found: Seen) -> tuple[Sample, Floats]:
        """The first sample with all points that are far off, and its weights."""
        sample, weights = now
        if first.is_whole:
            return now
        distance = found.distances[: self._scan.n_measured]
        far = np.flatnonzero(distance > FAR * np.sqrt(np.mean(distance**2)))
        wider = joined_by(first, self._scan, far)
        emphasis = weights / sample.weights
        return wider, wider.weights * emphasis[sample.nearest[wider.at]]

    def _first(self) -> ControlMesh:
        """The control mesh to start from."""
        if self._options.start is not None:
            return self._options.start
        count = first_count(self._options, self._growth, self._scan.n_measured, has_edges=self.has_edges_put_back)
        mesh = start_mesh(self._sharp, self._options, count, self._fitted_by_loop, is_open=self._scan.is_open)
        self.has_creases = len(mesh.crease_edges) > 0
        slit = slit_for(mesh, self._options.scheme)
        return slit if slit.n_vertices <= self._limit else mesh

    def _fitted_by_loop(self, options: FitOptions) -> ControlMesh:
        return FitRun(self._whole, options, self._doing).run().mesh

    def _ground(self, mesh: ControlMesh) -> Ground:
        return ground_of(mesh, self._options.scheme, self._scan)

    def _finished(self, ground: Ground, found: Seen, stopped: StoppedBy) -> FittedSurface:
        (mesh, patches, _, borders), scan = ground, self._scan
        folds = ground.n_folded()
        placed = patches.points @ mesh.vertices
        warm = found.places.chosen(np.arange(scan.n_measured))
        distances = exact_distances(patches, borders, placed, scan.measured, warm)
        errors = norms(distances, scan.diagonal)
        return FittedSurface(
            mesh=mesh,
            scheme=self._options.scheme,
            distances=distances,
            errors=errors,
            diagonal=scan.diagonal,
            rounds=tuple(self._rounds.record),
            stopped_by=stopped,
            folds=folds,
            n_closed=self._n_closed,
        )


def _most_control_points(scan: TriangleMesh, options: FitOptions) -> int:
    if options.control_points is not None:
        return min(options.control_points, scan.n_vertices)
    return max(scan.n_vertices // (3 if options.tolerance is not None else 20), 4)
