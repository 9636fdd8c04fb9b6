"""Inputs drawn by chance for every method: how many pass the gate, are refused with a reason, or come out wrong.

python benchmarks/robustness.py                     200 of each method, a row of a table each
python benchmarks/robustness.py views voxels        these methods
python benchmarks/robustness.py fit --first 40 --n 10

patch     sherds of vessels, see hole_patch_robustness.py; their sizes are those of vessels
fit       balls, tori, tubes and sheets with waves: 700 to 2,000 points, noise, up to three holes, any pose; as
          `recon fit` makes solids and shells of them
terrain   fractal grounds and their contours: 24 to 40 cells wide, smooth to rough, noise, voids, far from the origin
voxels    blocks, balls and cylinders in any pose, joined and cut: 12 to 24 voxels wide, wrong voxels at the surface,
          single empty ones inside
views     blocks with cuts, slanted ones, turned ones, in any of the 24 poses: coordinates off by up to a ten-thousandth
          of the size, lines in pieces, half of them parted from one sheet

All but vessels are scaled by 1e-3 to 1e6, from sizes of some 50 mm, or 600 m of ground. Passed is what the gate passes
and is none of the wrong ones, which are told from what the input was made of:

fit       points without their noise lie farther off on average than a hundredth of the diagonal and three times the
          noise
terrain   height errors over twice those of the triangulated contours and a hundredth of the relief, or faces that meet
          at more than 0.1 degrees
voxels    bodies or cavities of another number than the grid has, over half a voxel from its surface, or another volume
views     a solid that does not draw as given, or, of a drawing whose solids are all listed, none like the part
"""

import argparse
import logging
import os
import re
import sys
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[1]))

import hole_patch_robustness
from brep_export.app.fit_job import CLOSE_CAPS
from brep_export.app.limit_shape import limit_shape
from brep_export.app.terrain_job import TOLERANCE, lowest_place
from brep_export.app.views_job import SLACK
from brep_export.app.voxel_bodies import faceted_body
from brep_export.app.voxel_proof import FIT, FLAT
from brep_export.app.workshop import Bench
from brep_export.blocks import block_solid
from brep_export.check import CheckReport, check
from brep_export.solids import polyhedron_solid
from bspline_fit import made
from drawn_parts import KINDS, part, solid_volume
from geometric_fit import bumpy_ball
from hole_patch_robustness import Verdict
from recon.errors import ReconError
from recon.geometric_fit.options import FitOptions
from recon.geometric_fit.row_fit import fit_rows
from recon.geometry.contour_map import HeightGrid
from recon.geometry.mesh import TriangleMesh
from recon.geometry.polyhedron import Polyhedron
from recon.geometry.views import DrawnView, ThreeViews
from recon.geometry.voxel_grid import VoxelGrid
from recon.numerics.distance import closest_points
from recon.readers.view_sheet import Strokes, separate_views
from recon.subdivision.limit_surface import Scheme, tessellate
from recon.terrain.contouring import contour_grid
from recon.terrain.evaluation import edge_angles, elevations
from recon.terrain.network import terrain_network
from recon.terrain.pipeline import terrain_surface
from recon.three_view.hidden_lines import draw
from recon.three_view.pipeline import ViewsOptions, interpret
from recon.tolerance import Tolerance
from recon.voxel_mesh.pipeline import VoxelOptions
from recon.voxel_mesh.topology import grid_topology
from tables import Table, machine
from terrain import fractal_mountain, triangulation

COLUMNS = {"method": "8", "tried": "5,d", "passed": "6,d", "refused": "7,d", "wrong": "5,d", "seconds each": "12.1f"}
N = 200
SCALES = (-3.0, 6.0)  # powers of ten
NUMBER = re.compile(r"[-+]?\d[\d.,]*(?:e[-+]?\d+)?")

Rng = np.random.Generator


@dataclass(frozen=True)
class Outcome:
    """What came of one input, and why where it did not pass."""

    verdict: Verdict
    reason: str = ""


def judged(report: CheckReport, wrong: str = "") -> Outcome:
    """Refused by the gate, else wrong where a reason is given for that."""
    if report.defects:
        return Outcome(Verdict.REFUSED, f"gate: {report.defects[0]}")
    return Outcome(Verdict.WRONG, wrong) if wrong else Outcome(Verdict.PASSED)


