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

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from recon.errors import BadGeometry, NoSurface
from recon.geometric_fit.borders import BorderPull, Borders, sideways
from recon.geometric_fit.convergence import Norms, Round, StoppedBy, norms
from recon.geometric_fit.creases import n_loose_ends, with_creases, without_loose_ends
from recon.geometric_fit.crossings import without_crossings
from recon.geometric_fit.exact_distances import exact_distances
from recon.geometric_fit.folding import stepped, unfolded
from recon.geometric_fit.foot_points import Feet, joined, nearest_feet, walk_feet
from recon.geometric_fit.growth import CYCLES, Growth
from recon.geometric_fit.guards import Guards, Strays, fairness
from recon.geometric_fit.hole_filling import close_holes
from recon.geometric_fit.initial_mesh import NoControlMesh, initial_mesh
from recon.geometric_fit.options import FitOptions, FittedSurface
from recon.geometric_fit.quad_mesh import initial_quads
from recon.geometric_fit.quad_splits import refine_quads
from recon.geometric_fit.quad_turns import turned_to_even_valences
from recon.geometric_fit.refinement import flip_to_even_valences, split_faces
from recon.geometric_fit.relaxation import relaxed
from recon.geometric_fit.reweighting import reweighed
from recon.geometric_fit.scan_data import refuse_tangles, scan_data
from recon.geometric_fit.sharpening import SharpScan, sharpened
from recon.geometric_fit.updates import Pull, Updater, rows_for
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.subdivision.evaluation import points_at
from recon.subdivision.limit_surface import LimitPatches, Scheme, limit_patches

