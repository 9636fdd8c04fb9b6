"""Calls of a function for every entry of sequences, here or on the workers of a Dask cluster, in the order of entries.

What is in flight is bounded: entries are made when a worker is about to be free, and results are taken as they come in
turn, so that neither piles up.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from brep_export.app.batch.cluster import workers
from recon.errors import InputError, ReconError, Refusal

__all__ = ["Each", "calls"]

Each = Callable[..., Iterator[Any]]

AHEAD = 2  # entries a worker that are handed out before the first comes back


@contextmanager
def calls(scheduler: str | None, *, lost: Callable[[Exception], Any] | None = None) -> Iterator[Each]:
    """As `map`; the function runs here, or on the workers of the scheduler at an address.

    lost    what stands for the result of an entry over which its workers died; where None, the block raises
    Raises  BadOption where no scheduler answers; in the block, Refusal where it is lost, and what the function raises:
            errors of ours as Refusal or InputError with the same sentence.
    """
    if scheduler is None:
        yield map
        return
    with workers(scheduler, 0) as client:

        def each(function: Callable[..., Any], *sequences: Iterable[Any]) -> Iterator[Any]:
            most = AHEAD * max(1, len(client.scheduler_info()["workers"]))
            waiting: deque[Any] = deque()
            for given in zip(*sequences):
                waiting.append(client.submit(_told, function, *given, pure=False))
                if len(waiting) >= most:
                    yield _taken(waiting.popleft(), lost)
            while waiting:
                yield _taken(waiting.popleft(), lost)

        yield each


def _taken(future: Any, lost: Callable[[Exception], Any] | None) -> Any:
    from distributed import CancelledError, KilledWorker

    try:
        answer = future.result()
    except CancelledError as problem:
        raise Refusal("the connection to the scheduler was lost.") from problem
    except KilledWorker as problem:
        if lost is None:
            raise
        return lost(problem)
    return _found(answer)


def _told(function: Callable[..., Any], *given: Any) -> tuple[bool, Any]:
    """What a function returns, or the sentence with which it refuses: errors of ours do not travel."""
    try:
        return True, function(*given)
    except InputError as problem:
        return False, ("input", str(problem))
    except ReconError as problem:
        return False, ("refusal", str(problem))


def _found(answer: tuple[bool, Any]) -> Any:
    done, value = answer
    if done:
        return value
    kind, sentence = value
    raise InputError(sentence) if kind == "input" else Refusal(sentence)
