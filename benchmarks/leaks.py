"""Memory of one process that does job after job: what a leak in the rooms, in the kernel or in a table would show.

python benchmarks/leaks.py [JOBS] [--each]

JOBS (200) small jobs of every command, mixed, each with an input of its own so that no table of earlier results helps,
done by the commands themselves, but all in this process, where `recon` and `recon batch` would start one for each
(tests/shapes/small_jobs.py).  Memory is what the process holds resident.  --each does JOBS jobs of one command after
those of another in place of the mixture.
"""

import sys
from pathlib import Path

from tables import Table, machine

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shapes"))

from small_jobs import KINDS, memory_held

MARKS = (20, 50, 100, 200)  # jobs after which the memory is looked at; the first of them is the warm-up


def main() -> None:
    words = sys.argv[1:]
    jobs = next((int(word) for word in words if word.isdigit()), MARKS[-1])
    marks = (*(mark for mark in MARKS if mark < jobs), jobs)
    print(f"{machine('cadquery-ocp', 'scipy')}\n")
    table = Table({"jobs": "12", "done": "6,", "MB": "8,.1f", "growth": "8.1%", "not done": "8,"})
    for kinds in [(kind,) for kind in dict.fromkeys(KINDS)] if "--each" in words else [KINDS]:
        first = 0.0
        for count, held, wrong in memory_held(kinds, marks):
            first = first or held
            table.row("mixed" if len(kinds) > 1 else kinds[0].__name__, count, held, held / first - 1.0, len(wrong))
            for problem in wrong:
                print(problem, file=sys.stderr)


if __name__ == "__main__":
    main()
