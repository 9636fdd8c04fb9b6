"""All benchmarks one after the other, printed and kept as pages and plots of the documentation: `make bench`.

python benchmarks [NAME ...]     NAME of a benchmark below; where none is named all but `robustness`, which takes hours,
                                 and `terrain_tiles`, which takes half of one

Every benchmark runs in a process of its own and prints Markdown; its page is docs/measured/NAME.md, and where its
tables set methods side by side, docs/measured/NAME.png draws their errors and seconds.
"""

import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tables import tables_in

HERE = Path(__file__).parent
PAGES = HERE.parent / "docs" / "measured"


@dataclass(frozen=True)
class Run:
    """A benchmark, what it is called, its arguments, and the column of its tables that is drawn beside the seconds."""

    title: str
    arguments: Sequence[str] = ()
    error: str | None = None


RUNS = {
    "hole_patch": Run("The missing piece", error="inside mean"),
    "hole_patch_peers": Run("The missing piece, beside programs that fill holes", error="inside mean"),
    "smoothing": Run("Taubin's filter", error="difference / diagonal"),
    "geometric_fit": Run(
        "Subdivision surfaces of scans",
        ("made^20000:400", "made^50000:588", "--schemes", "--updates", "docs/measured/geometric_fit_updates.png"),
        error="E_rms",
    ),
    "bspline_fit": Run(
        "Spline faces of scans", ("made:wavy^20000:400", "made:tube^20000:400", "made:torus^20000:400"), error="E_rms"
    ),
    "scan_cells": Run("Scans of many millions of points", ("1000000:50000", "4000000:200000")),
    "limit_solids": Run("Limit surfaces as solids"),
    "terrain": Run("Contour lines to a ground", error="rms, m"),
    "terrain_tiles": Run("A map by tiles", ("12000",)),
    "voxel_mesh": Run("Voxels to a boundary", ("--half",), error="error"),
    "voxel_blocks": Run("Voxels by blocks", ("256", "--block", "64")),
    "three_view": Run("Drawings to solids"),
    "kernel_door": Run("Building kernel solids"),
    "leaks": Run("Job after job in one process"),
    "batch_workers": Run("A batch by one worker and by two"),
    "robustness": Run("Inputs drawn by chance"),
}
LONG = ("robustness", "terrain_tiles")


def main() -> None:
    PAGES.mkdir(exist_ok=True)
    names = sys.argv[1:] or [name for name in RUNS if name not in LONG]
    broken = [name for name in names if not _kept(name, RUNS[name])]
    if broken:
        sys.exit(f"broke off: {', '.join(broken)}")


def _kept(name: str, run: Run) -> bool:
    """Run one, print it, write its page; whether it came to its end."""
    print(f"\n# {run.title}\n", flush=True)
    command = [sys.executable, str(HERE / f"{name}.py"), *run.arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines = list(_echoed(process.stdout))
    if process.returncode:
        return False
    text = "".join(lines)
    picture = PAGES / f"{name}.png"
    drawn = run.error is not None and _draw(text, run.error, picture)
    shown = f"![Errors and seconds]({picture.name})\n\n" if drawn else ""
    words = " ".join([f"benchmarks/{name}.py", *run.arguments])
    page = f"# {run.title}\n\nPrinted by `python {words}`, which says what the columns mean.\n\n{shown}{text.strip()}\n"
    (PAGES / f"{name}.md").write_text(page, encoding="utf-8")
    return True


def _echoed(lines: Iterator[str]) -> Iterator[str]:
    for line in lines:
        print(line, end="", flush=True)
        yield line


def _draw(text: str, error: str, path: Path) -> bool:
    """Bars of errors and of seconds, a colour for each method; False where no table has both a method and the error."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    rows = [row for table in tables_in(text) for row in table if "method" in row and _is_number(row.get(error, ""))]
    columns = [column for column in (error, "seconds") if rows and column in rows[0]]
    if not columns:
        return False
    methods = list(dict.fromkeys(row["method"] for row in rows))
    colours = plt.get_cmap("tab10")
    figure, axes = plt.subplots(1, len(columns), figsize=(5.5 * len(columns), 0.8 + 0.16 * len(rows)), squeeze=False)
    for ax, column in zip(axes[0], columns):
        ax.barh(range(len(rows)), [_number(row[column]) for row in rows], log=True)
        for bar, row in zip(ax.patches, rows):
            bar.set_color(colours(methods.index(row["method"]) % 10))
        ax.set_yticks(range(len(rows)), [_label(row) for row in rows] if ax is axes[0, 0] else [], fontsize=6)
        ax.invert_yaxis()
        ax.set_title(column, fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=90, bbox_inches="tight")
    plt.close(figure)
    return True


def _label(row: dict[str, str]) -> str:
    """What stands before the first figure of a row."""
    words = []
    for value in row.values():
        if _is_number(value) and words:
            break
        words.append(value)
    return ", ".join(words)


def _is_number(text: str) -> bool:
    try:
        _number(text)
    except ValueError:
        return False
    return True


def _number(text: str) -> float:
    return float(text.replace(",", ""))


if __name__ == "__main__":
    main()
