"""Scans of many millions of points, thinned cell by cell: memory, time, and how far every point is from what is left.

python benchmarks/scan_cells.py [POINTS:LEFT ...]

A torus with bumps, written to a binary PLY file row by row and removed again (1000000:50000 and 4000000:200000 if none
is named).  Memory is the largest that the process held resident, the pages of the file that it looked at among it;
seconds are processor time.  Distances are shares of the box's diagonal.
"""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tables import Table, machine

RADII = 70.0, 30.0
THIN = """
import json, resource, sys, time
import numpy as np
from recon.readers.mesh_windows import open_mesh
from recon.geometric_fit.scan_cells import thinned_scan
from recon.voxel_mesh.topology import mesh_topology
found = thinned_scan(open_mesh(sys.argv[1], least=1), int(sys.argv[2]))
spent = resource.getrusage(resource.RUSAGE_SELF)
mesh, diagonal = found.mesh, float(np.linalg.norm(np.ptp(found.mesh.vertices, axis=0)))
rms, most = float(np.sqrt((found.distances**2).mean())) / diagonal, float(found.distances.max()) / diagonal
print(json.dumps([mesh.n_vertices, rms, most, mesh_topology(mesh.vertices, mesh.face_vertices).genus,
                  spent.ru_maxrss / 1024, spent.ru_utime + spent.ru_stime]))
"""


def torus(path: Path, n_points: int) -> int:
    """Write the file; its number of points."""
    n = round(np.sqrt(n_points / 2))
    v, j = 2 * np.pi * np.arange(n) / n, np.arange(n)
    face = np.zeros(2 * n, dtype=[("count", "u1"), ("corners", "<i4", (3,))])
    face["count"] = 3
    with path.open("wb") as file:
        file.write(
            f"ply\nformat binary_little_endian 1.0\nelement vertex {2 * n * n}\nproperty float x\nproperty float y\n"
            f"property float z\nelement face {4 * n * n}\nproperty list uchar int vertex_indices\nend_header\n".encode()
        )
        for u in np.pi * np.arange(2 * n) / n:
            r = RADII[1] + 1.5 * np.sin(9 * u) * np.sin(7 * v) + 0.3 * np.sin(61 * u + 3 * v)
            out = RADII[0] + r * np.cos(v)
            file.write(np.stack([out * np.cos(u), out * np.sin(u), r * np.sin(v)], axis=1).astype("<f4").tobytes())
        for i in range(2 * n):
            here, right = i * n, (i + 1) % (2 * n) * n
            up = (j + 1) % n
            face["corners"][0::2] = np.stack([here + j, right + j, right + up], axis=1)
            face["corners"][1::2] = np.stack([here + j, right + up, here + up], axis=1)
            file.write(face.tobytes())
    return 2 * n * n


def main() -> None:
    sizes = [word.split(":") for word in sys.argv[1:]] or [["1000000", "50000"], ["4000000", "200000"]]
    print(f"{machine()}; processor time\n")
    table = Table(
        {"points": "11,", "left": "9,", "rms": "9.1e", "most": "9.1e", "genus": "5,", "MB": "7,.0f", "seconds": "8.0f"}
    )
    for points, left in sizes:
        with TemporaryDirectory() as folder:
            path = Path(folder) / "torus.ply"
            n = torus(path, int(points))
            run = subprocess.run([sys.executable, "-c", THIN, path, left], capture_output=True, text=True, check=True)
        table.row(n, *json.loads(run.stdout))


if __name__ == "__main__":
    main()
