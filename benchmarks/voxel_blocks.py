"""Voxels by blocks: peak memory, time and faces beside those of the whole.

python benchmarks/voxel_blocks.py [SIDE ...] [--block N] [--only-blocks]

A ball of gyroid walls in SIDE voxels a side (256 and 384), made slice by slice on disk and removed again, through the
command to an STL file, the gate and the reading back included.  Memory is the largest that the command held resident;
seconds are processor time.
"""

import json
import resource
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tables import Table, machine

PERIODS = 1.5  # along a side: the surface grows with its square, as that of a part does
RADIUS, WAVE = 0.45, 0.5  # of the ball, in sides; of the walls, in the gyroid's own measure
RECON = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]


def gyroid(path: Path, side: int) -> None:
    values = np.lib.format.open_memmap(path, mode="w+", dtype=np.uint8, shape=(side, side, side))
    along = (np.arange(side) - 0.5 * side) / side
    turn = 2.0 * np.pi * PERIODS
    (sy, sz), (cy, cz) = [[f(turn * w).astype(np.float32) for w in np.meshgrid(along, along, indexing="ij")]
                          for f in (np.sin, np.cos)]  # fmt: skip
    y, z = np.meshgrid(along, along, indexing="ij")
    for i, x in enumerate(along):
        wave = np.sin(turn * x) * cy + sy * cz + sz * np.cos(turn * x)
        values[i] = (np.abs(wave) < WAVE) & (x * x + y * y + z * z < RADIUS**2)
    values.flush()


def measured(volume: Path, options: list[str]) -> tuple[object, ...]:
    """Faces, error, peak memory, processor seconds; or what went wrong."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    words = ["voxels", str(volume), *options, "-o", str(volume.with_suffix(".stl")), "--json"]
    run = subprocess.run([*RECON, *words], capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    answer = json.loads(run.stdout)
    if answer["verdict"] != "pass":
        return (None, None, None, None, answer["reasons"][0])
    room = answer["room"]
    shape = f"{room['bodies']} bodies, {room['cavities']} cavities, genus {room['genus']}"
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    figures = room["faces_marching_cubes"], room["faces"], room["reduction"], room["max_error_voxels"]
    return (*figures, shape, answer["peak_memory_mb"], spent)


def main() -> None:
    words = sys.argv[1:]
    size = words[words.index("--block") + 1] if "--block" in words else "256"
    sides = [int(word) for word in words if word.isdigit() and word != size] or [256, 384]
    print(f"{machine()}; processor time\n")
    table = Table(
        {"side": "6", "made": "18", "triangles": "10,", "left": "8,", "gone": "6.3f", "error": "6.3f"}
        | {"shape": "34", "MB": "7,.0f", "seconds": "8.0f"}
    )
    for side in sides:
        with TemporaryDirectory() as folder:
            volume = Path(folder) / "gyroid.npy"
            gyroid(volume, side)
            if "--only-blocks" not in words:
                table.row(str(side), "as a whole", *measured(volume, []))
            table.row(str(side), f"by blocks of {size}", *measured(volume, ["--block", size]))


if __name__ == "__main__":
    main()
