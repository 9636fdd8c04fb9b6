"""Loop surfaces of scans beside sparse least squares: error both ways, folds, seconds.

    python benchmarks/geometric_fit.py SCAN:CONTROL_POINTS ... [--json FILE]

The baseline has the same initial mesh, foot points and basis rows. It solves the full distance, six rounds: the normal
matrix is formed once a round and factorised by SuperLU in symmetric mode with minimum degree ordering, one
factorisation for all three coordinates; conjugate gradients with incomplete factors were slower at these sizes.
Deviations are in per cent of the diagonal of the scan's box.
"""

import argparse
import json
import platform
import time
from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree
from threadpoolctl import threadpool_limits

from recon.geometric_fit.foot_points import nearest_feet, walk_feet
from recon.geometric_fit.guards import fairness
from recon.geometric_fit.initial_mesh import initial_mesh
from recon.geometric_fit.pipeline import FitOptions, fit_surface
from recon.geometric_fit.scan_data import fold_places
from recon.geometric_fit.tangent_distance import basis_rows
from recon.numerics.distance import TriangleTree, sample_surface
from recon.readers.meshes import read_mesh
from recon.subdivision.limit_surface import limit_patches, tessellate

ROUNDS = 6


def least_squares(scan, n_control):
    """The fitted control mesh, seconds before the first round, and (error, seconds since) after each round."""
    begin = time.perf_counter()
    mesh = initial_mesh(scan, n_control)
    patches, points, data = limit_patches(mesh), mesh.vertices, scan.vertices
    energy = fairness(mesh, np.full(mesh.n_vertices, 1e-4 * len(data) / mesh.n_vertices))
    feet = nearest_feet(patches, patches.points @ points, data, step=1e-5)
    start, record = time.perf_counter(), []
    for _ in range(ROUNDS):
        rows = basis_rows(patches, feet).matrix(mesh.n_vertices)
        system = sparse.csc_array(rows.T @ rows + energy)
        factors = splu(system, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        points = factors.solve(rows.T @ (data - feet.positions + rows @ points))
        feet = walk_feet(patches, patches.points @ points, data, feet)
        record.append((rms(np.linalg.norm(data - feet.positions, axis=1)), time.perf_counter() - start))
    return mesh.with_vertices(points), start - begin, record


def rms(x):
    return float(np.sqrt(np.mean(x * x)))


def both_ways(scan, mesh, tree, diagonal):
    """Data to surface, surface to data over its area, and folds that the scan does not have."""
    share = 100.0 / diagonal
    patches = limit_patches(mesh)
    feet = nearest_feet(patches, patches.points @ mesh.vertices, scan.vertices)
    there = share * np.linalg.norm(feet.positions - scan.vertices, axis=1)
    drawn = tessellate(mesh, halvings=2, patches=patches)
    back = share * tree.closest(sample_surface(drawn.vertices, drawn.face_vertices, 60_000)).distances
    folds, known = (fold_places(m.vertices, m.face_vertices) for m in (drawn, scan))
    if len(folds) and len(known):
        folds = folds[cKDTree(known).query(folds)[0] > 0.005 * diagonal]
    return {
        "e_max": there.max(),
        "e_rms": rms(there),
        "stray_max": back.max(),
        "stray_rms": rms(back),
        "folds": len(folds),
    }


def row(name, scan, n_control):
    diagonal = float(np.linalg.norm(np.ptp(scan.vertices, axis=0)))
    tree = TriangleTree(scan.vertices, scan.face_vertices)
    mesh, before, record = least_squares(scan, n_control)
    goal = record[-1][0] / diagonal * 100.0
    out = [{"scan": name, "method": "least squares", "control": mesh.n_vertices, "seconds": before + record[-1][1]}]
    out[0] |= {"rounds_seconds": record[-1][1]} | both_ways(scan, mesh, tree, diagonal)
    for method, plain in (("tangent, plain", True), ("tangent, adaptive", False)):
        begin = time.perf_counter()
        fit = fit_surface(scan, FitOptions(control_points=n_control, plain=plain))
        seconds = time.perf_counter() - begin
        first = fit.rounds[0].seconds
        reached = next((r.seconds for r in fit.rounds if r.errors.rms <= goal), None)
        line = {"scan": name, "method": method, "control": fit.mesh.n_vertices, "seconds": seconds}
        line |= {"rounds_seconds": fit.rounds[-1].seconds - first, "reaches_least_squares": reached}
        out.append(line | both_ways(scan, fit.mesh, tree, diagonal))
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scans", nargs="+", help="FILE:CONTROL_POINTS")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    lines = []
    print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}, one thread")
    print(
        f"{'scan':24}{'method':20}{'control':>8}{'E_max':>8}{'E_rms':>8}{'stray':>8}{'rms':>8}{'folds':>6}{'s':>8}{'reach':>8}"
    )
    with threadpool_limits(limits=1):
        for word in options.scans:
            path, count = word.rsplit(":", 1)
            scan = read_mesh(path).mesh
            # compiled code is read from its cache once, outside the clock
            fit_surface(scan, FitOptions(control_points=min(200, scan.n_vertices), plain=True))
            for line in row(Path(path).name, scan, int(count)):
                lines.append(line)
                reach = line.get("reaches_least_squares")
                print(
                    f"{line['scan']:24}{line['method']:20}{line['control']:8}{line['e_max']:8.3f}{line['e_rms']:8.4f}"
                    f"{line['stray_max']:8.3f}{line['stray_rms']:8.4f}{line['folds']:6}{line['seconds']:8.2f}"
                    f"{'' if reach is None else format(reach, '8.2f')}",
                    flush=True,
                )
    if options.json is not None:
        options.json.write_text(json.dumps(lines, indent=1, default=float))


if __name__ == "__main__":
    main()
