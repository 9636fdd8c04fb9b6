"""Which road leads to the sheet over a hole: the wheel, or the box where the vessel is not round."""

from recon.errors import NoSurface
from recon.hole_patch.axis import KEPT_TO
from recon.hole_patch.options import PatchMethod, PatchOptions
from recon.hole_patch.surroundings import Axis, Surroundings, Wall
from recon.hole_patch.wheel_sheet import fit_wall

__all__ = ["road"]

LEAST_SUPPORT = 0.75  # of the turn; half a vessel has 0.5, one squashed by a tenth 0.4, round ones 0.9 to 1; below it
# the wall around the hole must bear the wheel out
FARTHER = 3.0  # times as far off is the middle of a hole, on vessels bent in the tests, as left-out wall beside it
WORTH_A_WORD = 0.25  # mm, more than a thrown wall is out of round by itself


def road(around: Surroundings, options: PatchOptions) -> tuple[PatchMethod, tuple[str, ...]]:
    """The method by which a hole is covered, and what is to be said of it.

    Raises  NoSurface where neither the wheel nor the wall around the hole foretells it.
    """
    axis = around.axis
    if axis is None or options.method is PatchMethod.BOX:
        reason = "the vessel is not round, so no wheel tells what the hole held: the box is used."
        return PatchMethod.BOX, () if options.method is PatchMethod.BOX else (reason,)
    if axis.support < LEAST_SUPPORT:
        return options.method, (_bent_but_foretold(around.outer, axis),)
    if axis.quality > WORTH_A_WORD:
        note = f"the wall stands off from the wheel by {axis.quality:.2f} mm (root mean square); so may the piece."
        return options.method, (note,)
    return options.method, ()


def _bent_but_foretold(wall: Wall, axis: Axis) -> str:
    """What to say of a vessel that is not round, where left-out wall around the hole is still foretold from the rest.

    Raises  NoSurface where it is not, by the measure that decides whether a wall keeps to the wheel.
    """
    foretold = fit_wall(wall, axis).residual.foretold
    allowed = KEPT_TO * float(axis.cylindrical(wall.edge.points)[:, 1].mean())
    keeps = f"the wall keeps to the wheel over {axis.support:.0%} of the turn only"
    if foretold > allowed:
        raise NoSurface(
            f"The vessel is not round, or too much of it is missing: {keeps} ({LEAST_SUPPORT:.0%} needed), it stands"
            f" off by {axis.quality:.2f} mm (root mean square), and left-out wall around the hole was missed by"
            f" {foretold:.2f} mm on average (allowed {allowed:.2f}). The box method needs no wheel (--method box, with"
            " --hole or --picks), but knows less."
        )
    return (
        f"the vessel is not round: {keeps}. Left-out wall around the hole was foretold to {foretold:.2f} mm on average;"
        f" expect the piece to be off by up to {FARTHER * foretold:.2f} mm on average."
    )
