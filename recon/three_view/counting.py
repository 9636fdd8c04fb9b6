"""How many labelings there are, exactly, without listing them: projected model counting by Ganak.

    (a or b) and (c or d)       {a, b} and {c, d} share no variable, so their numbers multiply: 3 x 3
    (a or b) and (b or c)       b solid: 4 ways; b empty: a and c are solid; 4 + 1

Only cells are counted; the variables that say where a solid turns a corner just have to exist. Counting can take for
ever and cannot be called back, so it works in a process of its own. Its time is that of the processor, so that what is
known of a drawing does not hang on what else the machine does.

Paper  Ganak [sharma2019].
"""

import json
import subprocess
import sys
from collections.abc import Sequence
from math import ceil

__all__ = ["exact_count"]

PATIENCE = 6.0  # times the time that is given, by the clock, until counting is broken off all the same

CHILD = """
import json, sys
from pyganak import Counter
clauses, n_cells, seconds = json.load(sys.stdin)
try:
    import resource
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
except ImportError:
    pass  # then the clock alone tells
counter = Counter()
counter.new_vars(max([n_cells, *(abs(x) for clause in clauses for x in clause)]))
counter.add_clauses(clauses)
counter.set_sampling_set(list(range(1, n_cells + 1)))
print(counter.count())
"""


def exact_count(clauses: Sequence[Sequence[int]], n_cells: int, *, seconds: float) -> int | None:
    """Number of assignments of the variables 1 ... n_cells that some model extends; None when that takes longer.

    seconds  of the processor, at least one; by the clock it may be a few times as long
    """
    try:
        child = subprocess.run(
            [sys.executable, "-c", CHILD],
            input=json.dumps([clauses, n_cells, ceil(seconds)]),
            capture_output=True,
            text=True,
            timeout=PATIENCE * seconds,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return None
    return int(child.stdout.split()[-1]) if child.returncode == 0 and child.stdout.strip() else None
