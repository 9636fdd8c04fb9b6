"""A process that ends when the one that started it is killed, even by a signal that nobody can answer."""

import ctypes
import multiprocessing
import os
import signal
import sys
from threading import Thread

__all__ = ["die_with_parent"]

PR_SET_PDEATHSIG = 1


def die_with_parent(parent: int | None = None) -> None:
    """From now on the death of the parent process kills this one.

    parent  number of the parent, where it is known: it may have died before this call

    On Linux the system does it. Elsewhere a thread waits for a parent that multiprocessing knows; the kernel's long
    calls can hold it up.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if parent is not None and os.getppid() != parent:
            os.kill(os.getpid(), signal.SIGKILL)
    elif multiprocessing.parent_process() is not None:
        Thread(target=_wait_and_die, daemon=True).start()


def _wait_and_die() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
