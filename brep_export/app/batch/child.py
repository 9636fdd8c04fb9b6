"""`python -m brep_export.app.batch.child PARENT WORDS`: the command line, in a process that dies with its worker."""

import sys

from brep_export.app.cli import app
from brep_export.orphans import die_with_parent

if __name__ == "__main__":
    die_with_parent(int(sys.argv[1]))
    app(sys.argv[2:], prog_name="recon")
