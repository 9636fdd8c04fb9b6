"""From a scan to a subdivision surface, step by step as in [maekawa2009].

    1. initial mesh   the scan simplified by quadric error, edges flipped toward even valences
    2. foot points    nearest points of the limit surface, for every point of the scan
    3. move           control points move by the error vectors; by which rule, `Update` says
    4. errors         mean, root mean square and largest distance
    5. refine         after some rounds, control points where the error is, until the tolerance or their number is met

Beside the paper: points far off count more from cycle to cycle, and surface that strays from the scan or folds is
pulled back (`guards`).
"""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from threadpoolctl import threadpool_limits

from recon.errors import BadGeometry, NoSurface
from recon.geometric_fit.borders import BorderPull, Borders, sideways
from recon.geometric_fit.convergence import Norms, Round, StoppedBy, norms
from recon.geometric_fit.creases import n_loose_ends, with_creases, without_loose_ends
from recon.geometric_fit.crossings import without_crossings
from recon.geometric_fit.exact_distances import exact_distances
from recon.geometric_fit.folding import stepped, unfolded
from recon.geometric_fit.foot_points import Feet, joined, nearest_feet, walk_feet, walk_on
from recon.geometric_fit.growth import CYCLES, Growth
from recon.geometric_fit.guards import Guards, Strays, fairness
from recon.geometric_fit.hole_filling import close_holes
from recon.geometric_fit.initial_mesh import NoControlMesh, initial_mesh
from recon.geometric_fit.options import FitOptions, FittedSurface
from recon.geometric_fit.patch_rows import PatchColumns, patch_columns, patch_part
from recon.geometric_fit.quad_mesh import initial_quads
from recon.geometric_fit.quad_splits import refine_quads
from recon.geometric_fit.quad_turns import turned_to_even_valences
from recon.geometric_fit.refinement import flip_to_even_valences, split_faces
from recon.geometric_fit.relaxation import relaxed
from recon.geometric_fit.reweighting import GENTLE, STEEP, reweighed
from recon.geometric_fit.scan_data import refuse_tangles, scan_data
from recon.geometric_fit.sharpening import SharpScan, sharpened
from recon.geometric_fit.updates import METRICS, PatchPull, Pull, Updater, rows_for
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.numerics.rows import row_distances
from recon.subdivision.evaluation import points_at
from recon.subdivision.limit_surface import LimitPatches, Scheme, limit_patches

