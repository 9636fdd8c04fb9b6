"""Make the pictures of the README from data that the package generates: `make pictures`."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

PICTURES = Path(__file__).parent / "pictures"
WITHOUT_A_CARD = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def main() -> None:
    """The picture of a piece, and the first screen of its report where there is a Chromium to open it."""
    recon = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([*recon, "demo", "--directory", folder, "--quiet"], check=True)
        (PICTURES / "patch.png").write_bytes((Path(folder) / "piece.png").read_bytes())
        if shutil.which("chromium"):
            photograph(Path(folder) / "piece.html", PICTURES / "report.png")


def photograph(page: Path, picture: Path) -> None:
    """The first screen of a page, into a PNG file."""
    with tempfile.TemporaryDirectory() as profile:
        flags = ("--headless", "--no-sandbox", "--no-first-run", "--hide-scrollbars", f"--user-data-dir={profile}")
        drawn = ("--run-all-compositor-stages-before-draw", "--virtual-time-budget=8000")
        shot = ("--window-size=1280,760", f"--screenshot={picture}", page.as_uri())
        subprocess.run(["chromium", *flags, *WITHOUT_A_CARD, *drawn, *shot], check=True, capture_output=True)


if __name__ == "__main__":
    main()
