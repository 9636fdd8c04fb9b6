"""Surfaces of scans beside sparse least squares: error both ways, folds, seconds, memory; and all updates side by side.

    python benchmarks/geometric_fit.py [SCAN:CONTROL_POINTS ...] [--schemes] [--updates PICTURE.png] [--json FILE]

SCAN may be a file, `file^1` for the file with every triangle cut in four on a smooth surface through it, with smooth
noise of a hundredth of an edge (a scan of 35,000 points becomes one of 139,000), or `made^N` for a bumpy ball of N
points. Without any, bumpy balls of 20,000 to a million points with one control point to 85. Over those that are named,
at least two, the growth of the plain fit's seconds is told as an exponent.

`plain` is `recon fit --plain`: all control points from the start. `adaptive` is the default: most of them from the
start, the others where the error is.

Seconds are processor time of one thread. `rounds` is that of the iteration: of least squares six rounds; of a fit those
rounds after which its E_rms is no larger than that of least squares. `memory` is how far a process of its own grows
during the fit beyond what it has with the scan and the compiled code loaded, in multiples of the scan's arrays.

The baseline has the same initial mesh, foot points and basis rows. It solves the full distance, six rounds: the normal
matrix is formed once a round and factorised by SuperLU in symmetric mode with minimum degree ordering, one
factorisation for all three coordinates; conjugate gradients with incomplete factors were slower at these sizes.
Deviations are in per cent of the diagonal of the scan's box.
"""

import argparse
import json
import multiprocessing
import time
from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import ConvexHull, cKDTree
from threadpoolctl import threadpool_limits

from recon.geometric_fit.foot_points import EXACT, Places, nearest_feet, walk_feet
from recon.geometric_fit.guards import fairness
from recon.geometric_fit.initial_mesh import initial_mesh
from recon.geometric_fit.options import FitOptions
from recon.geometric_fit.pipeline import fit_surface
from recon.geometric_fit.scan_data import fold_places
from recon.geometric_fit.tangent_distance import basis_rows
from recon.geometric_fit.updates import Update
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.numerics.distance import TriangleTree, sample_surface
from recon.numerics.halfedges import vertex_normals
from recon.readers.meshes import read_mesh
from recon.subdivision.evaluation import points_at
from recon.subdivision.limit_surface import Scheme, limit_patches, tessellate, tessellation_places
from tables import Table, machine

ROUNDS = 6
COLUMNS = {
    "scan": "24",
    "method": "16",
    "control": "8,d",
    "E_max": "8.3f",
    "E_rms": "8.4f",
    "stray max": "9.3f",
    "stray rms": "9.4f",
    "folds": "5,d",
    "seconds": "8.2f",
    "rounds": "8.2f",
    "memory": "6.1f",
}
SIZES, SHARE = (20_000, 50_000, 134_345, 400_000, 1_000_000), 85  # bumpy balls, and their points a control point