__all__ = ["FitOptions", "FittedSurface", "fit_surface"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FIRST_SHARE = 0.8  # of the control points are there from the start, the others come where the error is
RAGGED, COARSER = 0.1, 0.7  # loose ends a crease from where on it starts with so much fewer control points
FEWEST = 100  # control points at which no fewer are tried
FIRST_QUADS = 0.97  # of quadrilaterals: those are taken from a fit of triangles, which has put them in their places
FIRST_SHARP_QUADS = 0.85  # of them where edges were put back: small faces that come later fold less
ROUNDS = 4  # before each refinement
PEAK_SHARE = 0.3  # of the new points go to the largest errors, the others to the largest sums of squares
FAIRNESS, LEAST_FAIRNESS = 1e-3, 1.5e-4  # weight of the control mesh's own energy, as a share of the data's
CALMER = 0.8  # times as much of it from round to round
STIFFER, STIFFEST = 4.0, 1024.0  # times stiffer where the surface would fold, in one round and in all
EASING = 1.4  # times less stiff a round where it would not
WORSE, SHORTENINGS = 1.5, 3  # times the rms error after which a step is halved, and how often
STRAY, STRAY_WEIGHT = 2.5, 0.15  # rms errors from where on surface strays, and what one sample of it weighs
FEWER = (1.0, 0.95, 0.9, 0.85, 0.8)  # of the control points asked for, where a surface with sharp edges folds
FOLD_COST = 3.0  # times the error: what a fit that folds must be better by than one that does not


def fit_surface(
    scan: TriangleMesh, options: FitOptions | None = None, *, doing: Callable[[str], None] = lambda step: None
) -> FittedSurface:
    """The subdivision surface nearest to a scan.

    scan     triangles of a surface, closed or open, in one piece or several
    doing    called with what happens, round by round
    Raises   NoSurface, NotManifold, NoControlMesh, BadOption.
    Paper    [maekawa2009].
    """
    chosen = options or FitOptions()
    if scan.n_faces < 4:
        raise NoSurface(f"{scan.name} has {scan.n_faces} triangles; a surface cannot be fitted to so few.")
    refuse_tangles(scan)
    # the matrices are small: threads of the linear algebra library wait for each other longer than they work
    with threadpool_limits(limits=1, user_api="blas"):
        return _sharp_or_smooth(scan, chosen, doing)


def _sharp_or_smooth(scan: TriangleMesh, options: FitOptions, doing: Callable[[str], None]) -> FittedSurface:
    """The fit with sharp edges where the scan has some, unless it folds or stays farther off than one without.

    A smooth scan has steep places, too, and edges drawn through them do harm. Edges that were put back stay: points
    that cut an edge off are nearer to a surface that does so, too.
    """
    if options.crease_angle >= np.pi or options.start is not None:
        return _Fit(scan, options, doing).run()
    sharp: FittedSurface | None = None
    for attempt in _fewer(options):
        run = _Fit(scan, attempt, doing)
        try:
            found = run.run()
        except BadGeometry:  # edges that lie so close to each other that no limit is defined between them
            break
        if not len(found.mesh.crease_edges) or (run.has_edges_put_back and not found.folds):
            return found
        sharp = sharp or found
        if not run.has_edges_put_back:
            break
        doing("fitting again with fewer control points, as the surface folds at a sharp edge")
    doing("fitting again without sharp edges")
    smooth = _Fit(scan, replace(options, crease_angle=float(np.pi)), doing).run()
    if sharp is None:
        return smooth
    return min((sharp, smooth), key=lambda fit: fit.errors.rms * (FOLD_COST if fit.folds else 1.0))


def _fewer(options: FitOptions) -> list[FitOptions]:
    """What was asked for, then the same with somewhat fewer control points: other points, other triangles between them.

    Where no number was asked for there is nothing to take fewer of.
    """
    if options.control_points is None:
        return [options]
    counts = (max(int(share * options.control_points), 4) for share in FEWER)
    return [replace(options, control_points=count) for count in counts]


class _Ground(NamedTuple):
    """A control mesh with what depends on its connections alone."""

    mesh: ControlMesh
    patches: LimitPatches
    guards: Guards


class _Fit:
    """One run: the scan, what has been reached, and the record."""

    def __init__(self, scan: TriangleMesh, options: FitOptions, doing: Callable[[str], None]) -> None:
        self._begin = time.perf_counter()
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
        self._weights = self._scan.weights
        self._record: list[Round] = []

    @property
    def has_edges_put_back(self) -> bool:
        """Whether the scan has sharp edges, which it may have cut off."""
        return len(self._sharp.edges) > 0

    def run(self) -> FittedSurface:
        self._doing("simplifying the scan")
        ground = self._ground(self._initial())
        stopped, cycle, last, grows = None, 0, None, not self._options.plain
        while stopped is None:
            final = not grows or ground.mesh.n_vertices >= self._limit
            n_rounds = self._options.rounds if final else ROUNDS
            ground, feet = self._settled(ground, cycle, n_rounds)
            errors = norms(self._distances(feet), self._scan.diagonal)
            stopped = self._growth.ended(errors, last, diagonal=self._scan.diagonal, final=final)
            if stopped is None:
                last, cycle, before = errors, cycle + 1, ground.mesh.n_vertices
                ground = self._refined(ground.mesh, feet, cycle)
                grows = ground.mesh.n_vertices > before or cycle < CYCLES
                del feet  # those of the next control mesh need the room
        if self._options.start is not None:
            self._doing("looking for surface that cuts itself")
            ground = ground._replace(mesh=without_crossings(ground.mesh, ground.patches))
        return self._finished(ground, feet, stopped)

    def _initial(self) -> ControlMesh:
        """The control mesh to start from."""
        if self._options.start is not None:
            return self._options.start
        if self._options.scheme is Scheme.LOOP:
            return self._triangles(self._first_count())
        triangles = self._triangles if self._options.plain else self._fitted_triangles
        if self._options.scheme is Scheme.CATMULL_CLARK:
            return initial_quads(triangles, self._first_count(), evened=self._evened)
        return initial_quads(lambda n: without_loose_ends(triangles(n)), self._first_count(), evened=self._evened)

    def _evened(self, quads: ControlMesh) -> ControlMesh:
        """Even valences, and even spacing between sharp edges."""
        return relaxed(quads, self._sharp.mesh) if len(quads.crease_edges) else turned_to_even_valences(quads)

    def _triangles(self, count: int) -> ControlMesh:
        """The scan simplified, its sharp edges marked, valences evened out."""
        mesh = self._with_edges(count)
        if mesh is not None and len(mesh.crease_edges):
            return relaxed(mesh, self._sharp.mesh)
        return flip_to_even_valences(mesh or initial_mesh(self._sharp.mesh, count))

    def _with_edges(self, count: int) -> ControlMesh | None:
        """The same with its edges marked, coarser while these are ragged; None where none of them is left then."""
        angle = self._options.crease_angle
        mesh = with_creases(initial_mesh(self._sharp.mesh, count), self._sharp, angle)
        if self._options.plain or count <= FEWEST or not _is_ragged(mesh):
            return mesh
        return self._less_ragged(count, angle)

    def _less_ragged(self, count: int, angle: float) -> ControlMesh | None:
        """A coarser mesh whose sharp edges are chains, if there are any in the end.

        The simplifier keeps what is ragged at the edges of a sharp scan, if it may; points come later.
        """
        while count > FEWEST:
            count = int(COARSER * count)
            try:
                mesh = with_creases(initial_mesh(self._sharp.mesh, count), self._sharp, angle)
            except NoControlMesh:
                return None
            if not _is_ragged(mesh):
                return mesh if len(mesh.crease_edges) else None
        return mesh if len(mesh.crease_edges) else None

    def _fitted_triangles(self, count: int) -> ControlMesh:
        """The control mesh of a Loop surface: its points are where the error was, its valences even."""
        angle, robust = self._options.crease_angle, self._options.robust
        options = FitOptions(control_points=count, crease_angle=angle, robust=robust)
        return _Fit(self._whole, options, self._doing).run().mesh

    def _first_count(self) -> int:
        if self._options.plain:
            return self._limit
        if self._growth.toward_tolerance:
            return max(min(self._scan.n_measured // 100, self._limit), 100)
        share = FIRST_SHARE
        if self._options.scheme is not Scheme.LOOP:
            share = FIRST_SHARP_QUADS if self.has_edges_put_back else FIRST_QUADS
        return max(int(share * self._limit), 4)

    def _ground(self, mesh: ControlMesh) -> _Ground:
        patches = limit_patches(mesh, self._options.scheme)
        return _Ground(mesh, patches, Guards(mesh, patches, self._scan))

    def _settled(self, ground: _Ground, cycle: int, n_rounds: int) -> tuple[_Ground, Feet]:
        """Some rounds on one control mesh: pull, move, find the feet again."""
        (mesh, patches, guards), scan = ground, self._scan
        borders, columns = Borders(mesh, patches, scan), patch_columns(patches)
        # a step is only allowed to keep what is not folded so: start without folds; but where a start was given, tips
        # would be smoothed away with them, and most folds leave in the rounds
        points = mesh.vertices if self._options.start is not None else unfolded(mesh, guards)[0].vertices
        feet = nearest_feet(patches, patches.points @ points, scan.points, step=1e-5)
        distance = row_distances(feet.positions, scan.points)
        stiffer, updater = np.ones(mesh.n_vertices), Updater(self._options.update)
        strays: Strays | None = None
        best, number_of_best = ((mesh.n_vertices + 1, np.inf), points, feet.places()), -1
        for number in range(n_rounds):
            if number % 2 == 0 or strays is None:
                strays = guards.strays(points, STRAY * self._rms(distance))
            energy = fairness(mesh, stiffer * self._fairness() * scan.n_measured / mesh.n_vertices)
            more = self._more(patches, (points, feet), (strays, borders.pull(points)))
            new = updater.moved(points, self._pull(ground, columns, feet, more, energy))
            step = stepped(guards, points, new)
            if step.folding.any():
                eased = np.maximum(stiffer / EASING, 1.0)
                stiffer = np.where(step.folding, np.minimum(STIFFER * stiffer, STIFFEST), eased)
            old, before = points, self._rms(distance)
            for halving in range(SHORTENINGS + 1):
                if halving:  # points slid away along the surface, as they may at a border
                    step = stepped(guards, old, 0.5 * (old + points))
                points = step.points
                placed = patches.points @ points
                walk_on(patches, placed, scan.points, feet)
                feet = borders.hopped(placed, scan.points, feet)
                distance = row_distances(feet.positions, scan.points)
                if self._rms(distance) <= WORSE * before:
                    break
            errors = self._note(mesh, distance)
            # the largest error jumps from round to round where the scan has two sheets close together
            merit = (int(step.folded.sum()), errors.rms * errors.maximum)
            if merit <= best[0]:
                best, number_of_best = (merit, points, feet.places()), number
            if cycle > 0 or self._options.robust:
                growth = GENTLE if scan.is_open or len(scan.sharp_edges) else STEEP
                self._weights = reweighed(self._weights, scan, distance, growth, robust=self._options.robust)
        if number_of_best < n_rounds - 1:
            points, feet = best[1], walk_feet(patches, patches.points @ best[1], scan.points, best[2])
        return ground._replace(mesh=mesh.with_vertices(points)), feet

    def _fairness(self) -> float:
        """Less from round to round: what keeps the first rounds calm only keeps the last ones from the data."""
        return max(FAIRNESS * CALMER ** len(self._record), LEAST_FAIRNESS)

    def _rms(self, distance: Floats) -> float:
        return float(np.sqrt(np.mean(distance[: self._scan.n_measured] ** 2)))

    def _distances(self, feet: Feet) -> Floats:
        """(N,) of the measured points."""
        n = self._scan.n_measured
        return row_distances(feet.positions[:n], self._scan.points[:n])

    def _more(
        self, patches: LimitPatches, at: tuple[Floats, Feet], guarded: tuple[Strays, BorderPull]
    ) -> tuple[Feet, Floats, Floats]:
        """Feet, targets and weights beside those of the data points: of those that pull sideways, and of samples
        that stay where they are in their patches."""
        (control_points, feet), (strays, border) = at, guarded
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
            np.concatenate([scan.points[beside], strays.targets, border.targets]),
            np.concatenate([self._weights[beside], others]),
        )

    def _pull(
        self,
        ground: _Ground,
        columns: PatchColumns,
        feet: Feet,
        more: tuple[Feet, Floats, Floats],
        energy: sparse.csr_array,
    ) -> Pull | PatchPull:
        """Data points, and what is beside them."""
        data = (feet, self._scan.points, self._weights)
        if self._options.update in METRICS:
            metric = METRICS[self._options.update]
            return PatchPull(tuple(patch_part(columns, *part, metric) for part in (data, more)), energy)
        all_feet = joined((feet, more[0]))
        targets, weights = (np.concatenate([data[i], more[i]]) for i in (1, 2))
        rows = rows_for(self._options.update, ground.patches, all_feet, _faces(ground.mesh))
        return Pull(rows, targets - all_feet.positions, all_feet.normals, weights, energy)

    def _note(self, mesh: ControlMesh, distance: Floats) -> Norms:
        errors = norms(distance[: self._scan.n_measured], self._scan.diagonal)
        self._record.append(Round(len(self._record) + 1, mesh.n_vertices, errors, time.perf_counter() - self._begin))
        self._doing(
            f"round {len(self._record)}: {mesh.n_vertices} control points, rms {errors.rms:.4f} %, "
            f"largest {errors.maximum:.3f} %"
        )
        return errors

    def _refined(self, mesh: ControlMesh, feet: Feet, cycle: int) -> _Ground:
        """More control points where the error is, and even valences again."""
        n_new = self._growth.more(mesh.n_vertices, cycle)
        worst = self._worst_faces(mesh, feet, n_new)
        if self._options.scheme is not Scheme.LOOP:
            return self._ground(turned_to_even_valences(refine_quads(mesh, worst, n_new)))
        split = split_faces(mesh, worst, n_new)
        flipped = self._ground(flip_to_even_valences(split))
        n_folded = int(flipped.guards.folded(flipped.mesh.vertices).sum())
        if n_folded == 0:
            return flipped
        # flips even the valences out, but may fold a surface that was smooth before
        plain = self._ground(split)
        return flipped if n_folded <= plain.guards.folded(split.vertices).sum() else plain

    def _worst_faces(self, mesh: ControlMesh, feet: Feet, n_new: int) -> Ints:
        distance = self._distances(feet)
        face = np.minimum(feet.patch[: self._scan.n_measured] // 4, mesh.n_faces - 1)
        largest, squares = np.zeros(mesh.n_faces), np.bincount(face, distance**2, mesh.n_faces)
        np.maximum.at(largest, face, distance)
        n_peaks = int(PEAK_SHARE * n_new)
        order = np.concatenate([np.argsort(-largest, kind="stable")[:n_peaks], np.argsort(-squares, kind="stable")])
        _, first = np.unique(order, return_index=True)
        return order[np.sort(first)]

    def _finished(self, ground: _Ground, feet: Feet, stopped: StoppedBy) -> FittedSurface:
        (mesh, patches, guards), scan = ground, self._scan
        folds = int(guards.folded(mesh.vertices).sum())
        borders, warm = Borders(mesh, patches, scan), feet
        distances = exact_distances(patches, borders, patches.points @ mesh.vertices, scan.measured, warm)
        errors = norms(distances, scan.diagonal)
        return FittedSurface(
            mesh=mesh,
            scheme=self._options.scheme,
            distances=distances,
            errors=errors,
            diagonal=scan.diagonal,
            rounds=tuple(self._record),
            stopped_by=stopped,
            folds=folds,
            n_closed=self._n_closed,
        )


def _is_ragged(mesh: ControlMesh) -> bool:
    """Whether many creases lead nowhere."""
    return n_loose_ends(mesh) > RAGGED * len(mesh.crease_edges)


def _faces(mesh: ControlMesh) -> Ints:
    """(F, k) the control faces, which all have as many corners."""
    return mesh.faces_of(int(mesh.face_starts[1]))


def _most_control_points(scan: TriangleMesh, options: FitOptions) -> int:
    if options.control_points is not None:
        return min(options.control_points, scan.n_vertices)
    return max(scan.n_vertices // (3 if options.tolerance is not None else 20), 4)
