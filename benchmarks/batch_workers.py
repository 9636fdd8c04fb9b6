"""How much sooner two workers of `recon batch` are done than one, and what a batch adds to the jobs themselves.

python benchmarks/batch_workers.py [JOBS]

JOBS (8) equal jobs of some seconds, each a solid fitted to a scan of 6,000 points of a ball with waves: without
a batch, one command after the other; then by one worker and by two. Seconds are those of the clock from the command's
start to its end, the start of the cluster included; `times` is how many times as fast a row is as one worker. Memory is
the most that any one job held.
"""

import csv
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from brep_export.mesh_files import write_mesh
from geometric_fit import bumpy_ball
from tables import Table, machine

RECON = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]
POINTS, JOBS = 6000, 8
JOB = """[[job]]
name = "job-{0}"
command = "fit"
inputs = ["ball.stl"]
outputs = ["ball.step"]
"""


def main() -> None:
    n = int(sys.argv[1]) if len(sys.argv) > 1 else JOBS
    print(f"{machine('dask', 'distributed')}\n")
    table = Table({"way": "24", "jobs": "6,", "seconds": "8.1f", "times": "6.2f", "MB": "7,.0f"})
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_mesh(bumpy_ball(POINTS), folder / "ball.stl")
        (folder / "jobs.toml").write_text("".join(map(JOB.format, range(n))), encoding="utf-8")
        one_by_one = sum(seconds(folder, "fit", "ball.stl", "-o", "ball.step") for _ in range(n))
        batches = [
            (workers, seconds(folder, "batch", "jobs.toml", "-o", f"out-{workers}", "--workers", str(workers)))
            for workers in (1, 2)
        ]
        one_worker = batches[0][1]
        table.row("commands, no batch", n, one_by_one, one_worker / one_by_one)
        for workers, taken in batches:
            held = max(memory(folder / f"out-{workers}" / "summary.csv"))
            table.row(f"{workers} worker{'s' if workers > 1 else ''}", n, taken, one_worker / taken, held)


def seconds(folder: Path, *words: str) -> float:
    begun = time.perf_counter()
    subprocess.run([*RECON, *words], cwd=folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - begun


def memory(summary: Path) -> Iterator[float]:
    with summary.open(newline="", encoding="utf-8") as lines:
        for row in csv.DictReader(lines):
            yield float(row["memory_mb"])


if __name__ == "__main__":
    main()
