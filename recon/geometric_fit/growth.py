"""When a fit of a surface ends, and by how many control points it grows until then."""

from dataclasses import dataclass

from recon.geometric_fit.convergence import Norms, StoppedBy

__all__ = ["CYCLES", "Growth"]

CYCLES = 4  # refinements of a fit to a number of control points
GROWTH = 1.5  # times more control points a cycle, where only a tolerance is given
STAGNATION = 0.01  # a cycle that lowers neither error by this share brings no more


@dataclass(frozen=True)
class Growth:
    """What was asked for.

    control_points  at most so many; None: as many as the tolerance needs
    tolerance       length that no data point may be off by; None: no limit
    plain           all control points are there from the start
    limit           control points that there may be in the end
    """

    control_points: int | None
    tolerance: float | None
    plain: bool
    limit: int

    def ended(self, errors: Norms, last: Norms | None, *, diagonal: float, final: bool) -> StoppedBy | None:
        """Why the fit is over; None where it goes on.

        last      errors of the cycle before
        diagonal  of which the errors are shares
        final     whether there is no room for more control points
        """
        if self.tolerance is not None and errors.maximum / 100.0 * diagonal <= self.tolerance:
            return StoppedBy.TOLERANCE
        if final:
            return StoppedBy.ROUNDS if self.plain else StoppedBy.CONTROL_POINTS
        # a number of control points that was asked for is used; growth toward a tolerance ends where it brings nothing
        if (
            self.control_points is None
            and last is not None
            and all(now > (1.0 - STAGNATION) * then for now, then in zip(errors[1:], last[1:]))
        ):
            return StoppedBy.STAGNATION
        return None

    def more(self, n_control: int, cycle: int) -> int:
        """By how many control points a fit that has so many grows in this cycle, the first being 1."""
        left = self.limit - n_control
        if self.toward_tolerance:
            return min(int((GROWTH - 1.0) * n_control) + 1, left)
        return min(-(-left // max(CYCLES + 1 - cycle, 1)), left)

    @property
    def toward_tolerance(self) -> bool:
        """Whether the tolerance alone says how many control points there will be."""
        return self.control_points is None and self.tolerance is not None
