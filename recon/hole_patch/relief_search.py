"""Where else on the vessel the relief runs as it does around the hole, and what it says about the inside of the hole.

The ring around the hole is laid on the rest of the wall, turned about the axis, moved along the profile, mirrored.
Each place where it fits is a candidate: what the wall shows there within the ring's outline is a guess for the hole.

      . . . . .             ring, in sectors:  which way of      1 1 2 2        correlation of the ring with the wall
     . ,-----. .            combining candidates foretells      6 ,---. 3       under all shifts at once: products of
     . | ??? | .            a sector best that was left out     6 '---' 3       Fourier transforms
     . '-----' .                                                 5 5 4 4
      . . . . .

    t        heights on the ring, h those on the wall, m where they are known
    score    Σ t h / sqrt(Σ t² m Σ h² m_t), the normalised correlation where both are known
    A, B     heights of every candidate on the ring and in the hole, a row each
    x        weights of the candidates: minimise Σ_ring w (x A - t)² + λ |x|²; the hole gets x B
    w        one weight for all cells, or near cells first, for each row or each patch of the hole by itself; cells that
             all the others contradict lose theirs: where a band of cords was begun and ended its phase jumps, and the
             mean of both phases is no cord

A band that was rolled on the turning vessel repeats at its own height alone: for it candidates are turned, no more.

Paper  [padfield2012], masked correlation by Fourier transforms; [roweis2000], weights that rebuild a neighbourhood;
       [buades2005], means over like surroundings; [geman1987] for the weights of contradicted cells.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from recon.hole_patch.relief_map import ReliefMap

__all__ = ["RECIPES", "Candidates", "Foretelling", "Recipe", "ReliefSearch", "foretell", "predicted"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

MIRRORS = tuple(product((1, -1), repeat=2))
RING_KNOWN, HOLE_KNOWN = 0.6, 0.7  # least share of ring and hole that a candidate must know
LESSONS = 1500  # cells of the ring that weights are learned from
EXAMINED = 800  # cells of a sector that was left out
BORNE = 1.5  # mm along the profile, standard deviation: narrower than cords are wide, wider than single cells
ROUNDS = 6  # of fitting weights and leaving contradicted cells out
CALM = 0.1  # of the liveliest row's height, below which no row's relief is taken to be when its misses are judged
ALOOF = 1e-3  # what a far cell counts beside a near one: it steadies patches that see little of the ring


@dataclass(frozen=True)
class Recipe:
    """A way of combining candidates.

    regular  whether the hole is filled from whole candidates, not row by row or patch by patch
    count    number of candidates
    apart    least distance in cells between two of them
    ridge    λ as a share of the candidates' summed power, or None for the mean, weighted by score⁴
    reach    millimetres in u and s around every patch from which its weights are learned
    turned   whether candidates may only be turned about the axis, neither moved along the profile nor mirrored
    """

    regular: bool
    count: int
    apart: int
    ridge: float | None = None
    reach: tuple[float, float] = (np.inf, np.inf)
    turned: bool = False

    @property
    def places(self) -> tuple[int, int, bool]:
        """What decides which candidates it takes."""
        return self.count, self.apart, self.turned


RECIPES = (
    Recipe(True, 60, 0),
    *(Recipe(True, 100, 2, ridge) for ridge in (1e-3, 1e-2)),
    *(Recipe(False, 100, 2, ridge, (np.inf, 4.0)) for ridge in (1e-3, 1e-2)),
    Recipe(False, 100, 2, 1e-3, (4.0, 4.0)),
    Recipe(False, 200, 0, 1e-2, (8.0, 4.0), turned=True),
)


class Candidates(NamedTuple):
    """Places on the wall: (k,) scores, best first, (k, 2) mirrors of ±1, (k, 2) shifts in its cells, mirrored."""

    score: Floats
    mirror: Ints
    shift: Ints


class ReliefSearch:
    """The wall's heights and the ring, transformed once for all questions.

    around   heights of the wall and where they are known
    hole     (nu, ns) cells to be foretold
    sectors  (nu, ns) number of the sector of the ring that each cell belongs to, -1 outside the ring
    """

    def __init__(self, around: ReliefMap, *, hole: Bools, sectors: Ints) -> None:
        self.known, self.hole, self.sectors, self.cell = around.known & ~hole, hole, sectors, around.cell
        self.height = around.height * self.known
        nu, ns = hole.shape
        self._size = (nu, fft.next_fast_len(2 * ns, real=True))
        parts = [self.known & (sectors == k) for k in range(self.n_sectors)]
        masks = [[self._forward(self.height**p * part).conj() for p in range(3)] for part in parts]
        under = self._forward(hole).conj()
        sums, places = [], []
        for mirror, (a, b) in enumerate(MIRRORS):
            wall = [self._forward((self.height**p * self.known)[::a, ::b]) for p in range(3)]
            shifts = np.argwhere(self._back(wall[0] * under) >= HOLE_KNOWN * hole.sum())
            at = tuple(shifts.T)
            sums.append([[self._back(wall[i] * m[j])[at] for i, j in ((1, 1), (0, 2), (2, 0), (0, 0))] for m in masks])
            places.append(np.insert(shifts, 0, mirror, axis=1))
        # (sectors, 4, k): sums of t h, t² m, h² m_t and m m_t where the hole is known; (k, 3): mirror and shift of each
        self._sums, self._places = np.concatenate(sums, axis=2), np.concatenate(places)

    @property
    def n_sectors(self) -> int:
        return int(self.sectors.max()) + 1

    def ring(self, taught: Sequence[int]) -> Ints:
        """(m, 2) known cells of the given sectors."""
        return np.argwhere(np.isin(self.sectors, taught) & self.known)

    def at(self, cells: Ints) -> Floats:
        """(m,) heights at cells (m, 2)."""
        return np.asarray(self.height[tuple(cells.T)])

    @property
    def liveliness(self) -> Floats:
        """(ns,) root mean square of the known heights of every row along the profile."""
        return np.asarray(np.sqrt((self.height**2).sum(axis=0) / np.maximum(self.known.sum(axis=0), 1)))

    def candidates(self, taught: Sequence[int], *, count: int, apart: int, turned: bool = False) -> Candidates:
        """At most `count` places that fit the given sectors of the ring best, `apart` or more cells from each other;
        on request only those that are turned about the axis, also where the wall there runs the other way.
        """
        both, ring, wall, cells = self._sums[list(taught)].sum(axis=0)
        score = both / np.sqrt(np.maximum(ring * wall, 1e-9))
        score[cells < RING_KNOWN * len(self.ring(taught))] = -1.0
        if turned:
            score[(self._places[:, 0] > 0) | (self._places[:, 2] != 0)] = -1.0
        fit = np.flatnonzero((score > (-1.0 if turned else 0.0)) & self._are_peaks(score, apart))
        best = fit[np.argsort(-score[fit], kind="stable")[:count]]
        mirror, shift = self._places[best, 0], self._places[best, 1:].copy()
        shift[:, 1] -= np.where(shift[:, 1] > self._size[1] // 2, self._size[1], 0)
        return Candidates(score[best], np.array(MIRRORS)[mirror], shift)

    def _are_peaks(self, score: Floats, apart: int) -> Bools:
        at = tuple(self._places.T)
        grid = np.full((len(MIRRORS), *self._size), -1.0, dtype=np.float32)
        grid[at] = score
        width = 2 * apart + 1
        return np.asarray(grid[at] >= ndimage.maximum_filter(grid, size=(1, width, width), mode="wrap")[at])

    def heights(self, places: Candidates, cells: Ints) -> tuple[Floats, Bools]:
        """(k, m) heights of every candidate at cells (m, 2), 0 where not known, and where they are."""
        nu, ns = self.height.shape
        height, known = np.empty((len(places.score), len(cells))), np.empty((len(places.score), len(cells)), dtype=bool)
        for k, ((a, b), shift) in enumerate(zip(places.mirror, places.shift)):
            i, j = (cells + shift).T
            on = (j >= 0) & (j < ns)
            i, j = i % nu, np.clip(j, 0, ns - 1)
            known[k] = self.known[::a, ::b][i, j] & on
            height[k] = self.height[::a, ::b][i, j] * known[k]
        return height, known

    def _forward(self, picture: Floats | Bools) -> NDArray[np.complex64]:
        return np.asarray(fft.rfft2(picture.astype(np.float32), self._size))

    def _back(self, spectrum: NDArray[np.complex64]) -> NDArray[np.float32]:
        return np.asarray(fft.irfft2(spectrum, self._size))


def predicted(search: ReliefSearch, recipes: Sequence[Recipe], taught: Sequence[int], cells: Ints) -> Floats:
    """(recipes, m) heights at cells (m, 2) by recipes that see the given sectors of the ring; 0 without candidates."""
    heights = np.zeros((len(recipes), len(cells)))
    ring = _thinned(search.ring(taught), LESSONS)
    for count, apart, turned in {recipe.places for recipe in recipes}:
        places = search.candidates(taught, count=count, apart=apart, turned=turned)
        if not len(places.score):
            continue
        there, known = search.heights(places, cells)
        lively = search.liveliness
        usual = np.maximum(lively, CALM * lively.max())[ring[:, 1]]
        examples = search.heights(places, ring)[0].astype(np.float32)
        lesson = _Lesson(examples, search.at(ring), ring * search.cell, usual)
        for k, recipe in enumerate(recipes):
            if recipe.places != (count, apart, turned):
                continue
            if recipe.ridge is None:
                weight = places.score[:, None] ** 4
                heights[k] = (weight * there).sum(axis=0) / np.maximum((weight * known).sum(axis=0), 1e-9)
            else:
                heights[k] = lesson.predicted(there, cells * search.cell, recipe)
    return heights


class Foretelling(NamedTuple):
    """How well a recipe foretells sectors of the ring that were left out.

    explained  share of their variance
    trust      (ns,) share of the foretold height, for every row along the profile, that left-out wall bears out: where
               the relief ends, towards a lip, what is foretold fades out with it
    """

    recipe: Recipe
    explained: float
    trust: Floats


def foretell(search: ReliefSearch) -> Foretelling:
    """The recipe that foretells left-out sectors of the ring best.

    Paper   [wahba1990], cross-validation.
    """
    missed, power = np.zeros(len(RECIPES)), 0.0
    rows, guesses, truths = [], [], []
    for k in range(search.n_sectors):
        taught = [j for j in range(search.n_sectors) if j != k]
        cells = _thinned(search.ring([k]), EXAMINED)
        true, guess = search.at(cells), predicted(search, RECIPES, taught, cells)
        power += float((true**2).sum())
        missed += ((guess - true) ** 2).sum(axis=1)
        rows.append(cells[:, 1])
        guesses.append(guess)
        truths.append(true)
    best = int(np.argmin(missed))
    guess = np.concatenate(guesses, axis=1)[best]
    trust = _borne_out(np.concatenate(rows), guess, np.concatenate(truths), search)
    explained = 1.0 - float(missed[best]) / max(power, 1e-12)
    return Foretelling(RECIPES[best], explained, trust)


def _borne_out(rows: Ints, guess: Floats, true: Floats, search: ReliefSearch) -> Floats:
    """(ns,) slope of true over guessed heights, 0 to 1, over cells within `BORNE` of every row."""
    lively = search.liveliness
    usual = np.maximum(lively, CALM * lively.max())[rows]
    heed = np.ones(len(rows))
    for _ in range(ROUNDS):
        slope = _slopes(rows, guess, true, heed, search)
        heed = _heeded((slope[rows] * guess - true) / usual)
    return _slopes(rows, guess, true, heed, search)


def _slopes(rows: Ints, guess: Floats, true: Floats, heed: Floats, search: ReliefSearch) -> Floats:
    width = BORNE / float(search.cell[1])
    both, power = (
        ndimage.gaussian_filter1d(np.bincount(rows, heed * x, search.hole.shape[1]), width, mode="constant")
        for x in (guess * true, guess**2)
    )
    whole = float((heed * guess * true).sum()) / max(float((heed * guess**2).sum()), 1e-12)
    # rows that no cell of the ring lies in are trusted as the whole is
    little = 1e-3 * power.max()
    return np.asarray(np.clip((both + little * whole) / (power + little + 1e-15), 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class _Lesson:
    """What weights are learned from: (k, m) heights of candidates on the ring, (m,) true ones, (m, 2) places in mm,
    (m,) usual height of the relief in their rows.

    Single precision halves the time of the sums over the ring; the ridge is ten thousand times its rounding.
    """

    examples: NDArray[np.float32]
    truth: Floats
    place: Floats
    usual: Floats

    def predicted(self, there: Floats, place: Floats, recipe: Recipe) -> Floats:
        """(n,) heights at places (n, 2), where the candidates show `there` (k, n)."""
        reach = np.array(recipe.reach)
        near, far = self.place / reach, place / reach
        middles = _patch_middles(far)
        trust = np.ones(len(near))
        for _ in range(ROUNDS if recipe.turned else 0):
            weights = np.stack([self._weights(near, trust, middle, recipe) for middle in middles])
            trust = _heeded((_blended(weights, self.examples, near, middles) - self.truth) / self.usual)
        weights = np.stack([self._weights(near, trust, middle, recipe) for middle in middles])
        return _blended(weights, there, far, middles)

    def _weights(self, near: Floats, trust: Floats, middle: Floats, recipe: Recipe) -> Floats:
        assert recipe.ridge is not None  # a mean has no lesson
        away = ((near - middle) ** 2).sum(axis=1)
        heed = (np.exp(-0.5 * (away - away.min())) + ALOOF) * trust
        weighted = self.examples * heed.astype(np.float32)
        gram = np.asarray(weighted @ self.examples.T, dtype=np.float64)
        ridge = recipe.ridge * np.trace(gram) + 1e-12
        return np.asarray(cho_solve(cho_factor(gram + ridge * np.eye(len(gram))), weighted @ self.truth))


def _patch_middles(place: Floats) -> Floats:
    """(p, 2) mean places of the patches, 1.5 reaches wide, that places (n, 2) in reaches fall into."""
    _, patch = np.unique(np.floor(place / 1.5), axis=0, return_inverse=True)
    return np.stack([np.bincount(patch.ravel(), x) / np.bincount(patch.ravel()) for x in place.T], axis=1)


def _blended(weights: Floats, heights: Floats | NDArray[np.float32], place: Floats, middles: Floats) -> Floats:
    """(n,) sums of heights (k, n) at places (n, 2), by weights (p, k) of the patches around."""
    away = cdist(place, middles, "sqeuclidean")
    share = np.exp(-0.5 * (away - away.min(axis=1, keepdims=True)))
    share /= share.sum(axis=1, keepdims=True)
    return np.asarray(np.einsum("nk,kn->n", share @ weights, heights))


def _heeded(missed: Floats) -> Floats:
    """(m,) weights of cells that were missed by so much: half of the cells keep nearly all of theirs."""
    scale = 1.4826 * float(np.median(np.abs(missed)))
    return np.asarray((1.0 + (missed / max(2.0 * scale, 1e-12)) ** 2) ** -2)


def _thinned(cells: Ints, most: int) -> Ints:
    """Every so many-th cell; an odd stride, lest it follow the map's columns."""
    return cells[:: max(1, 2 * (len(cells) // (2 * most)) + 1)]
