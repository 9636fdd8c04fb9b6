"""B-spline and NURBS surfaces of scans, beside pygismo where it is installed: error, folds, seconds.

    python benchmarks/bspline_fit.py SCAN:CONTROL_POINTS ... [--updates] [--json FILE]

SCAN is a file; `view:FILE^N` for what a scanner along z sees of it, an image N points wide with noise of a fiftieth of
a step, its largest part; or `made:wavy^N`, `made:tube^N`, `made:torus^N` for a surface of about N points with noise of
a three-thousandth of its size. Both programs get the same places in the unit square and the same degree, and pygismo as
many control points in equal spans, so that the seconds are those of the fit; unrolling the scan has a column of its
own. pygismo (MPL 2, a peer of the benchmark alone) fits by sparse least squares, without and with ROUNDS corrections of
the places; of a torus or a tube it gets the unrolled scan without its period.

Deviations are in per cent of the diagonal, of all vertices of the scan, from exact foot points found the same way for
every surface. Seconds are processor time.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
from numba import njit
from threadpoolctl import threadpool_limits

from recon.geometric_fit.convergence import norms
from recon.geometric_fit.spline_fit import SplineKind, SplineOptions, fit_sheet
from recon.geometric_fit.spline_space import SplineSpace
from recon.geometric_fit.tensor_space import TensorSpace, nearest_net_feet
from recon.geometric_fit.unrolling import unrolled
from recon.geometric_fit.updates import Update
from recon.geometry.mesh import TriangleMesh
from recon.numerics.bspline_basis import clamped_knots
from recon.numerics.halfedges import connected_components
from recon.readers.meshes import read_mesh
from tables import Table, machine

COLUMNS = {
    "scan": "24",
    "method": "32",
    "control": "8,d",
    "E_mean": "9.4f",
    "E_rms": "9.4f",
    "E_max": "8.3f",
    "folds": "5,d",
    "seconds": "8.2f",
    "unrolling": "9.2f",
}
ROUNDS = 6
SMOOTHING = 1e-9


def made(kind, n, noise=1e-3 / 3.0):
    """A wavy sheet, a bent tube or a wavy torus of about n points; noise is a share of its size."""
    rows = round(np.sqrt(n / 2.0))
    around = {"wavy": (False, False), "tube": (True, False), "torus": (True, True)}[kind]
    i, j = np.indices((2 * rows, rows))
    a = i / (2 * rows - (0 if around[0] else 1))
    b = j / (rows - (0 if around[1] else 1))
    u, v = 2.0 * np.pi * a, 2.0 * np.pi * b
    if kind == "wavy":
        points = [4.0 * a, 2.0 * b, 0.2 * np.sin(9.0 * a) * np.cos(7.0 * b) + 0.05 * np.sin(31.0 * a + 23.0 * b)]
    elif kind == "tube":
        r = 1.0 + 0.1 * np.sin(3.0 * u) * np.cos(5.0 * b)
        points = [r * np.cos(u) + b * b, r * np.sin(u), 5.0 * b]
    else:
        r = 1.0 + 0.1 * np.sin(5.0 * u) * np.cos(3.0 * v)
        points = [(3.0 + r * np.cos(v)) * np.cos(u), (3.0 + r * np.cos(v)) * np.sin(u), r * np.sin(v)]
    number = np.arange(2 * rows * rows).reshape(2 * rows, rows)
    number = np.pad(number, [(0, int(around[0])), (0, int(around[1]))], mode="wrap")
    p, q, r, s = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack([p, q, r], axis=-1).reshape(-1, 3), np.stack([p, r, s], axis=-1).reshape(-1, 3)])
    vertices = np.stack(points, axis=-1).reshape(-1, 3)
    off = noise * np.ptp(vertices) * np.random.default_rng(1).normal(size=vertices.shape)
    return TriangleMesh(vertices + off, faces, f"{kind} of {len(vertices)}")


def range_view(mesh, n):
    """The side of a mesh that faces +z as a range scan: a depth image in triangles, without jumps, the largest part."""
    low, step = mesh.vertices.min(axis=0), np.ptp(mesh.vertices, axis=0)[:2].max() / (n - 1)
    depth = _depths(mesh.vertices, mesh.face_vertices, n, (low[0], low[1], step))
    noise = 0.02 * step * np.random.default_rng(0).normal(size=depth.shape)
    i, j = np.indices((n, n))
    points = np.stack([low[0] + i * step, low[1] + j * step, depth + noise], axis=-1).reshape(-1, 3)
    number = np.arange(n * n).reshape(n, n)
    p, q, r, s = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack([p, q, r], axis=-1).reshape(-1, 3), np.stack([p, r, s], axis=-1).reshape(-1, 3)])
    faces = faces[np.isfinite(points[faces]).all(axis=(1, 2))]
    faces = faces[np.ptp(points[faces][:, :, 2], axis=1) < 4.0 * step]
    seen = TriangleMesh(np.nan_to_num(points, neginf=0.0), faces, f"view of {mesh.name}")
    part = connected_components(faces)
    return seen.part(part == np.bincount(part).argmax())


@njit
def _depths(vertices, faces, n, grid):
    """(n, n) largest z over each point of a grid (x0, y0, step); minus infinity where nothing is."""
    depth = np.full((n, n), -np.inf)
    x0, y0, step = grid
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if area == 0.0:
            continue
        left, right = (min(a[0], b[0], c[0]) - x0) / step, (max(a[0], b[0], c[0]) - x0) / step
        low, high = (min(a[1], b[1], c[1]) - y0) / step, (max(a[1], b[1], c[1]) - y0) / step
        for i in range(max(int(left), 0), min(int(right) + 2, n)):
            for j in range(max(int(low), 0), min(int(high) + 2, n)):
                x, y = x0 + i * step - a[0], y0 + j * step - a[1]
                v = (x * (c[1] - a[1]) - (c[0] - a[0]) * y) / area
                w = ((b[0] - a[0]) * y - x * (b[1] - a[1])) / area
                if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
                    depth[i, j] = max(depth[i, j], a[2] + v * (b[2] - a[2]) + w * (c[2] - a[2]))
    return depth


def scan_of(word):
    if word.startswith("made:"):
        kind, n = word[5:].split("^")
        return made(kind, int(n))
    if word.startswith("view:"):
        path, n = word[5:].split("^")
        return range_view(read_mesh(path).mesh, int(n))
    return read_mesh(word).mesh


def pygismo_rows(scan, n_control):
    """Errors and seconds of pygismo's fit in equal spans, without and with corrected places."""
    import pygismo

    flat = unrolled(scan)
    sheet = flat.sheet
    points = sheet.mesh.vertices[: len(sheet.origins)]
    low, size = points.min(axis=0), float(np.linalg.norm(np.ptp(points, axis=0)))
    n_u = round(np.sqrt(n_control * flat.sides[0] / flat.sides[1]))
    shape = n_u, n_control // n_u
    knots = [clamped_knots(np.linspace(0.0, 1.0, n - 2), 3) for n in shape]
    basis = pygismo.nurbs.gsTensorBSplineBasis2(*[pygismo.nurbs.gsKnotVector(t.tolist(), 3) for t in knots])
    places = np.asfortranarray(flat.places[: len(points)].T)
    begin = time.process_time()
    fit = pygismo.modelling.gsFitting(places, np.asfortranarray((points - low).T / size), basis)
    fit.compute(SMOOTHING)
    space = TensorSpace(*(SplineSpace(3, np.linspace(0.0, 1.0, n - 2)) for n in shape))
    for corrections in (0, ROUNDS):
        if corrections:
            fit.parameterCorrection(1e-8, corrections, 1e-6)
        seconds = time.process_time() - begin
        net = fit.result().coefs().reshape(shape[1], shape[0], 3).transpose(1, 0, 2) * size + low
        feet = nearest_net_feet(space, np.concatenate([net, np.ones((*shape, 1))], axis=2), points)
        errors = norms(np.linalg.norm(feet.positions - points, axis=1), size)
        line = {"method": f"pygismo, {corrections} corrections", "control": shape[0] * shape[1], "seconds": seconds}
        yield line | {"e_mean": errors.mean, "e_rms": errors.rms, "e_max": errors.maximum}
        begin += time.process_time() - begin - seconds  # the measure is not part of the fit