__all__ = ["FitOptions", "FittedSurface", "fit_surface"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FIRST_SHARE = 0.8  # of the control points are there from the start, the others come where the error is
RAGGED, COARSER = 0.1, 0.7  # loose ends a crease from where on it starts with so much fewer control points
FIRST_QUADS = 0.97  # of quadrilaterals: those are taken from a fit of triangles, which has put them in their places
FIRST_SHARP_QUADS = 0.85  # of them where edges were put back: small faces that come later fold less
ROUNDS = 4  # before each refinement
PEAK_SHARE = 0.3  # of the new points go to the largest errors, the others to the largest sums of squares
FAIRNESS = 1e-3  # weight of the control mesh's own energy, as a share of the data's
STIFFER, STIFFEST = 4.0, 1024.0  # times stiffer where the surface would fold, in one round and in all
EASING = 1.4  # times less stiff a round where it would not
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
        self._weights = self._scan.weights.copy()
        self._record: list[Round] = []

    @property
    def has_edges_put_back(self) -> bool:
        """Whether the scan has sharp edges, which it may have cut off."""
        return len(self._sharp.edges) > 0

    def run(self) -> FittedSurface:
        self._doing("simplifying the scan")
        mesh = self._initial()
        stopped, cycle, last, grows = None, 0, None, not self._options.plain
        while stopped is None:
            final = not grows or mesh.n_vertices >= self._limit
            n_rounds = self._options.rounds if final else ROUNDS
            mesh, patches, feet = self._settled(mesh, cycle, n_rounds)
            errors = norms(self._distances(feet), self._scan.diagonal)
            stopped = self._growth.ended(errors, last, diagonal=self._scan.diagonal, final=final)
            if stopped is None:
                last, cycle, before = errors, cycle + 1, mesh.n_vertices
                mesh = self._refined(mesh, feet, cycle)
                grows = mesh.n_vertices > before or cycle < CYCLES
        if self._options.start is not None:
            self._doing("looking for surface that cuts itself")
            mesh = without_crossings(mesh, patches)
        return self._finished(mesh, patches, feet, stopped)

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
        """The same with its edges marked, coarser while these are ragged; None where none is left of them on the way.

        The simplifier keeps what is ragged at the edges of a sharp scan, if it may; points come later.
        """
        scan, fewest, angle = self._sharp.mesh, count if self._options.plain else 100, self._options.crease_angle
        mesh = first = with_creases(initial_mesh(scan, count), self._sharp, angle)
        while n_loose_ends(mesh) > RAGGED * len(mesh.crease_edges) and count > fewest:
            count = int(COARSER * count)
            try:
                mesh = with_creases(initial_mesh(scan, count), self._sharp, angle)
            except NoControlMesh:
                return None
        return mesh if mesh is first or len(mesh.crease_edges) else None

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

    def _settled(self, mesh: ControlMesh, cycle: int, n_rounds: int) -> tuple[ControlMesh, LimitPatches, Feet]:
        """Some rounds on one control mesh: pull, move, find the feet again."""
        scan = self._scan
        patches = limit_patches(mesh, self._options.scheme)
        guards, borders = Guards(mesh, patches, scan), Borders(mesh, patches, scan)
        # a step is only allowed to keep what is not folded so: start without folds; but where a start was given, tips
        # would be smoothed away with them, and most folds leave in the rounds
        points = mesh.vertices if self._options.start is not None else unfolded(mesh, guards)[0].vertices
        feet = nearest_feet(patches, patches.points @ points, scan.points, step=1e-5)
        usual = FAIRNESS * scan.n_measured / mesh.n_vertices
        stiffness = np.full(mesh.n_vertices, usual)
        energy, updater = fairness(mesh, stiffness), Updater(self._options.update)
        strays: Strays | None = None
        best = ((mesh.n_vertices + 1, np.inf), points, feet)
        for number in range(n_rounds):
            if number % 2 == 0 or strays is None:
                allowed = STRAY * float(np.sqrt(np.mean(self._distances(feet) ** 2)))
                strays = guards.strays(points, allowed)
            pull = self._pull(mesh, patches, (points, feet), (strays, borders.pull(points)))
            step = stepped(guards, points, updater.moved(points, pull._replace(fairness=energy)))
            points = step.points
            if step.folding.any():
                eased = np.maximum(stiffness / EASING, usual)
                stiffness = np.where(step.folding, np.minimum(STIFFER * stiffness, STIFFEST * usual), eased)
                energy = fairness(mesh, stiffness)
            placed = patches.points @ points
            feet = borders.hopped(placed, scan.points, walk_feet(patches, placed, scan.points, feet))
            errors = self._note(mesh, feet)
            # the largest error jumps from round to round where the scan has two sheets close together
            merit = (int(step.folded.sum()), errors.rms * errors.maximum)
            if merit <= best[0]:
                best = merit, points, feet
            if cycle > 0 or self._options.robust:
                self._reweigh(feet)
        return mesh.with_vertices(best[1]), patches, best[2]

    def _distances(self, feet: Feet) -> Floats:
        """(N,) of the measured points."""
        n = self._scan.n_measured
        return np.linalg.norm(feet.positions[:n] - self._scan.points[:n], axis=1)

    def _pull(
        self, mesh: ControlMesh, patches: LimitPatches, at: tuple[Floats, Feet], more: tuple[Strays, BorderPull]
    ) -> Pull:
        """Data points, those of them that pull sideways, and samples that stay where they are in their patches."""
        (control_points, feet), (strays, border) = at, more
        scan, points = self._scan, patches.points @ control_points
        astray = strays.feet
        positions = points_at(patches.arrays, points, astray.patch, astray.v, astray.w, 1)[:, 0]
        beside, conormals = sideways(patches, points, feet)
        again = feet.chosen(beside)._replace(normals=conormals)
        parts = (feet, again, astray._replace(positions=positions), border.feet)
        all_feet = joined(parts)
        targets = np.concatenate([scan.points, scan.points[beside], strays.targets, border.targets])
        # as much as the data points along it
        along = np.sqrt(scan.n_measured / len(control_points)) / 4.0
        others = np.repeat([STRAY_WEIGHT, along], [len(astray.patch), len(border.targets)])
        weights = np.concatenate([self._weights, self._weights[beside], others])
        rows = rows_for(self._options.update, patches, all_feet, _faces(mesh))
        return Pull(rows, targets - all_feet.positions, all_feet.normals, weights, patches.points[:0])

    def _reweigh(self, feet: Feet) -> None:
        """Points far off count more from round to round, up to 37 times: the largest error falls. Or less: robust."""
        distance = np.linalg.norm(feet.positions - self._scan.points, axis=1)
        self._weights = reweighed(self._weights, self._scan, distance, robust=self._options.robust)

    def _note(self, mesh: ControlMesh, feet: Feet) -> Norms:
        errors = norms(self._distances(feet), self._scan.diagonal)
        self._record.append(Round(len(self._record) + 1, mesh.n_vertices, errors, time.perf_counter() - self._begin))
        self._doing(
            f"round {len(self._record)}: {mesh.n_vertices} control points, rms {errors.rms:.4f} %, "
            f"largest {errors.maximum:.3f} %"
        )
        return errors

    def _refined(self, mesh: ControlMesh, feet: Feet, cycle: int) -> ControlMesh:
        """More control points where the error is, and even valences again."""
        n_new = self._growth.more(mesh.n_vertices, cycle)
        worst = self._worst_faces(mesh, feet, n_new)
        if self._options.scheme is not Scheme.LOOP:
            return turned_to_even_valences(refine_quads(mesh, worst, n_new))
        split = split_faces(mesh, worst, n_new)
        flipped = flip_to_even_valences(split)
        # flips even the valences out, but may fold a surface that was smooth before
        folds = [int(self._guards(each).folded(each.vertices).sum()) for each in (flipped, split)]
        return flipped if folds[0] <= folds[1] else split

    def _guards(self, mesh: ControlMesh) -> Guards:
        return Guards(mesh, limit_patches(mesh, self._options.scheme), self._scan)

    def _worst_faces(self, mesh: ControlMesh, feet: Feet, n_new: int) -> Ints:
        distance = self._distances(feet)
        face = np.minimum(feet.patch[: self._scan.n_measured] // 4, mesh.n_faces - 1)
        largest, squares = np.zeros(mesh.n_faces), np.bincount(face, distance**2, mesh.n_faces)
        np.maximum.at(largest, face, distance)
        n_peaks = int(PEAK_SHARE * n_new)
        order = np.concatenate([np.argsort(-largest, kind="stable")[:n_peaks], np.argsort(-squares, kind="stable")])
        _, first = np.unique(order, return_index=True)
        return order[np.sort(first)]

    def _finished(self, mesh: ControlMesh, patches: LimitPatches, feet: Feet, stopped: StoppedBy) -> FittedSurface:
        scan = self._scan
        folds = int(Guards(mesh, patches, scan).folded(mesh.vertices).sum())
        borders, warm = Borders(mesh, patches, scan), feet.chosen(np.arange(scan.n_measured))
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


def _faces(mesh: ControlMesh) -> Ints:
    """(F, k) the control faces, which all have as many corners."""
    return mesh.faces_of(int(mesh.face_starts[1]))


def _most_control_points(scan: TriangleMesh, options: FitOptions) -> int:
    if options.control_points is not None:
        return min(options.control_points, scan.n_vertices)
    return max(scan.n_vertices // (3 if options.tolerance is not None else 20), 4)
