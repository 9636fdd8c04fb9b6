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
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from recon.errors import BadOption, NoSurface
from recon.geometric_fit.convergence import Norms, Round, StoppedBy, norms
from recon.geometric_fit.foot_points import EXACT, Feet, nearest_feet, walk_feet
from recon.geometric_fit.guards import Guards, Strays, fairness, neighbour_means
from recon.geometric_fit.initial_mesh import initial_mesh
from recon.geometric_fit.refinement import flip_to_even_valences, split_faces
from recon.geometric_fit.scan_data import scan_data
from recon.geometric_fit.updates import Pull, Update, Updater
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.numerics.halfedges import opposite_sides
from recon.subdivision.evaluation import points_at
from recon.subdivision.limit_surface import LimitPatches, limit_patches

__all__ = ["FitOptions", "FittedSurface", "fit_surface"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FIRST_SHARE = 0.8  # of the control points are there from the start, the others come where the error is
CYCLES, ROUNDS, LAST_ROUNDS = 4, 4, 6  # refinements, rounds before each, rounds after the last
PEAK_SHARE = 0.3  # of the new points go to the largest errors, the others to the largest sums of squares
FAIRNESS = 1e-3  # weight of the control mesh's own energy, as a share of the data's
STIFFER, STIFFEST = 4.0, 64.0  # times stiffer where the surface folds, in one round and in all
STRAY, STRAY_WEIGHT = 2.5, 0.15  # rms errors from where on surface strays, and what one sample of it weighs
GROWTH = 1.5  # times more control points a cycle, where only a tolerance is given
STAGNATION = 0.01  # a cycle that lowers neither error by this share brings no more
HALVINGS = 3  # of a step that folds the surface
UNFOLDINGS = 12


@dataclass(frozen=True)
class FitOptions:
    """What a user may choose.

    control_points  at most so many; None: as many as the tolerance needs, or a twentieth of the points without one
    tolerance       length that no data point may be off by; None: no limit
    update          the rule by which control points move
    plain           all control points from the start, six rounds, no refinement and no reweighting
    Raises  BadOption.
    """

    control_points: int | None = None
    tolerance: float | None = None
    update: Update = Update.TANGENT
    plain: bool = False

    def __post_init__(self) -> None:
        if self.control_points is not None and self.control_points < 4:
            raise BadOption("--control-points", f"a closed surface needs 4, not {self.control_points}")
        if self.tolerance is not None and not 0 < self.tolerance < np.inf:
            raise BadOption("--tolerance", f"must be a positive length, not {self.tolerance}")


@dataclass(frozen=True, eq=False)
class FittedSurface:
    """What was found.

    mesh        the control mesh of the Loop surface
    distances   (N,) of the scan's vertices from the surface, foot points exact
    errors      their norms in per cent of the diagonal
    diagonal    of the box around the scan
    rounds      the record, one row a round
    stopped_by  what ended the fit
    folds       control points whose faces still fold where the scan does not
    """

    mesh: ControlMesh
    distances: Floats
    errors: Norms
    diagonal: float
    rounds: tuple[Round, ...]
    stopped_by: StoppedBy
    folds: int


def fit_surface(
    scan: TriangleMesh, options: FitOptions | None = None, *, doing: Callable[[str], None] = lambda step: None
) -> FittedSurface:
    """The Loop surface nearest to a scan.

    scan     triangles of a closed surface
    doing    called with what happens, round by round
    Raises   NoSurface, NoControlMesh, BadOption.
    Paper    [maekawa2009].
    """
    chosen = options or FitOptions()
    if scan.n_faces < 4:
        raise NoSurface(f"{scan.name} has {scan.n_faces} triangles; a surface cannot be fitted to so few.")
    n_open = int((opposite_sides(scan.face_vertices) < 0).sum())
    if n_open:
        raise NoSurface(
            f"{scan.name} has {n_open} open edges, and only closed scans are fitted so far; close its holes."
        )
    # the matrices are small: threads of the linear algebra library wait for each other longer than they work
    with threadpool_limits(limits=1, user_api="blas"):
        return _Fit(scan, chosen, doing).run()


class _Fit:
    """One run: the scan, what has been reached, and the record."""

    def __init__(self, scan: TriangleMesh, options: FitOptions, doing: Callable[[str], None]) -> None:
        self._begin = time.perf_counter()
        self._options, self._doing = options, doing
        self._limit = _most_control_points(scan, options)
        self._scan = scan_data(scan, self._limit)
        self._weights = self._scan.weights.copy()
        self._record: list[Round] = []

    def run(self) -> FittedSurface:
        self._doing("simplifying the scan")
        mesh = flip_to_even_valences(initial_mesh(self._scan.mesh, self._first_count()))
        stopped, cycle, last = None, 0, None
        while stopped is None:
            final = self._options.plain or mesh.n_vertices >= self._limit
            mesh, patches, feet = self._settled(mesh, cycle, LAST_ROUNDS if final else ROUNDS)
            errors = norms(self._distances(feet), self._scan.diagonal)
            stopped = self._end(errors, last, final)
            if stopped is None:
                last, cycle = errors, cycle + 1
                mesh = self._refined(mesh, feet, cycle)
        return self._finished(mesh, patches, feet, stopped)

    def _first_count(self) -> int:
        if self._options.plain:
            return self._limit
        if self._options.control_points is None and self._options.tolerance is not None:
            return max(min(self._scan.n_measured // 100, self._limit), 100)
        return max(int(FIRST_SHARE * self._limit), 4)

    def _end(self, errors: Norms, last: Norms | None, final: bool) -> StoppedBy | None:
        tolerance = self._options.tolerance
        if tolerance is not None and errors.maximum / 100.0 * self._scan.diagonal <= tolerance:
            return StoppedBy.TOLERANCE
        if final:
            return StoppedBy.ROUNDS if self._options.plain else StoppedBy.CONTROL_POINTS
        # a number of control points that was asked for is used; growth toward a tolerance ends where it brings nothing
        if (
            self._options.control_points is None
            and last is not None
            and all(now > (1.0 - STAGNATION) * then for now, then in zip(errors[1:], last[1:]))
        ):
            return StoppedBy.STAGNATION
        return None

    def _settled(self, mesh: ControlMesh, cycle: int, n_rounds: int) -> tuple[ControlMesh, LimitPatches, Feet]:
        """Some rounds on one control mesh: pull, move, find the feet again."""
        scan = self._scan
        patches = limit_patches(mesh)
        guards = Guards(mesh, patches, scan)
        # a step is only allowed to keep what is not folded so: start without folds
        points = _unfolded(mesh, guards)[0].vertices
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
            pull = self._pull(patches, points, feet, strays)._replace(faces=mesh.faces_of(3), fairness=energy)
            points, folded = _stepped(guards, points, updater.moved(patches, points, pull))
            if folded.any():
                stiffness[folded] = np.minimum(STIFFER * stiffness[folded], STIFFEST * usual)
                energy = fairness(mesh, stiffness)
            feet = walk_feet(patches, patches.points @ points, scan.points, feet)
            errors = self._note(mesh, feet)
            # the largest error jumps from round to round where the scan has two sheets close together
            merit = (int(folded.sum()), errors.rms * errors.maximum)
            if merit <= best[0]:
                best = merit, points, feet
            if cycle > 0:
                self._reweigh(feet)
        return mesh.with_vertices(best[1]), patches, best[2]

    def _distances(self, feet: Feet) -> Floats:
        """(N,) of the measured points."""
        n = self._scan.n_measured
        return np.linalg.norm(feet.positions[:n] - self._scan.points[:n], axis=1)

    def _pull(self, patches: LimitPatches, control_points: Floats, feet: Feet, strays: Strays) -> Pull:
        """Data points and straying samples together; the samples stay where they are in their patches."""
        at = strays.feet
        positions = points_at(patches.arrays, patches.points @ control_points, at.patch, at.v, at.w, 1)[:, 0]
        both = Feet(*(np.concatenate(pair) for pair in zip(feet, at._replace(positions=positions))))
        targets = np.concatenate([self._scan.points, strays.targets])
        weights = np.concatenate([self._weights, np.full(len(at.patch), STRAY_WEIGHT)])
        return Pull(both, targets, weights, np.empty((0, 3), dtype=np.int64), patches.points[:0])

    def _reweigh(self, feet: Feet) -> None:
        """Points far off count more from round to round, up to 37 times: the largest error falls."""
        distance = np.linalg.norm(feet.positions - self._scan.points, axis=1)
        spread = float(np.sqrt(np.mean(self._distances(feet) ** 2)))
        far = np.minimum(distance / max(3.0 * spread, 1e-300), 6.0) ** 2
        self._weights = 0.5 * self._weights + 0.5 * self._scan.weights * (1.0 + far)

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
        left = self._limit - mesh.n_vertices
        if self._options.control_points is None and self._options.tolerance is not None:
            n_new = min(int((GROWTH - 1.0) * mesh.n_vertices) + 1, left)
        else:
            n_new = min(-(-left // max(CYCLES + 1 - cycle, 1)), left)
        return flip_to_even_valences(split_faces(mesh, self._worst_faces(mesh, feet, n_new), n_new))

    def _worst_faces(self, mesh: ControlMesh, feet: Feet, n_new: int) -> Ints:
        distance = self._distances(feet)
        face = feet.patch[: self._scan.n_measured] // 4
        largest, squares = np.zeros(mesh.n_faces), np.bincount(face, distance**2, mesh.n_faces)
        np.maximum.at(largest, face, distance)
        n_peaks = int(PEAK_SHARE * n_new)
        order = np.concatenate([np.argsort(-largest, kind="stable")[:n_peaks], np.argsort(-squares, kind="stable")])
        _, first = np.unique(order, return_index=True)
        return order[np.sort(first)]

    def _finished(self, mesh: ControlMesh, patches: LimitPatches, feet: Feet, stopped: StoppedBy) -> FittedSurface:
        scan = self._scan
        mesh, folds = _unfolded(mesh, Guards(mesh, patches, scan))
        measured = scan.points[: scan.n_measured]
        points = patches.points @ mesh.vertices
        n = scan.n_measured
        warm = Feet(feet.patch[:n], feet.v[:n], feet.w[:n], feet.positions[:n], feet.normals[:n])
        found = (nearest_feet(patches, points, measured), walk_feet(patches, points, measured, warm, step=EXACT))
        # two starts, as either may end at a point that is nearest only among its neighbours
        distances = np.minimum(*(np.linalg.norm(each.positions - measured, axis=1) for each in found))
        errors = norms(distances, scan.diagonal)
        return FittedSurface(mesh, distances, errors, scan.diagonal, tuple(self._record), stopped, folds)


def _most_control_points(scan: TriangleMesh, options: FitOptions) -> int:
    if options.control_points is not None:
        return min(options.control_points, scan.n_vertices)
    return max(scan.n_vertices // (3 if options.tolerance is not None else 20), 4)


def _stepped(guards: Guards, old: Floats, new: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """The control points after the step, shortened where it would fold the surface, and which of them still fold.

    Where halving does not help, the step is taken back: what did not fold before does not fold after.
    """
    kept = np.zeros(len(old), dtype=bool)
    folded = guards.folded(new)
    for number in range(2 * HALVINGS):
        if not folded.any():
            break
        if number < HALVINGS:
            new = np.where(folded[:, None], 0.5 * (old + new), new)
        else:
            kept |= folded
            new = np.where(kept[:, None], old, new)
        folded = guards.folded(new)
    return new, folded


def _unfolded(mesh: ControlMesh, guards: Guards) -> tuple[ControlMesh, int]:
    """Control points of faces that still fold go toward their neighbours' mean until none does, or it does not help."""
    means, points = neighbour_means(mesh), mesh.vertices
    for _ in range(UNFOLDINGS):
        folded = guards.folded(points)
        if not folded.any():
            break
        points = np.where(folded[:, None], 0.5 * (points + means @ points), points)
    return mesh.with_vertices(points), int(folded.sum())
