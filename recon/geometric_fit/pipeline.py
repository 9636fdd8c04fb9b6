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
from threadpoolctl import threadpool_limits

from recon.errors import BadGeometry, NoSurface
from recon.geometric_fit.fit_run import FitRun
from recon.geometric_fit.options import FitOptions, FittedSurface
from recon.geometric_fit.scan_data import refuse_tangles
from recon.geometry.mesh import TriangleMesh

__all__ = ["FitOptions", "FittedSurface", "fit_surface"]

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
        return FitRun(scan, options, doing).run()
    if options.crease_angle >= np.pi:
        return _smooth(scan, options, doing)
    attempts: list[FittedSurface] = []
    for attempt in _fewer(options, FEWER):
        run = FitRun(scan, attempt, doing)
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
        attempts.append(FitRun(scan, attempt, doing).run())
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
