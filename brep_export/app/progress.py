"""The line that shows what a job does: the step, for how long it has worked, and for how long yet, where that is known.

It is known in two ways. A step that says which of how many it is, as `proving solid (3 of 12)`, takes what the ones
before took on average, times those that remain. And where the command ran before, the steps that followed then follow
again, at the pace of those that are done. The longer of the two is shown.
"""

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from brep_export.app.earlier_runs import EarlierRun, kind_of

__all__ = ["SHORT", "Clock", "shown_progress"]

COUNT = re.compile(r"^(.*)\((\d+) of (\d+)\)$")
SHORT = 2.0  # seconds of work of which no time is shown, and too few to tell the pace by


@dataclass
class Clock:
    """What is being done, and since when.

    now      tells the time in seconds
    earlier  a run like this one, if any is known
    size     bytes of the inputs of this run
    """

    now: Callable[[], float] = time.monotonic
    earlier: EarlierRun | None = None
    size: int = 0
    step: str = "starting"
    steps: list[tuple[str, float]] = field(default_factory=list)
    began: float = field(init=False)
    _place: int = -1  # of the step among those of the earlier run
    _counting: str = ""
    _counted_from: float = 0.0

    def __post_init__(self) -> None:
        self.began = self.now()

    def hear(self, step: str) -> None:
        """A new step begins; of several that are counted alike, the first starts the count."""
        self.step = step
        self.steps.append((kind_of(step), self.spent()))
        self._place = self._found_in_earlier()
        found = COUNT.match(step)
        counting = found.group(1) if found else ""
        if counting != self._counting:
            self._counting, self._counted_from = counting, self.now()

    def spent(self) -> float:
        """Seconds since the job began."""
        return self.now() - self.began

    def left(self) -> float | None:
        """Seconds until the end, or of the counted steps; None where neither is known, or the time has run out."""
        known = [seconds for seconds in (self._left_by_count(), self._left_by_earlier()) if seconds is not None]
        return max(known) if known and max(known) > 0.0 else None

    def _left_by_count(self) -> float | None:
        found = COUNT.match(self.step)
        done = int(found.group(2)) - 1 if found else 0
        if found is None or done < 1:
            return None
        return (self.now() - self._counted_from) / done * (int(found.group(3)) - done)

    def _found_in_earlier(self) -> int:
        kind = self.steps[-1][0]
        steps = () if self.earlier is None else self.earlier.steps
        later = (i for i in range(self._place + 1, len(steps)) if steps[i][0] == kind)
        return next(later, self._place)

    def _left_by_earlier(self) -> float | None:
        if self.earlier is None or self._place < 0:
            return None
        reached, began = self.earlier.steps[self._place][1], self.steps[-1][1]
        if min(reached, began) > SHORT:
            pace = began / reached
        else:
            pace = self.size / self.earlier.size if self.size and self.earlier.size else 1.0
        return pace * (self.earlier.seconds - reached) - (self.spent() - began)

    def line(self) -> str:
        """The step, with the times that are known."""
        if self.spent() < SHORT:
            return self.step
        left = self.left()
        return f"{self.step}, {_said(self.spent())}" + ("" if left is None else f", about {_said(left)} left")


def _said(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


@contextmanager
def shown_progress(clock: Clock) -> Iterator[Callable[[str], None]]:
    """Within the block a line on stderr shows what the clock heard last; gives what prints a note above it."""
    from rich.console import Console
    from rich.progress import Progress, ProgressColumn, SpinnerColumn, Task
    from rich.text import Text

    class Line(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(clock.line())

    console = Console(stderr=True)
    with Progress(SpinnerColumn(), Line(), console=console, transient=True) as progress:
        progress.add_task("")
        yield lambda text: console.print(Text(text))
