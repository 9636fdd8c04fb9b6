"""`recon voxels`, from a volume on disk to checked files."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

RECON = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]
GRIDS = Path(__file__).parents[2].parent / "shared" / "data" / "voxels"


def recon(*words):
    return subprocess.run([*RECON, *map(str, words)], capture_output=True, text=True, timeout=600, check=False)


def volume(path, **places):
    """Two blocks with a label each, one with a void, and a speck."""
    values = np.zeros((30, 20, 16), dtype=np.uint8)
    values[3:14, 4:16, 3:13] = 1
    values[6:10, 7:12, 6:10] = 0
    values[16:27, 4:16, 3:13] = 2
    values[28, 18, 14] = 2
    np.savez(path, voxels=values, **places)
    return path


def test_every_label_becomes_a_solid_with_its_void_and_its_spacing(tmp_path):
    grid = volume(tmp_path / "grid.npz", spacing=np.array([1.0, 0.5, 2.0]), origin=np.array([10.0, 0.0, 0.0]))
    part = tmp_path / "part.step"
    run = recon("voxels", grid, "--label", "all", "--min-voxels", "5", "--tolerance", "0.05", "-o", part, "--json")
    answer = json.loads(run.stdout)
    assert (run.returncode, answer["verdict"]) == (0, "pass"), run.stderr
    room = answer["room"]
    assert (answer["kernel"]["solids"], room["bodies"], room["cavities"], room["genus"]) == (2, 2, 1, 0)
    assert answer["kernel"]["volume"] == pytest.approx(2 * 11 * 12 * 10 - 4 * 5 * 4, rel=0.05)
    low, high = np.array(answer["kernel"]["bounding_box"])
    assert low == pytest.approx([12.5, 1.75, 5.0], abs=0.1)
    assert high == pytest.approx([36.5, 7.75, 25.0], abs=0.1)
    assert room["max_error_voxels"] <= 0.05
    assert any("dropped 1 bodies" in note for note in answer["notes"])
    assert part.exists()


def test_snapped_true_faces_hit_the_round_sizes_of_a_block(tmp_path):
    axis = np.arange(60) - 30 + 0.137
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    solid = (np.abs(x) < 24) & (np.abs(y) < 20) & (np.abs(z) < 16) & ~(x**2 + y**2 < 10**2)
    np.savez(tmp_path / "grid.npz", voxels=solid, spacing=np.full(3, 0.25), origin=np.full(3, 0.25 * axis[0]))
    run = recon("voxels", tmp_path / "grid.npz", "--analytic", "--snap", "0.5", "-o", tmp_path / "part.step", "--json")
    answer = json.loads(run.stdout)
    assert (run.returncode, answer["verdict"]) == (0, "pass"), run.stderr
    assert answer["room"]["analytic"] | {"planes": 6, "cylinders": 1, "fallback_faces": 0} == answer["room"]["analytic"]
    assert answer["room"]["voxels_on_wrong_side"] == 0
    assert answer["kernel"]["volume"] == pytest.approx((12 * 10 - np.pi * 2.5**2) * 8, rel=1e-6)
    offsets = sorted(s["offset"] for s in answer["room"]["surfaces"] if s["kind"] == "plane")
    assert offsets == pytest.approx([4, 4, 5, 5, 6, 6])


def test_a_face_is_not_snapped_onto_the_centres_of_voxels(tmp_path):
    solid = np.zeros((40, 36, 32), dtype=bool)
    solid[5:35, 5:31, 5:27] = True
    np.savez(tmp_path / "grid.npz", voxels=solid, spacing=np.ones(3), origin=np.zeros(3))
    run = recon("voxels", tmp_path / "grid.npz", "--analytic", "--snap", "1", "-o", tmp_path / "part.step", "--json")
    answer = json.loads(run.stdout)
    assert (run.returncode, answer["verdict"]) == (0, "pass"), run.stderr
    assert any("not snapped" in note for note in answer["notes"])
    assert answer["room"]["voxels_on_wrong_side"] == 0


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--threshold", "9"], "no voxel is solid"),
        (["--label", "7"], "--label"),
        (["--label", "few"], "--label"),
        ([], "not binary"),
        (["--label", "1", "--spacing", "1,2"], "--spacing"),
        (["--label", "1", "--fast"], "--fast"),
        (["--label", "1", "--snap", "1"], "--snap"),
        (["--label", "1", "--smooth", "--faces", "99"], "--smooth"),
        (["--label", "1", "--min-voxels", "99999"], "--min-voxels"),
    ],
)
def test_what_makes_no_sense_gets_one_sentence(tmp_path, options, word):
    grid = volume(tmp_path / "grid.npz")
    run = recon("voxels", grid, *options, "-o", tmp_path / "part.step")
    assert run.returncode == 2
    assert word in run.stderr and "Traceback" not in run.stderr
    assert not (tmp_path / "part.step").exists()


@pytest.mark.slow
@pytest.mark.skipif(not GRIDS.is_dir(), reason="the folder of grids is not beside this checkout")
@pytest.mark.parametrize(("name", "snap"), [("bracket_turned", []), ("bracket", ["--snap", "0.5"])])
def test_the_brackets_come_back_with_their_nineteen_faces(tmp_path, name, snap):
    run = recon("voxels", GRIDS / f"{name}.npz", "--analytic", *snap, "-o", tmp_path / "part.step", "--json")
    answer = json.loads(run.stdout)
    assert (run.returncode, answer["kernel"]["faces"]) == (0, 19), run.stderr
    kinds = answer["room"]["analytic"]
    assert (kinds["planes"], kinds["cylinders"], kinds["fallback_faces"]) == (12, 7, 0)
    assert answer["kernel"]["volume"] == pytest.approx(28191.99, rel=3e-3)
    voxel = answer["room"]["spacing"][0]
    radii = sorted(s["radius"] for s in answer["room"]["surfaces"] if "radius" in s)
    assert radii == pytest.approx([3.0] * 6 + [7.0], abs=0.1 * voxel)


def lumpy_grid(path):
    """A block with a hole and, on its top, a lump that is no surface with a formula."""
    x, y, z = np.meshgrid(*[np.arange(44) - 22 + 0.137] * 3, indexing="ij")
    x, z = 0.9553 * x + 0.2955 * z, 0.9553 * z - 0.2955 * x
    block = (np.abs(x) < 15.3) & (np.abs(y) < 13.2) & (z > -12.4) & (z < 0.0) & (np.hypot(x - 8, y) > 4.5)
    lump = ((x + 6) / 6) ** 4 + (y / 8) ** 2 + (z / 12) ** 2 < 1.0
    np.savez(path, voxels=block | (lump & (z > -3.0)), spacing=np.full(3, 0.5), origin=np.zeros(3))
    return path


def test_what_is_not_recognised_stays_triangles_between_true_faces(tmp_path):
    grid = lumpy_grid(tmp_path / "grid.npz")
    run = recon("voxels", grid, "--analytic", "-o", tmp_path / "part.step", "--json")
    answer = json.loads(run.stdout)
    assert (run.returncode, answer["verdict"]) == (0, "pass"), run.stderr
    kinds, listed = answer["room"]["analytic"], answer["room"]["surfaces"]
    assert (kinds["planes"], kinds["cylinders"]) == (6, 1)
    assert kinds["fallback_faces"] == sum(row["faces"] for row in listed if row["kind"] == "triangles") > 20
    assert answer["kernel"]["faces"] == 7 + kinds["fallback_faces"]
    assert all(low <= high for low, high in (row["interval"] for row in listed if "interval" in row))
    assert any("7 faces are true ones" in note for note in answer["notes"])


def test_smooth_triangles_keep_the_voxels_on_their_sides(tmp_path):
    grid = lumpy_grid(tmp_path / "grid.npz")
    run = recon("voxels", grid, "--smooth", "-o", tmp_path / "part.step", "-o", tmp_path / "part.stl", "--json")
    answer = json.loads(run.stdout)
    assert (run.returncode, answer["verdict"]) == (0, "pass"), run.stderr
    solid = np.load(grid)["voxels"]
    surface = sum(np.count_nonzero(np.diff(solid, axis=axis)) for axis in range(3))
    assert answer["room"]["voxels_on_wrong_side"] < 0.01 * surface
    assert answer["kernel"]["volume"] == pytest.approx(solid.sum() * 0.125, rel=0.01)
    assert answer["room"]["analytic"] is None
