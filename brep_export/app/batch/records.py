"""What says that a job is finished: a record that is put in place last, and holds for one key.

The key covers the job's words, the content of every file they read, and the version; so a job is done again where
any of these changed, and never because a folder was copied.  A job that broke off is finished as well, for the limits
it had.
"""

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from brep_export.app.batch.words import Order
from recon.version import __version__

__all__ = ["RECORD", "content_hash", "job_key", "kept_record", "put_record"]

RECORD = "result.json"


def job_key(order: Order) -> str:
    """Hash of all that decides what comes out of a job, for good or ill."""
    read = {path: content_hash(path) for path in order.reads}
    text = json.dumps([__version__, order.command, order.words, read], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


@lru_cache(maxsize=4096)
def content_hash(path: str) -> str:
    """Hash of a file, or of all files below a folder; empty where it cannot be read."""
    place = Path(path)
    if not place.is_dir():
        return _file_hash(place)
    inner = [f"{file.relative_to(place)} {_file_hash(file)}" for file in sorted(place.rglob("*")) if file.is_file()]
    return hashlib.sha256("\n".join(inner).encode()).hexdigest()


def _file_hash(place: Path) -> str:
    if not place.is_file():  # what waits for a pipe waits for ever
        return ""
    try:
        with place.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


def kept_record(folder: Path, key: str, limits: Mapping[str, Any]) -> dict[str, Any] | None:
    """The record in a job's folder, where it holds for the key and its outputs are what they were; else None.

    limits  time and memory of now: what broke off under others is to be tried again
    """
    try:
        record = json.loads((folder / RECORD).read_bytes())
    except (OSError, ValueError):
        return None
    if not isinstance(record, dict) or record.get("key") != key:
        return None
    if record["cause"] and record["limits"] != dict(limits):
        return None
    whole = all(_file_hash(folder / name) == digest for name, digest in record["outputs"].items())
    return record if whole else None


def put_record(folder: Path, made: Path, record: Mapping[str, Any]) -> dict[str, Any]:
    """Move the files of an attempt into the job's folder, one by one, and the record of them last.

    made  folder of the attempt; every file in it but the log counts as an output
    """
    files = [path for path in _files(made) if path != made / "log.txt"]
    outputs = {str(path.relative_to(made)): _file_hash(path) for path in files}
    whole = {**record, "outputs": outputs}
    folder.mkdir(parents=True, exist_ok=True)
    for path in _files(made):
        place = folder / path.relative_to(made)
        place.parent.mkdir(parents=True, exist_ok=True)
        _to_disk(path)
        path.replace(place)
    written = made / RECORD
    written.write_text(json.dumps(whole, indent=1), encoding="utf-8")
    _to_disk(written)
    written.replace(folder / RECORD)
    return whole


def _files(folder: Path) -> Iterator[Path]:
    return (path for path in sorted(folder.rglob("*")) if path.is_file())


def _to_disk(path: Path) -> None:
    """Data before the name: a record must not outlive the content that it vouches for."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