def scale_of(rng: Rng) -> float:
    return float(10 ** rng.uniform(*SCALES))


def quiet_bench() -> Bench:
    return Bench(lambda message: None)


def views_trial(rng: Rng) -> Outcome:
    kind = sorted(KINDS)[rng.integers(3)]
    solid = posed(part(kind, int(rng.integers(10_000)), int(rng.integers(2, 7))), rng)
    noise = rng.choice([0.0, 1e-6, 1e-4]) * float(np.ptp(solid.vertices, axis=0).max())
    drawing = ThreeViews(*(in_pieces(view, noise, rng) for _, view in draw(solid)))
    if rng.random() < 0.5:
        drawing = from_a_sheet(drawing)
    found = interpret(drawing, ViewsOptions(limit=300, seconds=0.0))
    solids = [found.polyhedron(k) for k in range(min(found.labelings.listed, 300))]
    wrong = "a solid does not draw as given" if any(map(found.differences, solids[:10])) else ""
    volume = solid_volume(solid)
    if found.complete and all(abs(solid_volume(made) - volume) > 1e-2 * volume for made in solids):
        wrong = "none of the solids is the part"
    tolerance = Tolerance(merge=found.snap, fit=SLACK * found.snap)
    return judged(check(polyhedron_solid(solids[0]), tolerance), wrong)


def posed(solid: Polyhedron, rng: Rng) -> Polyhedron:
    """Scaled, moved, and turned to one of the 24 poses along the axes."""
    turn = Rotation.create_group("O")[int(rng.integers(24))].as_matrix().round()
    scale = scale_of(rng)
    return Polyhedron(scale * (solid.vertices @ turn.T + rng.uniform(-100, 100, 3)), solid.faces, solid.bodies)


def in_pieces(view: DrawnView, noise: float, rng: Rng) -> DrawnView:
    """Every coordinate off, and some lines cut in two or drawn twice."""
    lines, hidden = list(view.segments), list(view.hidden)
    for k in np.flatnonzero(rng.random(len(lines)) < 0.1):
        if rng.random() < 0.5:
            middle = lines[k][0] + rng.uniform(0.2, 0.8) * (lines[k][1] - lines[k][0])
            lines[k], rest = np.array([lines[k][0], middle]), np.array([middle, lines[k][1]])
            lines.append(rest)
        else:
            lines.append(lines[k])
        hidden.append(hidden[k])
    rows = np.array(lines)
    return DrawnView(rows + rng.uniform(-noise, noise, rows.shape), np.array(hidden))


def from_a_sheet(drawing: ThreeViews) -> ThreeViews:
    """The views side by side in third angle, parted again."""
    front, top, side = (v.segments - v.segments.reshape(-1, 2).min(axis=0) for _, v in drawing)
    right, up = 1.3 * front.reshape(-1, 2).max(axis=0)
    lines = np.concatenate([front, top + np.array([0.0, up]), side + np.array([right, 0.0])])
    return separate_views(Strokes(lines, np.concatenate([v.hidden for _, v in drawing])), "sheet").drawing


def voxels_trial(rng: Rng) -> Outcome:
    grid = chance_grid(rng)
    body = faceted_body(grid, VoxelOptions(), bench=quiet_bench())
    report = check(body.shape, Tolerance(merge=FLAT * grid.voxel, fit=FIT * grid.voxel))
    if report.defects:
        return judged(report)
    kernel, topology = report.as_json(), grid_topology(grid.solid)
    off = float(body.errors.max() / grid.voxel)
    wrong = "" if off <= 0.5 + 1e-6 else f"{off:.2f} voxels off"
    if (kernel["solids"], kernel["shells"]) != (topology.bodies, topology.bodies + topology.cavities):
        wrong = f"{kernel['solids']} bodies of {topology.bodies}"
    counted = float(grid.solid.sum() * grid.spacing.prod())
    # at corners marching cubes take off less than half a voxel of the whole surface
    if abs(kernel["volume"] - counted) > 0.5 * grid.spacing.max() * kernel["area"]:
        wrong = f"volume {kernel['volume'] / counted:.3f} of the voxels'"
    return judged(report, wrong)


