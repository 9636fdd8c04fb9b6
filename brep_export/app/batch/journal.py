"""A line for every start and every end of a job, as JSON: what was done, and how often, can be counted afterwards."""

import json
import os
import time
from pathlib import Path
from typing import Any

__all__ = ["JOURNAL", "enter"]

JOURNAL = "journal.jsonl"


def enter(directory: Path, event: str, name: str, **facts: Any) -> None:
    """Add a line; lines of several processes do not mix, since each is one write at the end of the file."""
    line = {"time": round(time.time(), 3), "event": event, "job": name, "process": os.getpid(), **facts}
    place = os.open(directory / JOURNAL, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
    try:
        os.write(place, (json.dumps(line) + "\n").encode())
    finally:
        os.close(place)
