"""`python -m brep_export.second_reader PARENT FILE UNIT`: measures of what the kernel reads from a STEP file.

For `advance_copy`, which starts it; the answer, a pickled ShapeMeasures, goes to stdout, and nothing else does.
"""

import os
import pickle
import sys

from brep_export.measures import measure
from brep_export.orphans import die_with_parent
from brep_export.read_back import read_cad

if __name__ == "__main__":
    die_with_parent(int(sys.argv[1]))
    with os.fdopen(os.dup(1), "wb") as answer:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the kernel may print
        answer.write(pickle.dumps(measure(read_cad(sys.argv[2], unit=sys.argv[3]))))