def least_squares(scan, n_control):
    """The fitted control mesh, seconds before the first round, and (error, seconds since) after each round."""
    begin = time.process_time()
    mesh = initial_mesh(scan, n_control)
    patches, points, data = limit_patches(mesh), mesh.vertices, scan.vertices
    energy = fairness(mesh, np.full(mesh.n_vertices, 1e-4 * len(data) / mesh.n_vertices))
    feet = nearest_feet(patches, patches.points @ points, data, step=1e-5)
    start, record = time.process_time(), []
    for _ in range(ROUNDS):
        rows = basis_rows(patches, feet).matrix(mesh.n_vertices)
        system = sparse.csc_array(rows.T @ rows + energy)
        factors = splu(system, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        points = factors.solve(rows.T @ (data - feet.positions + rows @ points))
        feet = walk_feet(patches, patches.points @ points, data, feet)
        record.append((rms(np.linalg.norm(data - feet.positions, axis=1)), time.process_time() - start))
    return mesh.with_vertices(points), start - begin, record


def rms(x):
    return float(np.sqrt(np.mean(x * x)))


def both_ways(scan, mesh, tree, diagonal, scheme=Scheme.LOOP):
    """Data to surface, surface to data over its area, and folds that the scan does not have."""
    share = 100.0 / diagonal
    patches = limit_patches(mesh, scheme)
    there = share * distances(patches, patches.points @ mesh.vertices, scan.vertices)
    drawn = tessellate(mesh, scheme=scheme, halvings=2, patches=patches)
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


def distances(patches, placed, data):
    """Of the data from the surface; those that seem far off are sought again, as a walk may end too soon, or at a
    crease: from all corners of the nearest triangle of a fine tessellation."""
    feet = nearest_feet(patches, placed, data)
    found = np.linalg.norm(feet.positions - data, axis=1)
    far = np.flatnonzero(found > 3.0 * rms(found))
    *places, triangles = tessellation_places(patches.sheets, 2)
    drawn = points_at(patches.arrays, placed, *places, 1)[:, 0]
    for corner in triangles[TriangleTree(drawn, triangles).closest(data[far]).faces].T:
        again = walk_feet(patches, placed, data[far], Places(*(x[corner] for x in places)), step=EXACT).positions
        found[far] = np.minimum(found[far], np.linalg.norm(again - data[far], axis=1))
    return found


def row(name, scan, n_control, schemes):
    diagonal = float(np.linalg.norm(np.ptp(scan.vertices, axis=0)))
    tree = TriangleTree(scan.vertices, scan.face_vertices)
    mesh, before, record = least_squares(scan, n_control)
    goal = record[-1][0] / diagonal * 100.0
    out = [{"scan": name, "method": "least squares", "control": mesh.n_vertices, "seconds": before + record[-1][1]}]
    out[0]["points"] = scan.n_vertices
    out[0] |= {"rounds_seconds": record[-1][1]} | both_ways(scan, mesh, tree, diagonal)
    methods = [("plain", Scheme.LOOP, True), ("adaptive", Scheme.LOOP, False)]
    if schemes:
        methods += [(str(scheme), scheme, False) for scheme in Scheme if scheme is not Scheme.LOOP]
    for method, scheme, plain in methods:
        options, clock = FitOptions(scheme=scheme, control_points=n_control, plain=plain), []
        begin = time.process_time()
        fit = fit_surface(scan, options, doing=lambda step, clock=clock: clock.append((step, time.process_time())))
        line = {"scan": name, "method": method, "control": fit.mesh.n_vertices}
        line |= {"points": scan.n_vertices, "seconds": time.process_time() - begin}
        line |= {"rounds_seconds": reached(fit, [at for step, at in clock if step.startswith("round ")], goal)}
        line |= {"memory": grown(scan, options) / (scan.vertices.nbytes + scan.face_vertices.nbytes)}
        out.append(line | both_ways(scan, fit.mesh, tree, diagonal, scheme))
    return out


def reached(fit, ends, goal):
    """Seconds of the rounds until E_rms is no larger than the goal; None where it never is.

    ends  when each round of the last attempt, and of those before, was over
    """
    ends = ends[-len(fit.rounds) :]
    number = next((i for i, r in enumerate(fit.rounds) if r.errors.rms <= goal), None)
    # when the first round began is not told: it took as long as the second
    return None if number is None else ends[number] - ends[0] + ends[1] - ends[0]


def grown(scan, options):
    """Bytes by which a process grows during a fit; a new one, as memory once used is used again."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(growth_here, (scan.vertices, scan.face_vertices, options))


def growth_here(vertices, faces, options):
    scan = TriangleMesh(vertices, faces, "scan")
    del vertices, faces
    with threadpool_limits(limits=1):
        fit_surface(bumpy_ball(2000), FitOptions(scheme=options.scheme, control_points=200, plain=options.plain))
        Path("/proc/self/clear_refs").write_text("5")  # forget the peak until now
        held = resident("VmRSS")
        fit_surface(scan, options)
    return resident("VmHWM") - held


def resident(key):
    """Bytes in memory now (VmRSS) or at the peak (VmHWM), as Linux tells."""
    rows = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(row.split()[1]) for row in rows if row.startswith(key))


def scan_of(word):
    """The scan that a word of the command line stands for."""
    name, _, power = word.partition("^")
    if name == "made":
        return bumpy_ball(int(power))
    scan = read_mesh(name).mesh
    for _ in range(int(power or 0)):
        fine = tessellate(ControlMesh.from_faces(scan.vertices, scan.face_vertices), halvings=1)
        edge = np.linalg.norm(fine.corners()[:, 1] - fine.corners()[:, 0], axis=1).mean()
        waves = np.random.default_rng(1).normal(size=(3, 6)) / (4.0 * edge)
        noise = np.sin(fine.vertices @ waves).sum(axis=1, keepdims=True)
        normals = vertex_normals(fine.vertices, fine.face_vertices)
        scan = TriangleMesh(fine.vertices + 0.01 * edge * noise * normals, fine.face_vertices, scan.name)
    return scan


def bumpy_ball(n):
    """A sphere with waves, n points spread evenly."""
    k = np.arange(n) + 0.5
    z, turn = 1.0 - 2.0 * k / n, np.pi * (1.0 + np.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - z * z)
    unit = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
    faces = ConvexHull(unit).simplices.astype(np.int64)
    a, b, c = unit[faces].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    faces[inward] = faces[inward][:, ::-1]
    x = 9.0 * unit
    bumps = np.sin(x[:, 0]) * np.cos(0.8 * x[:, 1]) + 0.5 * np.sin(1.9 * x[:, 1] + 1.0) * np.sin(2.1 * x[:, 2])
    return TriangleMesh(unit * (1.0 + 0.06 * bumps)[:, None], faces, f"bumpy ball of {n}")


def draw_updates(path, scan, n_control, n_rounds=20):
    """Error over rounds and over time for every update, as one picture."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    figure, (by_round, by_time) = pyplot.subplots(1, 2, figsize=(11, 4.5), sharey=True, layout="constrained")
    records = {}
    for update in Update:
        fit = fit_surface(scan, FitOptions(control_points=n_control, plain=True, update=update, rounds=n_rounds))
        records[str(update)] = [(r.number, r.errors.rms, r.errors.maximum, r.seconds) for r in fit.rounds]
        number, rms_error, _, seconds = zip(*records[str(update)])
        by_round.semilogy(number, rms_error, "o-", markersize=3, label=str(update))
        by_time.semilogy(np.array(seconds) - 2 * seconds[0] + seconds[1], rms_error, "o-", markersize=3)
    by_round.set(xlabel="round", ylabel="E_rms, % of the diagonal")
    by_time.set(xlabel="seconds of iteration")
    by_round.legend()
    figure.suptitle(f"{scan.n_vertices} points, {n_control} control points")
    figure.savefig(path, dpi=120)
    told = (1, 2, 4, 6, 10, n_rounds)
    table = Table({"update": "16"} | {f"round {i}": "9.4f" for i in told})
    for name, record in records.items():
        table.row(name, *(record[i - 1][1] for i in told))
    return records


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "scans", nargs="*", default=[f"made^{n}:{n // SHARE}" for n in SIZES], help="SCAN:CONTROL_POINTS"
    )
    parser.add_argument("--schemes", action="store_true", help="Catmull-Clark and Doo-Sabin surfaces too")
    parser.add_argument("--updates", type=Path, help="draw all updates side by side, too, of the first scan")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    lines = []
    print(f"{machine('scipy')}, one thread; deviations in per cent of the diagonal\n")
    with threadpool_limits(limits=1):
        # compiled code is read from its cache once, outside the clock
        for scheme in Scheme:
            fit_surface(bumpy_ball(2000), FitOptions(scheme=scheme, control_points=200, plain=True))
        table = Table(COLUMNS)
        for word in options.scans:
            word, count = word.rsplit(":", 1)
            for line in row(Path(word).name, scan_of(word), int(count), options.schemes):
                lines.append(line)
                table.row(*cells(line))
        print_growth([line for line in lines if line["scan"].startswith("made^")])
        if options.updates is not None:
            word, count = options.scans[0].rsplit(":", 1)
            print(f"\nE_rms after rounds of all updates, of {word}:\n")
            records = draw_updates(options.updates, scan_of(word), int(count))
            lines.append({"updates": records})
            print(f"\n![Error over rounds and over time]({options.updates.name})")
    if options.json is not None:
        options.json.write_text(json.dumps(lines, indent=1, default=float))


def print_growth(lines):
    """The exponent of the seconds over the points, of bumpy balls with as many points a control point."""
    for method in ("least squares", "plain", "adaptive"):
        sizes = np.log([(x["points"], x["seconds"]) for x in lines if x["method"] == method])
        if len(sizes) > 1:
            print(f"\n{method}: seconds grow with the points to the {np.polyfit(*sizes.T, 1)[0]:.2f}")


def cells(line):
    """A line in the order of COLUMNS."""
    errors = ("e_max", "e_rms", "stray_max", "stray_rms", "folds")
    return [line.get(key) for key in ("scan", "method", "control", *errors, "seconds", "rounds_seconds", "memory")]


if __name__ == "__main__":
    main()