def chance_grid(rng: Rng) -> VoxelGrid:
    n = int(rng.integers(12, 25))
    centres = np.stack(np.meshgrid(*3 * [np.linspace(-1.2, 1.2, n)], indexing="ij"), axis=-1)
    solid = np.zeros((n, n, n), dtype=bool)
    for k in range(int(rng.integers(1, 6))):
        turn, size = Rotation.random(random_state=int(rng.integers(2**31))), rng.uniform(0.2, 0.7, 3)
        x, y, z = np.moveaxis((centres - rng.uniform(-0.4, 0.4, 3)) @ turn.as_matrix() / size, -1, 0)
        block, ball, rod = np.maximum(abs(x), np.maximum(abs(y), abs(z))), x * x + y * y + z * z, x * x + y * y
        tool = (block < 1, ball < 1, (rod < 1) & (abs(z) < 1))[rng.integers(3)]
        solid = solid & ~tool if k and rng.random() < 0.4 else solid | tool
    if not solid.any():
        solid[n // 2, n // 2, n // 2] = True
    beside = np.zeros_like(solid)
    for axis in range(3):
        beside |= (np.roll(solid, 1, axis) != solid) | (np.roll(solid, -1, axis) != solid)
    solid = solid ^ (beside & (rng.random(solid.shape) < rng.choice([0.0, 0.02, 0.1])))
    solid &= rng.random(solid.shape) >= rng.choice([0.0, 0.002])
    solid[n // 2, n // 2, n // 2] = True
    spacing = 2.0 * scale_of(rng) * rng.choice([0.5, 1.0, 1.0, 2.0], 3)
    place = {"origin": spacing * rng.uniform(-50, 50, 3), "direction": np.eye(3)}
    if rng.random() < 0.3:
        place["direction"] = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    return VoxelGrid(spacing=spacing, solid=solid, name="grid", **place)


def fit_trial(rng: Rng) -> Outcome:
    clean, scan, noise = chance_scan(rng)
    fitted = fit_rows(scan, FitOptions(scheme=Scheme.CATMULL_CLARK))
    made_shape = limit_shape(fitted.mesh, fitted.scheme, 0.1, quiet_bench(), accuracy=CLOSE_CAPS)
    report = check(made_shape.shape, made_shape.tolerance, expect=made_shape.kind)
    drawn = tessellate(fitted.mesh, scheme=fitted.scheme, halvings=2)
    off = closest_points(clean, drawn.vertices, drawn.face_vertices).distances
    diagonal = float(np.linalg.norm(np.ptp(clean, axis=0)))
    allowed = 0.01 * diagonal + 3 * noise
    return judged(report, "" if off.mean() <= allowed else f"{100 * off.mean() / diagonal:.1f} % of the diagonal off")


def chance_scan(rng: Rng) -> tuple[np.ndarray, TriangleMesh, float]:
    """Points without noise, the scan, and the deviation of its noise."""
    kind, n = ("ball", "torus", "tube", "wavy")[rng.integers(4)], int(10 ** rng.uniform(2.85, 3.3))
    mesh = bumpy_ball(n) if kind == "ball" else made(kind, n, noise=0.0)
    turn = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    scale = scale_of(rng) * 50 / float(np.ptp(mesh.vertices, axis=0).max())
    points = scale * (mesh.vertices * rng.uniform(0.6, 1.0, 3)) @ turn.T
    faces = mesh.face_vertices
    for _ in range(int(rng.choice([0, 0, 1, 3]))):
        away = np.linalg.norm(points - points[rng.integers(len(points))], axis=1)
        near = away < rng.uniform(0.05, 0.15) * float(np.ptp(points, axis=0).max())
        faces = faces[~near[faces].any(axis=1)]
    used, faces = np.unique(faces, return_inverse=True)
    clean = points[used]
    noise = float(rng.choice([0.0, 3e-4, 2e-3]) * np.ptp(clean, axis=0).max())
    rough = clean + noise * rng.normal(size=clean.shape)
    return clean, TriangleMesh(rough, faces.reshape(-1, 3), "scan"), noise


def terrain_trial(rng: Rng) -> Outcome:
    n, scale = int(rng.integers(24, 41)), scale_of(rng)
    grid = fractal_mountain(n, 10.0, int(rng.integers(10_000)), float(rng.uniform(2.2, 3.2)))
    z = grid.heights * rng.uniform(0.5, 3.0)
    z = z + rng.choice([0.0, 0.005]) * np.ptp(z) * rng.normal(size=z.shape)
    for _ in range(int(rng.choice([0, 0, 1, 2]))):
        i, j = rng.integers(4, n - 10, 2)
        z[i : i + rng.integers(3, 8), j : j + rng.integers(3, 8)] = np.nan
    far = rng.choice([0.0, 1e5])
    ground = HeightGrid(scale * (grid.x + far), scale * (grid.y + far), scale * z)
    contours = contour_grid(ground, float(np.nanmax(z) - np.nanmin(z)) * scale / rng.integers(4, 16))
    surface = terrain_surface(contours)
    network = terrain_network(surface)
    depth = 0.2 * float(np.nanmax(z) - np.nanmin(z)) * scale
    report = check(block_solid(network, lowest_place(network) - depth, TOLERANCE), TOLERANCE)
    places, heights = ground.places()
    flat = triangulation(contours)[0](places)
    known = np.isfinite(flat)
    ours = rms(elevations(surface, places[known])[0] - heights[known])
    allowed = 2 * rms(flat[known] - heights[known]) + 0.01 * scale * float(np.nanmax(z) - np.nanmin(z))
    wrong = "" if ours <= allowed else f"{ours / allowed:.1f} times the error allowed"
    angle = float(np.degrees(edge_angles(surface).max(initial=0.0)))
    return judged(report, wrong if angle <= 0.1 else f"faces meet at {angle:.2g} degrees")


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(x * x)))


