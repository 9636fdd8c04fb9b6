"""Rungs of the fracture where the hole's edge runs down a foot ring and up again.

Stations follow each other along their own rungs there, and the nearest point on the inner wall says nothing about where
a rung should end: partners go evenly from the one side of the ring to the other. Straight rungs would run along the
sides, or leave the ring where the fracture bends at its root: they go by way of the ring's throat, evenly too.

      inner loop   ------0-1-2-3-4-5-6------       A, B   where the run begins and ends
      base          ____. \\ \\ \\| / / / .____
      throat             A.. .. .. ...B
      ring              0 |    3    | 6
                        1 '---------' 5
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_opening, gaussian_filter1d
from scipy.spatial import cKDTree

from recon.hole_patch.fracture_band import HEIGHTS, FractureBand
from recon.numerics.rows import unit_vectors

__all__ = ["bend_into_rings", "ring_runs"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ALONG = 0.75  # cosine between a rung and the loop, above which it runs along it
LEVELLED = 0.5  # thicknesses of the loop over which its direction is averaged, and the shortest run along it
TIP = 2.5  # thicknesses: longest way between both sides of a foot ring, round its tip
PULLED, MOST_PULLED = 4.0, 0.9  # to the throat: share for a share of the way that lies below it, and the most
SOON = 0.1  # of the way round a ring, in which rungs come off its sides
OFF_SIDE = 0.12  # of the width of the throat, that rungs keep from the ring's sides


def ring_runs(points: Floats, chord: Floats) -> list[Ints]:
    """Cyclic rows of stations that run down a foot ring, or up it, or both, round its tip.

    points, chord  (n, 3) of a closed loop, about evenly spaced, and from there to the nearest points of the inner one
    """
    n, thick = len(points), _median_length(chord)
    along = np.tile(np.abs(_along_loop(points, chord)) > ALONG, 3)
    shortest, widest = (np.ones(1 + _count(points, share * thick), dtype=bool) for share in (LEVELLED, TIP))
    runs = binary_closing(binary_opening(along, shortest), widest)[n : 2 * n]
    if not runs.any() or runs.all():
        return []
    starts = np.flatnonzero(runs & ~np.roll(runs, 1))
    ends = np.flatnonzero(runs & ~np.roll(runs, -1))
    ends = np.roll(ends, -int(np.searchsorted(ends, starts[0])))
    return [(start + np.arange((end - start) % n + 1)) % n for start, end in zip(starts, ends)]


def bend_into_rings(band: FractureBand) -> Floats | None:
    """(n, HEIGHTS, 3) by how much rungs leave the straight ones to go through the throats of foot rings; None where
    the closed band runs over none.
    """
    outer, inner = (ends[:-1] for ends in band.ends())
    nearest = inner[cKDTree(inner).query(outer)[1]]
    along = _along_loop(outer, nearest - outer)
    bend = np.zeros((len(outer), len(HEIGHTS), 3))
    for rows in ring_runs(outer, nearest - outer):
        half = 1 + len(rows) // 2
        if along[rows[:half]].min() < -ALONG and along[rows[-half:]].max() > ALONG:  # both sides of the ring
            bend[rows] = _through_throat(outer[rows], inner[rows])
    return np.concatenate([bend, bend[:1]]) if bend.any() else None


def _through_throat(outer: Floats, inner: Floats) -> Floats:
    """(k, HEIGHTS, 3) by how much ways from a run (k, 3) to its partners, past the throat, leave the straight ones.

    Cubic Bezier curves, which stay within station, throat and partner; the less a station lies below the throat, the
    straighter.
    """
    steps = np.linalg.norm(np.diff(outer, axis=0), axis=1)
    share = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    end = np.minimum(share, 1.0 - share)
    share = share + np.sign(0.5 - share) * OFF_SIDE * (1.0 - np.exp(-end / SOON)) * (1.0 - 2.0 * end)
    throat = outer[0] + share[:, None] * (outer[-1] - outer[0])
    below, above = np.linalg.norm(throat - outer, axis=1), np.linalg.norm(inner - throat, axis=1)
    pull = np.minimum(PULLED * below / np.maximum(below + above, 1e-300), MOST_PULLED)[:, None]
    off = [throat - outer - (inner - outer) * third for third in (1.0 / 3.0, 2.0 / 3.0)]
    return np.stack([3.0 * h * (1.0 - h) * pull * ((1.0 - h) * off[0] + h * off[1]) for h in HEIGHTS], axis=1)


def _along_loop(points: Floats, chord: Floats) -> Floats:
    """(n,) cosine between chords and the loop: 1 where the loop goes towards the inner wall, -1 where away from it."""
    ahead = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    width = LEVELLED * _median_length(chord) / _step(points)
    ahead = gaussian_filter1d(ahead, width, axis=0, mode="wrap")
    return np.asarray(np.einsum("ij,ij->i", unit_vectors(chord), unit_vectors(ahead)))


def _count(points: Floats, length: float) -> int:
    return max(1, round(length / _step(points)))


def _step(points: Floats) -> float:
    return float(np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).mean())


def _median_length(rows: Floats) -> float:
    return float(np.median(np.linalg.norm(rows, axis=1)))
