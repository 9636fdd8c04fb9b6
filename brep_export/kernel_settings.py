"""The kernel's global state, kept in one place: its exceptions, its printing, its exchange settings, its threads.

STEP and IGES are steered by named settings that outlive the call which sets them, and the kernel talks to stdout,
where results go.  Both are changed for the length of one `with` block and put back.
"""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from OCP import Standard, StdFail
from OCP.IGESControl import IGESControl_Controller
from OCP.Interface import Interface_Static
from OCP.Message import Message
from OCP.STEPControl import STEPControl_Controller

__all__ = ["KERNEL_FAILURES", "exchange_settings", "kernel_threads", "quiet_kernel"]

KERNEL_FAILURES: tuple[type[Exception], ...] = tuple(
    kind
    for module in (Standard, StdFail)
    for kind in vars(module).values()
    if isinstance(kind, type) and issubclass(kind, Exception)
)
"""Everything that the kernel raises; its exceptions have no common ancestor of their own."""


def kernel_threads() -> int:
    """How much may be done at once: OMP_NUM_THREADS where that is set, else one for every processor there is."""
    told = os.environ.get("OMP_NUM_THREADS", "").split(",")[0]
    if told.strip().isdigit():
        return max(int(told), 1)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def quiet_kernel() -> Iterator[None]:
    """Within the block the kernel prints nothing; its failures are raised, or found in what it returns."""
    messenger = Message.DefaultMessenger_s()
    printers = list(messenger.Printers())
    for printer in printers:
        messenger.RemovePrinter(printer)
    try:
        yield
    finally:
        for printer in printers:
            messenger.AddPrinter(printer)


@contextmanager
def exchange_settings(settings: Mapping[str, str | int | float]) -> Iterator[None]:
    """Within the block the named STEP and IGES settings hold; afterwards the old ones do.

    Raises KeyError naming the setting when the kernel knows no such setting or refuses the value.
    """
    STEPControl_Controller.Init_s()
    IGESControl_Controller.Init_s()
    old = {name: _get(name, value) for name, value in settings.items()}
    try:
        for name, value in settings.items():
            _set(name, value)
        with quiet_kernel():
            yield
    finally:
        for name, value in old.items():
            _set(name, value)


def _get(name: str, like: str | int | float) -> str | int | float:
    if not Interface_Static.IsPresent_s(name):
        raise KeyError(name)
    if isinstance(like, str):
        return str(Interface_Static.CVal_s(name))
    return int(Interface_Static.IVal_s(name)) if isinstance(like, int) else float(Interface_Static.RVal_s(name))


def _set(name: str, value: str | int | float) -> None:
    if isinstance(value, str):
        done = Interface_Static.SetCVal_s(name, value)
    elif isinstance(value, int):
        done = Interface_Static.SetIVal_s(name, value)
    else:
        done = Interface_Static.SetRVal_s(name, value)
    if not done:
        raise KeyError(f"{name} = {value}")
