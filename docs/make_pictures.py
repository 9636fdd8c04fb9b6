"""Make the pictures of the README and of the documentation from generated data: `make pictures`."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from make_inputs import write_inputs
from PIL import Image
from zebra import draw_zebra

PICTURES = Path(__file__).parent / "pictures"
WITHOUT_A_CARD = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WIDE, LARGEST = 1200, 150_000  # pixels, bytes
COMMANDS = {
    "patch": ["patch", "sherds", "-o", "piece.step"],
    "fit": ["fit", "pebble.ply", "-o", "pebble.step"],
    "curve": ["curve", "outline.csv", "-o", "outline.step", "--tolerance", "0.1%"],
    "terrain": ["terrain", "contours.geojson", "--base-depth", "20", "-o", "hill.step"],
    "voxels": ["voxels", "bracket.npz", "--analytic", "--snap", "0.5", "-o", "bracket.step"],
    "views": ["views", "drawing.dxf", "-o", "part.step"],
}


def main() -> None:
    """One picture a command, and the first screen of a report where there is a Chromium to open it."""
    recon = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_inputs(folder)
        for method, words in COMMANDS.items():
            shown = ["--picture", f"{method}.png", "--report", f"{method}.html", "--quiet"]
            subprocess.run([*recon, *_with_sherds(words, folder), *shown], check=True, cwd=folder)
            shrink(folder / f"{method}.png", PICTURES / f"{method}.png")
        draw_zebra(folder / "zebra.png")
        shrink(folder / "zebra.png", PICTURES / "zebra.png")
        if shutil.which("chromium"):
            photograph(folder / "patch.html", folder / "report.png")
            shrink(folder / "report.png", PICTURES / "report.png")


def _with_sherds(words: list[str], folder: Path) -> list[str]:
    sherds = [str(path.relative_to(folder)) for path in sorted((folder / "sherds").iterdir())]
    return [file for word in words for file in (sherds if word == "sherds" else [word])]


def shrink(made: Path, picture: Path) -> None:
    """A picture of at most `WIDE` pixels across in 256 colours, so that a clone stays small."""
    image = Image.open(made).convert("RGB")
    image.thumbnail((WIDE, WIDE), Image.Resampling.LANCZOS)
    image.quantize(256, kmeans=3, dither=Image.Dither.NONE).save(picture, optimize=True)
    if picture.stat().st_size > LARGEST:
        raise SystemExit(f"{picture} has {picture.stat().st_size} bytes, more than {LARGEST}")


def photograph(page: Path, picture: Path) -> None:
    """The first screen of a page, into a PNG file."""
    with tempfile.TemporaryDirectory() as profile:
        flags = ("--headless", "--no-sandbox", "--no-first-run", "--hide-scrollbars", f"--user-data-dir={profile}")
        drawn = ("--run-all-compositor-stages-before-draw", "--virtual-time-budget=8000")
        shot = ("--window-size=1280,760", f"--screenshot={picture}", page.as_uri())
        subprocess.run(["chromium", *flags, *WITHOUT_A_CARD, *drawn, *shot], check=True, capture_output=True)


if __name__ == "__main__":
    main()
