"""From a scan to a subdivision surface, step by step as in [maekawa2009].

    1. initial mesh   the scan simplified by quadric error, edges flipped toward even valences
    2. foot points    nearest points of the limit surface, for every point of the scan
    3. move           control points move by the error vectors; by which rule, `Update` says
    4. errors         mean, root mean square and largest distance
    5. refine         after some rounds, control points where the error is, until the tolerance or their number is met

Beside the paper: the rounds of a dense scan are on points that stand for others (`sampling`), points far off count more
from cycle to cycle, and surface that strays from the scan or folds is pulled back (`guards`).
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from recon.errors import BadGeometry, NoSurface
from recon.geometric_fit.borders import Borders
from recon.geometric_fit.convergence import StoppedBy, norms
from recon.geometric_fit.creases import n_loose_ends, with_creases
from recon.geometric_fit.crossings import without_crossings
from recon.geometric_fit.exact_distances import Seen, exact_distances, seen
from recon.geometric_fit.folding import unfolded
from recon.geometric_fit.foot_points import Feet, Places, seed_feet, surface_samples
from recon.geometric_fit.growth import CYCLES, Growth
from recon.geometric_fit.guards import Guards
from recon.geometric_fit.hole_filling import close_holes
from recon.geometric_fit.initial_mesh import NoControlMesh, initial_mesh
from recon.geometric_fit.options import FitOptions, FittedSurface
from recon.geometric_fit.quad_mesh import initial_quads
from recon.geometric_fit.quad_splits import refine_quads
from recon.geometric_fit.quad_turns import turned_to_even_valences
from recon.geometric_fit.refinement import flip_to_delaunay, flip_to_even_valences, split_faces
from recon.geometric_fit.relaxation import relaxed
from recon.geometric_fit.sampling import Sample, joined_by, sample_of
from recon.geometric_fit.scan_data import refuse_tangles, scan_data
from recon.geometric_fit.settling import Ground, Rounds
from recon.geometric_fit.sharpening import SharpScan, sharpened
from recon.geometric_fit.slits import with_slits
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.subdivision.limit_surface import Scheme, limit_patches, limit_points

__all__ = ["FitOptions", "FittedSurface", "fit_surface"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

FIRST_SHARE = 0.8  # of the control points are there from the start, the others come where the error is
RAGGED, COARSER = 0.1, 0.7  # loose ends a crease from where on it starts with so much fewer control points
FEWEST = 100  # control points at which no fewer are tried
COARSEST = 0.5  # of them, or so many: a scan that is ragged still is rough, and has no edges worth fewer points
FIRST_QUADS = 0.97  # of quadrilaterals: those are taken from a fit of triangles, which has put them in their places
FIRST_SHARP_QUADS = 0.85  # of them where edges were put back: small faces that come later fold less
ROUNDS = 4  # before each refinement
FINAL_ROUNDS, REFINED_ROUNDS = 6, 12  # on the last control mesh where nobody says how many
LAST_ROUNDS = 2  # when all points far off have joined the sample
FAR = 2.0  # root mean squares from where on they do
PEAK_SHARE = 0.3  # of the new points go to the largest errors, the others to the largest sums of squares
FEWER = (1.0, 0.95, 0.9, 0.85, 0.8)  # of the control points asked for, where a surface with sharp edges folds
FEW_FEWER = (1.0, 0.99, 0.97)  # the same of one without
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
    if options.start is not None:
        return _Fit(scan, options, doing).run()
    if options.crease_angle >= np.pi:
        return _smooth(scan, options, doing)
    attempts: list[FittedSurface] = []
    for attempt in _fewer(options, FEWER):
        run = _Fit(scan, attempt, doing)
        try:
            found = run.run()
        except BadGeometry:  # edges that lie so close to each other that no limit is defined between them
            break
        if not run.has_creases:
            return _best([*attempts, _smooth(scan, attempt, doing, found)])
        if run.has_edges_put_back and not found.folds:
            return found
        attempts.append(found)
        if not run.has_edges_put_back:
            break
        doing("fitting again with fewer control points, as the surface folds at a sharp edge")
    doing("fitting again without sharp edges")
    return _best([*attempts, _smooth(scan, options, doing)])


def _smooth(
    scan: TriangleMesh, options: FitOptions, doing: Callable[[str], None], first: FittedSurface | None = None
) -> FittedSurface:
    """The fit without sharp edges; a few more tries where it folds, but for a plain one.

    first  what the first try has come to, if it was made
    """
    attempts = [] if first is None else [first]
    shares = (1.0,) if options.plain else FEW_FEWER
    for attempt in _fewer(replace(options, crease_angle=float(np.pi)), shares)[len(attempts) :]:
        if attempts and not attempts[-1].folds:
            break
        if attempts:
            doing("fitting again with fewer control points, as the surface folds")
        attempts.append(_Fit(scan, attempt, doing).run())
    return _best(attempts)


def _fewer(options: FitOptions, shares: Sequence[float]) -> list[FitOptions]:
    """What was asked for, then the same with somewhat fewer control points: other points, other triangles between them.

    Where no number was asked for there is nothing to take fewer of.
    """
    if options.control_points is None:
        return [options]
    counts = (max(int(share * options.control_points), 4) for share in shares)
    return [replace(options, control_points=count) for count in counts]


def _best(attempts: Sequence[FittedSurface]) -> FittedSurface:
    return min(attempts, key=lambda fit: fit.errors.rms * (FOLD_COST if fit.folds else 1.0))


class _Fit:
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

    @property
    def has_edges_put_back(self) -> bool:
        """Whether the scan has sharp edges, which it may have cut off."""
        return len(self._sharp.edges) > 0

    def run(self) -> FittedSurface:
        self._doing("simplifying the scan")
        ground = self._ground(self._initial())
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
                ground = self._refined(mesh, found, cycle)
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

    def _initial(self) -> ControlMesh:
        """The control mesh to start from."""
        if self._options.start is not None:
            return self._options.start
        if self._options.scheme is Scheme.LOOP:
            mesh = self._triangles(self._first_count())
            self.has_creases = len(mesh.crease_edges) > 0
            return mesh
        triangles = self._triangles if self._options.plain else self._fitted_triangles
        quads = initial_quads(triangles, self._first_count(), evened=self._evened)
        self.has_creases = len(quads.crease_edges) > 0
        slit = self._slit(quads)
        return slit if slit.n_vertices <= self._limit else quads

    def _evened(self, quads: ControlMesh) -> ControlMesh:
        """Even valences, and even spacing between sharp edges."""
        return relaxed(quads, self._sharp.mesh) if len(quads.crease_edges) else turned_to_even_valences(quads)

    def _slit(self, quads: ControlMesh) -> ControlMesh:
        """The mesh as Doo-Sabin's scheme needs it at concave corners."""
        return with_slits(quads) if self._options.scheme is Scheme.DOO_SABIN else quads

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
        least = max(FEWEST, int(COARSEST * count))
        while count > least:
            count = int(COARSER * count)
            try:
                mesh = with_creases(initial_mesh(self._sharp.mesh, count), self._sharp, angle)
            except NoControlMesh:
                return None
            if not _is_ragged(mesh):
                return mesh if len(mesh.crease_edges) else None
        return None

    def _fitted_triangles(self, count: int) -> ControlMesh:
        """The control mesh of a Loop surface: its points are where the error was, its valences even."""
        angle, robust = self._options.crease_angle, self._options.robust
        options = FitOptions(control_points=count, crease_angle=angle, robust=robust)
        mesh = _Fit(self._whole, options, self._doing).run().mesh
        folds_at_edges = self._options.scheme is Scheme.DOO_SABIN and len(mesh.crease_edges) > 0
        return _on_its_surface(mesh) if folds_at_edges or self._scan.is_open else mesh

    def _first_count(self) -> int:
        if self._options.plain:
            return self._limit
        if self._growth.toward_tolerance:
            return max(min(self._scan.n_measured // 100, self._limit), 100)
        share = FIRST_SHARE
        if self._options.scheme is not Scheme.LOOP:
            share = FIRST_SHARP_QUADS if self.has_edges_put_back else FIRST_QUADS
        return max(int(share * self._limit), 4)

    def _ground(self, mesh: ControlMesh) -> Ground:
        patches = limit_patches(mesh, self._options.scheme)
        borders = Borders(mesh, patches, self._scan, has_slits=self._options.scheme is Scheme.DOO_SABIN)
        return Ground(mesh, patches, Guards(mesh, patches, self._scan), borders)

    def _refined(self, mesh: ControlMesh, found: Seen, cycle: int) -> Ground:
        """More control points where the error is, and even valences again.

        Where new points fold the surface for good, faces around are left as they are.
        """
        n_new = self._growth.more(mesh.n_vertices, cycle)
        worst = self._worst_faces(mesh, found, n_new)
        ground = self._with_fewer_folds(*self._split(mesh, worst, n_new))
        folded = _folded_for_good(ground)
        if not folded.any():
            return ground
        corners = mesh.faces_of(int(mesh.face_starts[1]))[worst]
        apart = worst[~np.isin(corners, np.flatnonzero(folded)).any(axis=1)]
        again = self._with_fewer_folds(*self._split(mesh, apart, n_new))
        return again if _folded_for_good(again).sum() < folded.sum() else ground

    def _with_fewer_folds(self, split: ControlMesh, evened: ControlMesh) -> Ground:
        """The second of these meshes, unless the surface folds more there.

        Flips even the valences out, but may fold a surface that was smooth before. Catmull-Clark's surfaces come out of
        such folds in the rounds, and are nearer for even valences.
        """
        flipped = self._ground(evened)
        n_folded = flipped.n_folded()
        if n_folded == 0 or self._options.scheme is Scheme.CATMULL_CLARK:
            return flipped
        del flipped
        plain = self._ground(split)
        if n_folded > plain.n_folded():
            return plain
        del plain
        return self._ground(evened)

    def _split(self, mesh: ControlMesh, worst: Ints, n_new: int) -> tuple[ControlMesh, ControlMesh]:
        """The worst faces split, by as many points as there are left when corners have become concave; and the same
        with even valences."""
        if self._options.scheme is Scheme.LOOP:
            split = split_faces(mesh, worst, n_new)
            return split, _flipped(split)
        most = mesh.n_vertices + n_new
        while True:
            split = refine_quads(mesh, worst, n_new)
            evened = turned_to_even_valences(split)
            slit, slit_evened = self._slit(split), self._slit(evened)
            excess = max(slit.n_vertices, slit_evened.n_vertices) - most
            if excess <= 0:
                return slit, slit_evened
            if excess >= n_new:
                return split, evened
            n_new -= excess

    def _worst_faces(self, mesh: ControlMesh, found: Seen, n_new: int) -> Ints:
        n = self._scan.n_measured
        distance, face = found.distances[:n], np.minimum(found.places.patch[:n] // 4, mesh.n_faces - 1)
        largest, squares = np.zeros(mesh.n_faces), np.bincount(face, distance**2, mesh.n_faces)
        np.maximum.at(largest, face, distance)
        n_peaks = int(PEAK_SHARE * n_new)
        order = np.concatenate([np.argsort(-largest, kind="stable")[:n_peaks], np.argsort(-squares, kind="stable")])
        _, first = np.unique(order, return_index=True)
        return order[np.sort(first)]

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


def _on_its_surface(triangles: ControlMesh) -> ControlMesh:
    """The mesh with every point on the Loop surface; where that bends, its control points lie beside it."""
    faces = triangles.faces_of(3)
    vertices, corner = np.unique(faces, return_index=True)
    v, w = (np.where(corner % 3 == i, 1.0, 0.0) for i in (1, 2))
    points = triangles.vertices.copy()
    points[vertices] = limit_points(triangles, (corner // 3, v, w))[:, 0]
    return triangles.with_vertices(points)


def _flipped(mesh: ControlMesh) -> ControlMesh:
    """Even valences; between sharp edges no slivers, which fold sooner than uneven valences do harm."""
    return flip_to_delaunay(mesh) if len(mesh.crease_edges) else flip_to_even_valences(mesh)


def _folded_for_good(ground: Ground) -> Bools:
    """(V,) the control points around folds that are left when these have been smoothed out as far as that goes."""
    return ground.guards.folded(unfolded(ground.mesh, ground.guards)[0].vertices)


def _is_ragged(mesh: ControlMesh) -> bool:
    """Whether many creases lead nowhere."""
    return n_loose_ends(mesh) > RAGGED * len(mesh.crease_edges)


def _most_control_points(scan: TriangleMesh, options: FitOptions) -> int:
    if options.control_points is not None:
        return min(options.control_points, scan.n_vertices)
    return max(scan.n_vertices // (3 if options.tolerance is not None else 20), 4)