def our_row(scan, method, options):
    begin = time.process_time()
    unrolled(scan)
    before = time.process_time() - begin
    fit = fit_sheet(scan, options)
    seconds = time.process_time() - begin - 2.0 * before
    errors = fit.errors
    line = {"method": method, "control": fit.space.n_control, "seconds": seconds, "unrolling": before}
    return line | {"e_mean": errors.mean, "e_rms": errors.rms, "e_max": errors.maximum, "folds": fit.folds}


def rows(name, scan, n_control, updates):
    methods = {
        "plain": SplineOptions(control_points=n_control, plain=True),
        "adaptive": SplineOptions(control_points=n_control),
        "NURBS": SplineOptions(control_points=n_control, kind=SplineKind.NURBS),
    }
    if updates:
        methods = {
            str(update): SplineOptions(control_points=n_control, plain=True, update=update, rounds=3 * ROUNDS)
            for update in Update
        }
    else:
        try:
            yield from ({"scan": name} | line for line in pygismo_rows(scan, n_control))
        except ImportError:
            print("pygismo is not installed; pip install pygismo to see it beside us", file=sys.stderr)
    for method, options in methods.items():
        yield {"scan": name} | our_row(scan, method, options)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scans", nargs="+", help="SCAN:CONTROL_POINTS")
    parser.add_argument("--updates", action="store_true", help="all updates side by side instead, in equal spans")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    lines = []
    print(f"{machine()}, one thread; deviations in per cent of the diagonal\n")
    table = Table(COLUMNS)
    with threadpool_limits(limits=1):
        # compiled code is read from its cache once, outside the clock
        fit_sheet(made("torus", 1000), SplineOptions(control_points=100, kind=SplineKind.NURBS))
        for word in options.scans:
            word, count = word.rsplit(":", 1)
            for line in rows(Path(word).name, scan_of(word), int(count), options.updates):
                lines.append(line)
                table.row(*cells(line))
    if options.json is not None:
        options.json.write_text(json.dumps(lines, indent=1, default=float))


def cells(line):
    """A line in the order of COLUMNS."""
    keys = ("scan", "method", "control", "e_mean", "e_rms", "e_max", "folds", "seconds", "unrolling")
    return [line.get(key) for key in keys]


if __name__ == "__main__":
    main()
