"""The line that shows what a job does: the step, for how long it has worked, and for how long yet where steps count.

A step that says which of how many it is, as `proving solid (3 of 12)`, gets the time that is left: what the ones before
took on average, times those that remain. Of other steps nobody knows.
"""

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

__all__ = ["SHORT", "Clock", "shown_progress"]

COUNT = re.compile(r"^(.*)\((\d+) of (\d+)\)$")
SHORT = 2.0  # seconds of work of which no time is shown


@dataclass
class Clock:
    """What is being done, and since when; `now` tells the time in seconds."""

    now: Callable[[], float] = time.monotonic
    step: str = "starting"
    began: float = field(init=False)
    _counting: str = ""
    _counted_from: float = 0.0

    def __post_init__(self) -> None:
        self.began = self.now()

    def hear(self, step: str) -> None:
        """A new step begins; of several that are counted alike, the first starts the count."""
        self.step = step
        found = COUNT.match(step)
        counting = found.group(1) if found else ""
        if counting != self._counting:
            self._counting, self._counted_from = counting, self.now()

    def left(self) -> float | None:
        """Seconds until the counted steps are done, or None where nothing is counted or none is done yet."""
        found = COUNT.match(self.step)
        done = int(found.group(2)) - 1 if found else 0
        if found is None or done < 1:
            return None
        return (self.now() - self._counted_from) / done * (int(found.group(3)) - done)

    def line(self) -> str:
        """The step, with the times that are known."""
        spent = self.now() - self.began
        if spent < SHORT:
            return self.step
        left = self.left()
        return f"{self.step}, {_said(spent)}" + ("" if left is None else f", about {_said(left)} left")


def _said(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


@contextmanager
def shown_progress() -> Iterator[tuple[Callable[[str], None], Callable[[str], None]]]:
    """Within the block a line on stderr is kept up to date; gives what takes steps and what takes notes."""
    from rich.console import Console
    from rich.progress import Progress, ProgressColumn, SpinnerColumn, Task
    from rich.text import Text

    clock = Clock()

    class Line(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(clock.line())

    console = Console(stderr=True)
    with Progress(SpinnerColumn(), Line(), console=console, transient=True) as progress:
        progress.add_task("")
        yield clock.hear, lambda text: console.print(Text(text))
