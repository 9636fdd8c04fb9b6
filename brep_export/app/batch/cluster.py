"""Workers of dask.distributed: a cluster on this machine, or one that is there already.

Each worker does one job at a time, in a process of that job's own (attempt.py): so nothing grows from job to job, and
what a job breaks is its own.  A worker that is killed is replaced, and its job given to another.
"""

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from socket import create_connection
from typing import Any
from urllib.parse import urlsplit

from brep_export.app.batch.attempt import Terms, work
from brep_export.app.batch.words import Order
from recon.errors import BadOption

__all__ = ["records_as_they_come", "workers"]

REACHED = 15.0  # seconds within which a scheduler must answer
DEATHS = 10  # workers that may die over one job before it is given up


@contextmanager
def workers(scheduler: str | None, number: int) -> Iterator[Any]:
    """A client of a scheduler, or of a local cluster of `number` workers that ends with the block.

    Raises  BadOption where no scheduler answers.
    """
    import dask
    from distributed import Client, LocalCluster

    if scheduler is not None:
        _require_listener(scheduler)
        with Client(scheduler, timeout=REACHED, set_as_default=False) as client:
            yield client
        return
    settings = {
        "distributed.scheduler.allowed-failures": DEATHS,
        "distributed.worker.multiprocessing-method": "spawn",
        # watching itself for a dashboard that nobody sees costs a cluster of two a tenth of a processor
        "distributed.admin.tick.interval": "500ms",
        "distributed.admin.system-monitor.interval": "5s",
        "distributed.worker.profile.enabled": False,
    }
    with (
        dask.config.set(settings),
        LocalCluster(
            n_workers=number,
            threads_per_worker=1,
            memory_limit=0,  # a worker holds next to nothing; its jobs are watched one by one
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield client


def _require_listener(scheduler: str) -> None:
    """Asked first: a client that finds nobody goes on trying, and complaining, long after it was given up."""
    place = urlsplit(scheduler)
    try:
        if place.scheme not in ("tcp", "tls") or not place.hostname or not place.port:
            raise BadOption("--scheduler", f"{scheduler} is no address like tcp://name:8786")
        create_connection((place.hostname, place.port), REACHED).close()
    except (OSError, ValueError) as problem:
        raise BadOption("--scheduler", f"no scheduler answers at {scheduler}") from problem


def records_as_they_come(
    client: Any, orders: Sequence[tuple[Order, str]], directory: str, terms: Terms
) -> Iterator[dict[str, Any]]:
    """The record of every job, in the order in which they end.

    A job is handed out when a worker is free for it: of those handed out before, a scheduler that does not know how
    long they take gives one worker many and another none.
    """
    from distributed import as_completed

    left = iter(orders)
    given: dict[Any, tuple[Order, str]] = {}
    ended = as_completed(loop=client.loop)

    def hand_out() -> None:
        most = max(1, sum(client.nthreads().values()))
        for order, key in islice(left, max(0, most - len(given))):
            future = client.submit(work, order, key, directory, terms, key=f"{order.name}-{key[:16]}", pure=False)
            given[future] = order, key
            ended.add(future)

    hand_out()
    while given:
        future = next(ended)
        order, key = given.pop(future)
        hand_out()
        problem = future.exception() if future.status != "finished" else None
        yield future.result() if future.status == "finished" else _lost(order, key, terms, problem)
        future.release()


def _lost(order: Order, key: str, terms: Terms, problem: Any) -> dict[str, Any]:
    """A job whose worker could not even say how it went."""
    reason = f"its worker failed ({type(problem).__name__}: {str(problem).splitlines()[0] if str(problem) else ''})."
    return {
        "name": order.name,
        "command": order.command,
        "words": list(order.words),
        "key": key,
        "status": "failed",
        "cause": "worker",
        "reasons": [reason],
        "limits": terms.limits,
        "attempts": 0,
        "seconds": 0.0,
        "peak_memory_mb": 0.0,
        "outputs": {},
        "answer": {},
    }
