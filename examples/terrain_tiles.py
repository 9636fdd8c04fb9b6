"""A grid by tiles, each a job of its own in a batch: several at once, or on the machines of a Dask cluster."""

import json
import subprocess
import sys
from pathlib import Path

import cadquery as cq
import numpy as np

from brep_export.app.pictures import draw, views_around
from brep_export.check import ShapeKind, check
from brep_export.read_back import read_cad
from recon import Tolerance

x, y = np.meshgrid(10.0 * np.arange(41), 10.0 * np.arange(37))
heights = 4.0 + 60.0 * np.exp(-(((x - 0.6 * y - 80) / 90) ** 2)) + 0.05 * y
Path("ridge.json").write_text(json.dumps({"width": 41, "height": 37, "values": heights[::-1].ravel().tolist()}))

# a tile depends on the grid around it alone, so it is the same whoever makes it
job = """[[job]]
name = "tile-{0}-{1}"
command = "terrain"
inputs = ["ridge.json"]
outputs = ["ridge.step"]
options = "--interval 10 --tile 0.2 --only {0},{1} --base-level -20"
"""
Path("jobs.toml").write_text("".join(job.format(row, column) for row in range(2) for column in range(2)))
recon = "import sys; sys.argv[0] = 'recon'; from brep_export.app.cli import main; main()"
subprocess.run([sys.executable, "-c", recon, "batch", "jobs.toml", "-o", "tiles", "--workers", "2"], check=True)

tiles = [cq.Shape.cast(read_cad(path, unit="M")) for path in sorted(Path("tiles").rglob("*.step"))]
ground = cq.Compound.makeCompound(tiles)
report = check(ground.wrapped, Tolerance(), expect=ShapeKind.COMPOUND).require()
cq.exporters.export(cq.Workplane(ground), "ground.step")
draw(Path("ground.png"), views_around(report.triangles()))
print(f"{len(tiles)} tiles, {report.measures.faces} faces, {report.measures.volume:.0f} m³")
