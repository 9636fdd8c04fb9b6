"""The pottery paper's own way to the missing piece: box, sections, boundary curves, bicubic patch, fit, trim.

    wall, hole's edge --> box --> 90 turns, each: 4 sections, 4 curves, 1 patch --> the patch nearest to the wall
                                                                                        |
    sheet  <--  trim loop  <--  B-spline surface fitted to the samples along the edge  <-'

Paper  [kinoshita], sections 3.2 and 3.4.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import degrees, radians

import numpy as np
from numpy.typing import NDArray

from recon.errors import NoSurface
from recon.geometry.bspline import BSplineSurface
from recon.geometry.trimmed import TrimmedSurface
from recon.hole_patch.bicubic import base_surface, extended, mean_distance
from recon.hole_patch.boundary_curves import boundary_ordinates
from recon.hole_patch.box import SAMPLE_RADIUS, Box, box_through, edge_box, find_picks
from recon.hole_patch.cutting_planes import cut_sides, near_wall
from recon.hole_patch.fitting import distances_from, edge_samples, fit_surface
from recon.hole_patch.picks import snapped_picks
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.surroundings import BRIDGE, Wall
from recon.hole_patch.trim_loop import trim_loop

__all__ = ["BasePatch", "base_patch", "box_sheet"]

Floats = NDArray[np.float64]
TURNS = 90
EXTENSION = 0.1
GOOD_COVERAGE, LEAST_COVERAGE = 0.75, 0.2


@dataclass(frozen=True, eq=False)
class BasePatch:
    """The best of the base patches.

    surface        bicubic Bezier patch over the box's rectangle
    box            as it was turned
    angle_deg      by how much it was turned
    mean_distance  of the wall's vertices inside the box from the patch, in millimetres
    is_narrow      whether the box was narrowed to the hole's edge, so that the patch hardly reaches beyond it
    notes          sentences about what was done differently than in the paper
    """

    surface: BSplineSurface
    box: Box
    angle_deg: float
    mean_distance: float
    is_narrow: bool
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Candidate:
    ordinates: Floats
    box: Box
    angle: float
    distance: float
    coverage: float


def box_sheet(wall: Wall, *, picks: Floats | None = None, acceptance: float = 0.5) -> Sheet:
    """The missing piece's wall as the paper makes it.

    picks       (3, 3) points on the wall whose circle surrounds the hole, or None to find them
    acceptance  largest mean distance of the surface from the samples along the edge, in millimetres
    Raises      NoSurface when no box, no surface or no trim loop can be made; BadOption when the picks are of no use.
    Paper       [kinoshita], sections 3.2 and 3.4.
    """
    base = base_patch(wall, picks=picks)
    samples = edge_samples(wall)
    start = extended(base.surface, EXTENSION) if base.is_narrow else base.surface
    fitted = fit_surface(start, samples, acceptance=acceptance)
    loop = trim_loop(fitted.surface, wall.edge.points)
    measured = wall.edge.points[wall.edge.sherds != BRIDGE]
    return Sheet(
        trimmed=TrimmedSurface(fitted.surface, (loop,)),
        edge_distance=distances_from(fitted.surface, measured),
        samples=len(samples),
        sides=4,
        box_angle_deg=base.angle_deg,
        base=base.surface,
        notes=base.notes,
    )


def base_patch(wall: Wall, *, picks: Floats | None = None) -> BasePatch:
    """The bicubic patch, of 90 turns of the box, that lies nearest to the wall inside the box.

    Raises  NoSurface when at every angle a side of the box misses the wall; BadOption when the picks are of no use.
    Paper   [kinoshita], section 3.2.
    """
    picks = find_picks(wall) if picks is None else snapped_picks(picks, wall)
    candidates = [] if picks is None else list(_turns(wall, box_through(picks, wall)))
    notes = []
    is_narrow = not any(c.coverage >= GOOD_COVERAGE for c in candidates)
    if is_narrow:
        candidates = list(_turns(wall, edge_box(wall), narrow=True))
        notes.append("the box is wider than the wall around the hole and was narrowed to the hole's edge")
    best = _best(candidates)
    if best.coverage < GOOD_COVERAGE:
        notes.append(f"one side of the box meets the wall over {best.coverage:.0%} of its length only")
    surface = base_surface(best.ordinates, best.box)
    return BasePatch(surface, best.box, degrees(best.angle), best.distance, is_narrow, tuple(notes))


def _turns(wall: Wall, box: Box, *, narrow: bool = False) -> Iterator[_Candidate]:
    """One candidate for every degree at which all four sides meet the wall."""
    near = near_wall(wall, box)
    for step in range(TURNS):
        angle = radians(step)
        turned = box.turned(angle)
        if narrow:
            turned = turned.narrowed(wall.edge.points, SAMPLE_RADIUS)
        sections = cut_sides(near, turned)
        coverage = min(section.coverage() for section in sections)
        if coverage >= LEAST_COVERAGE:
            ordinates = boundary_ordinates(sections)
            distance = mean_distance(ordinates, turned, turned.local(near.vertices), near.trust)
            yield _Candidate(ordinates, turned, angle, distance, coverage)


def _best(candidates: list[_Candidate]) -> _Candidate:
    """The nearest to the wall among those whose sides are well covered, or among all when none is."""
    if not candidates:
        raise NoSurface(
            "however the box around the hole is turned, one of its sides misses the wall; the hole is too wide for its"
            " vessel or lies at the rim."
        )
    good = [c for c in candidates if c.coverage >= GOOD_COVERAGE]
    return min(good or candidates, key=lambda c: c.distance)
