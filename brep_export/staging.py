"""Files that appear whole or not at all.

Everything is written under a hidden name beside its place, looked at, and renamed only when all of it is good.  What
stood there before stays until then, and stays for good when anything fails.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from os import W_OK, access, getpid
from pathlib import Path
from time import time

from recon.errors import NotWritten

__all__ = ["staged"]

A_DAY = 86_400.0  # seconds: on a shared disk the process may be one of another machine


@contextmanager
def staged(*paths: str | Path, announce: Callable[[Path], None] = lambda path: None) -> Iterator[tuple[Path, ...]]:
    """Temporary paths, one beside each path and with its ending; renamed together when the block ends well.

    announce  called with each temporary path before the block, for whoever must clean up when the process dies
    Promises  when the block raises, the temporary files are gone and the paths are as they were.
    Raises    NotWritten when a path is a directory or its folder is missing or closed to writing (before the block),
              when the system refused to write in the block, or when the block left a file unwritten.
    """
    targets = [Path(path) for path in paths]
    for target in targets:
        _require_place(target)
    temporary = tuple(t.with_name(f".{t.stem}.{getpid()}.{i}{t.suffix}") for i, t in enumerate(targets))
    for target in targets:
        _clear_away_what_killed_runs_left(target)
    for path in temporary:
        announce(path)
    try:
        yield temporary
        for target, written in zip(targets, temporary):
            if not written.is_file() or written.stat().st_size == 0:
                raise NotWritten(str(target), "nothing came out of the writer")
        for target, written in zip(targets, temporary):
            _rename(written, target)
    except OSError as failure:
        if failure.errno is None:  # no word of the system, but of a library
            raise
        begun = [target for target, written in zip(targets, temporary) if written.exists()]
        place = begun[-1] if begun else targets[0]
        raise NotWritten(str(place), f"the disk refuses it ({failure.strerror})") from failure
    finally:
        for written in temporary:
            written.unlink(missing_ok=True)


def _clear_away_what_killed_runs_left(target: Path) -> None:
    """Remove temporary files of this target that are older than a day, and whose process is gone."""
    pattern = rf"\.{re.escape(target.stem)}\.(\d+)\.(\d+|advance){re.escape(target.suffix)}"
    for path in target.parent.iterdir():
        name = re.fullmatch(pattern, path.name)
        if name is None:
            continue
        from psutil import pid_exists  # seldom needed, and slow to begin with

        with suppress(OSError):  # gone meanwhile, or not ours to remove
            if time() - path.stat().st_mtime > A_DAY and not pid_exists(int(name[1])):
                path.unlink()


def _require_place(target: Path) -> None:
    if target.is_dir():
        raise NotWritten(str(target), "a directory of that name is in the way")
    if not target.parent.is_dir():
        raise NotWritten(str(target), f"there is no folder {target.parent}")
    if not access(target.parent, W_OK):
        raise NotWritten(str(target), f"the folder {target.parent} may not be written to")


def _rename(written: Path, target: Path) -> None:
    try:
        written.replace(target)
    except OSError as failure:
        raise NotWritten(str(target), f"it could not be put in place ({failure.strerror})") from failure
