"""Make the pictures of the README from data that the package generates: `make pictures`."""

import subprocess
import sys
import tempfile
from pathlib import Path

PICTURES = Path(__file__).parent / "pictures"


def main() -> None:
    """One picture a method."""
    recon = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([*recon, "demo", "--directory", folder, "--quiet"], check=True)
        (PICTURES / "patch.png").write_bytes((Path(folder) / "piece.png").read_bytes())


if __name__ == "__main__":
    main()