def patch_outcomes(seeds: range) -> list[Outcome]:
    """Those of hole_patch_robustness.py, in processes of their own."""
    trials = list(hole_patch_robustness.trials_of(seeds))
    usual = float(np.nanmedian([trial.share for trial in trials]))
    marked = hole_patch_robustness.far_and_marked(trials, usual)
    return [
        Outcome(trial.verdict(usual), "far off, as it is marked" if trial.seed in marked else trial.reason)
        for trial in trials
    ]


TRIALS: dict[str, Callable[[Rng], Outcome]] = {
    "fit": fit_trial,
    "terrain": terrain_trial,
    "voxels": voxels_trial,
    "views": views_trial,
}


def outcome(method: str, seed: int) -> Outcome:
    try:
        return TRIALS[method](np.random.default_rng(seed))
    except ReconError as refusal:
        return Outcome(Verdict.REFUSED, f"{type(refusal).__name__}: {refusal}")


def outcomes(method: str, seeds: range) -> list[Outcome]:
    return patch_outcomes(seeds) if method == "patch" else [outcome(method, seed) for seed in seeds]


def kinds_of(reasons: list[str]) -> Counter[str]:
    """Reasons without their figures."""
    return Counter(NUMBER.sub("#", reason) for reason in reasons)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("methods", nargs="*", choices=["patch", *TRIALS, []], help="all of them where none is named")
    parser.add_argument("--first", type=int, default=0, help="seed of the first input")
    parser.add_argument("--n", type=int, default=N, help="inputs of each method")
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    warnings.simplefilter("ignore")
    print(f"{machine('cadquery-ocp')}; processor time\n")
    table, told = Table(COLUMNS), list[str]()
    seeds = range(arguments.first, arguments.first + arguments.n)
    for method in arguments.methods or ["patch", *TRIALS]:
        begin = seconds()
        found = outcomes(method, seeds)
        counts = Counter(one.verdict for one in found)
        table.row(method, len(found), *(counts[verdict] for verdict in Verdict), (seconds() - begin) / len(found))
        for verdict in Verdict:
            reasons = [one.reason for one in found if one.verdict is verdict and one.reason]
            told += [f"* {method}, {verdict}, {n}: {reason}" for reason, n in kinds_of(reasons).most_common()]
        wrong = [seed for seed, one in zip(seeds, found) if one.verdict is Verdict.WRONG]
        told += [f"* {method}, wrong, seeds {wrong}"] if wrong else []
    print("\n" + "\n".join(told))


def seconds() -> float:
    """Processor time so far, that of child processes included."""
    return sum(os.times()[:4])


if __name__ == "__main__":
    main()
