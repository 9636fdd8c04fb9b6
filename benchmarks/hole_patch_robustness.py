"""The whole way from sherds to a checked shape on vessels drawn by chance: how many pass, are refused, or are wrong.

python benchmarks/hole_patch_robustness.py                 24 vessels
python benchmarks/hole_patch_robustness.py --n 200
python benchmarks/hole_patch_robustness.py --seeds 3 17    these again

passed    the shape passed the gate, and is none of the wrong ones
refused   no piece was made, or the gate kept it back; the reason stands behind
wrong     the gate passed it, but it is far off, and farther than it is marked with: by more than 1.645 times the error
          that its own answer says is to be expected, within which nine points in ten are to lie

Far off is a piece whose outer wall is on average more than three times as far from the wall that was lost as is usual
here, measured in thicknesses of the wall, and farther than the scan's noise, or whose volume is off by more than 15 %.
Far pieces that are marked as such are counted and named apart: sherds that lie askew, and cracks that nobody scanned,
leave no piece that is known better, but whoever uses it is told.

Every vessel has a process of its own and two minutes. Distances in millimetres, mean and largest: of the hole's scanned
edge from the surface, and inside the hole of the surface from the vessel before its relief was pressed, beside the
error that is marked on it; the volume as a share of the lost sherd's, beside the marked error of that.
"""

import argparse
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from brep_export.app.workshop import Bench, Exit, run
from recon.hole_patch.confidence import BOUND
from vessels.chance_vessels import Lot, chance_vessel, draw

LIMIT = 120.0  # seconds
FAR, OFF = 3.0, 0.15  # beyond which a piece is far off: times the usual distance, share of the volume
COLUMNS = {
    "edge": "edge",
    "edge_max": "max",
    "inside": "inside",
    "inside_max": "max",
    "expected": "marked",
    "volume": "volume",
    "volume_expected": "marked",
}


class Verdict(StrEnum):
    PASSED = "passed"
    REFUSED = "refused"
    WRONG = "wrong"


@dataclass(frozen=True)
class Trial:
    """How it went with one seed: figures of the piece, or why there is none."""

    seed: int
    lot: Lot
    figures: Mapping[str, float] | None
    reason: str = ""

    @property
    def share(self) -> float:
        """Mean distance inside the hole, in thicknesses of the wall."""
        return np.nan if self.figures is None else self.figures["inside"] / self.lot.options.thickness

    def far(self, usual: float) -> bool:
        """Whether it is a piece, and far off."""
        return self.figures is not None and (self._wall_off(usual) or self._volume_off)

    def verdict(self, usual: float) -> Verdict:
        if self.figures is None:
            return Verdict.REFUSED
        wall = self._wall_off(usual) and self.figures["inside"] > BOUND * self.figures["expected"]
        volume = self._volume_off and abs(self.figures["volume"] - 1.0) > BOUND * self.figures["volume_expected"]
        return Verdict.WRONG if wall or volume else Verdict.PASSED

    def _wall_off(self, usual: float) -> bool:
        assert self.figures is not None
        return self.share > FAR * usual and self.figures["inside"] > self.lot.options.noise

    @property
    def _volume_off(self) -> bool:
        assert self.figures is not None
        return abs(self.figures["volume"] - 1.0) > OFF


