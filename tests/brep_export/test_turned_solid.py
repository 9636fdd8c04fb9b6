"""Solids of revolution of known volume."""

from itertools import pairwise

import numpy as np
import pytest

from brep_export.analytic import face_kinds
from brep_export.check import ShapeKind, check
from brep_export.measures import measure
from brep_export.step import write_step
from brep_export.turned import turned_solid
from recon.geometry.bspline import BSplineCurve
from recon.geometry.turned import ProfileArc, ProfileLine, ProfileSpline, TurnedPart
from recon.tolerance import Tolerance

AXIS = np.array([0.48, 0.6, 0.64])


def p(r, z):
    return np.array([float(r), float(z)])


def line(*points):
    return tuple(ProfileLine(p(*a), p(*b)) for a, b in pairwise(points))


PARTS = {
    "pin with a round head": (
        (*line((0, 0), (2, 0), (2, 5)), ProfileArc(p(2, 5), p(np.sqrt(2), 5 + np.sqrt(2)), p(0, 7)),
         *line((0, 7), (0, 0))),
    ),
    "ring with a round void": (
        line((4, 0), (9, 0), (9, 5), (4, 5), (4, 0)),
        (ProfileArc(p(7.5, 2.5), p(6.5, 1.5), p(5.5, 2.5)), ProfileArc(p(5.5, 2.5), p(6.5, 3.5), p(7.5, 2.5))),
    ),
    "cone of a straight spline": (
        (*line((0, 0), (3, 0)), ProfileSpline(BSplineCurve(1, np.array([0.0, 0, 1, 1]), np.array([[3.0, 0], [0, 6]]))),
         *line((0, 6), (0, 0))),
    ),
}  # fmt: skip
VOLUMES = {
    "pin with a round head": np.pi * 4 * 5 + 2 / 3 * np.pi * 8,
    "ring with a round void": np.pi * (81 - 16) * 5 - 2 * np.pi**2 * 6.5,
    "cone of a straight spline": np.pi * 9 * 6 / 3,
}


@pytest.mark.parametrize("name", PARTS)
def test_a_turned_profile_is_a_sound_solid_of_the_volume_that_guldin_gives(name):
    shape = turned_solid(TurnedPart(np.array([1.0, -2.0, 3.0]), AXIS, PARTS[name]))
    report = check(shape, Tolerance(merge=1e-4, fit=1e-3), expect=ShapeKind.SOLID)
    assert report.passed, report.defects
    assert report.as_json()["volume"] == pytest.approx(VOLUMES[name], rel=1e-4)


def test_lines_and_arcs_give_planes_cylinders_and_spheres():
    kinds = face_kinds(turned_solid(TurnedPart(np.zeros(3), AXIS, PARTS["pin with a round head"])))
    assert (kinds["planes"], kinds["cylinders"], kinds["spheres"], sum(kinds.values())) == (1, 1, 1, 3)


def test_a_turned_spline_has_its_area_and_keeps_it_in_a_file(tmp_path):
    z = np.linspace(0.0, 20.0, 41)
    bent = BSplineCurve(
        3, np.concatenate([[0.0] * 4, z[2:-2], [20.0] * 4]), np.column_stack([5.0 + np.sin(z) * (z % 1.0), z])
    )
    (r0, z0), (r1, z1) = bent.point(np.array([0.0, 20.0]))
    loop = (*line((0, z0), (r0, z0)), ProfileSpline(bent), *line((r1, z1), (0, z1), (0, z0)))
    shape = turned_solid(TurnedPart(np.zeros(3), AXIS, (loop,)))
    t = np.linspace(0.0, 20.0, 200_001)
    r, length = bent.point(t)[:, 0], np.linalg.norm(np.diff(bent.point(t), axis=0), axis=1)
    side = 2.0 * np.pi * float((0.5 * (r[1:] + r[:-1]) * length).sum())
    assert measure(shape).area == pytest.approx(side + np.pi * (r0**2 + r1**2), rel=1e-5)
    assert write_step(shape, tmp_path / "turned.step").same
