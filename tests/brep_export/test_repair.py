"""Repair mends what the gate names, lists each change, and leaves sound shapes and its argument alone."""

import pytest
from kernel_shapes import box, compound, faces, reversed_faces, shell, solid, sound_shapes
from OCP.TopoDS import TopoDS_Shape

from brep_export.check import check
from brep_export.repair import repair
from recon.tolerance import Tolerance

TOLERANCE = Tolerance()
SOUND = sound_shapes()


@pytest.mark.parametrize("name", SOUND)
def test_a_sound_shape_has_nothing_to_change(name: str) -> None:
    _, changes = repair(SOUND[name], TOLERANCE)
    assert changes == []


def turned_over() -> TopoDS_Shape:
    parts = faces(box())
    return solid(shell([parts[0].Reversed(), *parts[1:]]))


BROKEN = {
    # the kernel turns the five others to match the one, and the body comes out inside out at first
    "face turned over": (turned_over(), {"face-turned", "solid-turned"}),
    "inside out": (solid(shell(reversed_faces(box()))), {"solid-turned"}),
    "marked open": (solid(shell(faces(box()), marked_closed=False)), {"shell-marked"}),
    "shell of a solid": (shell(faces(box())), {"solid-made"}),
    "two, one inside out": (compound(box(), solid(shell(reversed_faces(box(at=(50, 0, 0)))))), {"solid-turned"}),
}


@pytest.mark.parametrize("name", BROKEN)
def test_each_break_is_mended_and_named(name: str) -> None:
    shape, codes = BROKEN[name]
    before = [d.code for d in check(shape, TOLERANCE).defects]
    mended, changes = repair(shape, TOLERANCE)
    assert {change.code for change in changes} == codes
    assert check(mended, TOLERANCE).defects == ()
    assert before and [d.code for d in check(shape, TOLERANCE).defects] == before


def test_what_cannot_be_mended_is_left_for_the_gate() -> None:
    open_solid = solid(shell(faces(box())[1:], marked_closed=False))
    mended, _ = repair(open_solid, TOLERANCE)
    assert "shell-open" in {d.code for d in check(mended, TOLERANCE).defects}