def mend(request: Mapping[str, Any], bench: Bench) -> tuple[Exit, dict[str, Any], tuple[str, ...]]:
    """Job: make the vessel of a seed, find its missing piece, build it, draw the gate's lines on it, measure it."""
    from brep_export.app.patch_job import built
    from brep_export.triangulation import triangulate
    from recon.hole_patch.confidence import confidence
    from recon.hole_patch.pipeline import PatchOptions, patch_readings
    from vessels.cases import DEFLECTION, deviation, outer_face

    lot = draw(request["seed"])
    bench.doing("making the vessel")
    vessel = chance_vessel(lot)
    options = PatchOptions(thickness=vessel.thickness if lot.outer_only else None)
    with bench.phase("patch", "finding the piece"):
        found = built(patch_readings(vessel.sherds, options, doing=bench.doing), bench)
    piece, shape, report = found.piece, found.shape, found.report
    if report.defects:
        return Exit.REFUSED, {}, tuple(f"gate: {defect}" for defect in report.defects)
    bench.doing("measuring")
    edge, inside = piece.outer.edge_distance, deviation(outer_face(piece), vessel.plain)
    trust, triangles = confidence(piece), triangulate(shape, DEFLECTION).mesh
    expected = trust.outer.at_parameters(trust.outer.places)
    figures = {
        "edge": float(edge.mean()),
        "edge_max": float(edge.max()),
        "inside": inside.mean,
        "inside_max": inside.maximum,
        "expected": float(np.sqrt((expected**2).mean())),
        "volume": triangles.volume() / vessel.lost.volume(),
        "volume_expected": trust.of(triangles).volume / triangles.volume(),
        "seconds": bench.seconds["patch"],
    }
    return Exit.WRITTEN, figures, ()


def trial(seed: int) -> Trial:
    answer = run("hole_patch_robustness:mend", {"seed": seed}, timeout=LIMIT)
    if answer.status is Exit.WRITTEN:
        return Trial(seed, draw(seed), answer.result)
    return Trial(seed, draw(seed), None, "; ".join(answer.reasons))


def trials_of(seeds: Sequence[int]) -> Iterator[Trial]:
    """In the order of the seeds, as many at a time as there are processors."""
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        yield from threads.map(trial, seeds)


def line(trial: Trial) -> str:
    lot, options = trial.lot, trial.lot.options
    what = f"{trial.seed:5} {options.height:5.0f}{options.thickness:6.1f}{options.relief:6.2f}{options.noise:6.2f}"
    what += f"{options.misplacement:6.2f} {'outer' if lot.outer_only else 'closed':7}{lot.place:6}"
    if trial.figures is None:
        return f"{what} refused: {trial.reason}"
    f = trial.figures
    return what + "".join(f"{f[key]:8.3f}" for key in COLUMNS) + (f"{f['seconds']:7.1f}")


def far_and_marked(trials: Sequence[Trial], usual: float) -> list[int]:
    return [t.seed for t in trials if t.far(usual) and t.verdict(usual) is Verdict.PASSED]


def summary(trials: Sequence[Trial]) -> None:
    usual = float(np.nanmedian([t.share for t in trials])) if any(t.figures for t in trials) else np.nan
    print(f"\nusual distance inside: {usual:.4f} of the wall's thickness")
    for verdict in Verdict:
        seeds = [t.seed for t in trials if t.verdict(usual) is verdict]
        print(f"{verdict:8} {len(seeds):4} of {len(trials)}  {len(seeds) / len(trials):4.0%}   seeds {seeds}")
    print(f"passed and far off, as marked: seeds {far_and_marked(trials, usual)}")
    reasons = [t.reason for t in trials if t.figures is None]
    for reason in sorted(set(reasons)):
        print(f"   {reasons.count(reason):4}  {reason}")
    worst = sorted((t for t in trials if t.figures), key=lambda t: -t.share)[:5]
    print("farthest off inside: " + ", ".join(f"{t.seed} ({t.share / usual:.1f} x usual)" for t in worst))


def main() -> None:
    parser = argparse.ArgumentParser(description="Missing pieces of vessels drawn by chance.")
    parser.add_argument("--n", type=int, default=24, help="how many vessels")
    parser.add_argument("--seeds", type=int, nargs="+", help="these vessels alone")
    arguments = parser.parse_args()
    seeds = arguments.seeds or range(arguments.n)
    head = f"{'seed':>5} {'high':>5}{'wall':>6}{'cords':>6}{'noise':>6}{'out':>6} {'scan':7}{'lost':6}"
    print(head + "".join(f"{title:>8}" for title in COLUMNS.values()) + f"{'s':>7}")
    trials = []
    for one in trials_of(seeds):
        trials.append(one)
        print(line(one), flush=True)
    summary(trials)


if __name__ == "__main__":
    main()
