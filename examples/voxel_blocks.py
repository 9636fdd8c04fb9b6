"""A volume by blocks on a Dask cluster: no worker holds more of it than a block, and all make the same solid."""

import subprocess
import sys

import numpy as np
from distributed import LocalCluster

SIDE = 56
RECON = "import sys; sys.argv[0] = 'recon'; from brep_export.app.cli import main; main()"


def gyroid() -> None:
    """A ball of gyroid walls, written slice by slice: a file that is larger than memory is made so."""
    values = np.lib.format.open_memmap("gyroid.npy", mode="w+", dtype=np.uint8, shape=(SIDE, SIDE, SIDE))
    along = np.linspace(-1.1, 1.1, SIDE)
    y, z = np.meshgrid(along, along, indexing="ij")
    for i, x in enumerate(along):
        wave = np.sin(4 * x) * np.cos(4 * y) + np.sin(4 * y) * np.cos(4 * z) + np.sin(4 * z) * np.cos(4 * x)
        values[i] = (np.abs(wave) < 0.6) & (x**2 + y**2 + z**2 < 1)
    values.flush()


if __name__ == "__main__":
    gyroid()
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        words = ["voxels", "gyroid.npy", "--block", "32", "--scheduler", cluster.scheduler_address]
        files = ["-o", "gyroid.step", "--picture", "gyroid.png"]
        subprocess.run([sys.executable, "-c", RECON, *words, *files], check=True)
