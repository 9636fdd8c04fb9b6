"""A pattern that does not come back is drawn after the wall's own: alike, but not what was lost.

Where no place on the vessel foretells the relief of the hole (`recon.hole_patch.relief_search`), a piece that is meant
to be looked at may still carry the vessel's texture. It is put together from patches of the wall: each is the place of
the wall that fits best what lies under it already, from the edge of the hole inwards, then all of them again, so that
each agrees with its neighbours; first on a coarse map, then on finer ones.

    wall  . . . . . . . . .        P   patch, its middle in the hole; where it reaches over the edge the wall is
         . .[ P  ].  ___ .             as measured
        . . [   [ P'|   ]. .       Z   all patches of the wall that are wholly known
         . . \\__[___|___].        minimise  Σ_P min over Z of w |P - Z|²,  by turns for the Z and for the cells
          . . . . . . . .

    w   bell over the patch; cells that are not yet drawn weigh nothing

Paper  [kwatra2005], texture optimization; [wexler2007], completion from coarse to fine.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from recon.hole_patch.relief_map import ReliefMap

__all__ = ["drawn_relief"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

HALF_WIDTH = 7  # cells of a patch on either side of its middle, at every scale
SCALES = 3  # each half as fine as the next
STRIDE = 3  # cells between the middles of patches in the hole
MOST_EXAMPLES = 6000  # patches of the wall
BLENDED = 3.0  # cells over which the drawing gives way to the wall along the edge
ROUNDS = 6  # of choosing patches and drawing anew, at every scale
WIDE, SHARP = 0.6, 0.25  # half widths: of the bell that compares patches, and of that by which they are drawn; means of
# many patches are level
ALIKE = 0.05  # of the relief's power: what examples may miss more than the best
AGREED = 0.75  # share of the patches whose misses set the scale by which the others' votes fade


def drawn_relief(around: ReliefMap, hole: Bools, *, seed: int = 0) -> Floats:
    """(nu, ns) heights of the wall, with the hole filled by a pattern like that around it; 0 where nothing is known.

    hole  (nu, ns) cells to be drawn
    seed  of the choice between patches that fit as well; the same wall and seed give the same drawing
    Where the wall is nowhere known over a whole patch the hole stays level.
    """
    known, height = around.known & ~hole, np.where(around.known & ~hole, around.height, 0.0)
    if not len(_examples(height, known)):
        return height
    picture: _Drawing | None = None
    for scale in range(SCALES - 1, -1, -1):
        coarse, sure = _coarser(height, known, scale)
        inside = _coarser_mask(hole, scale)
        examples = _examples(coarse, sure)
        if not len(examples):
            continue
        before, picture = picture, _Drawing(coarse, sure & ~inside, inside)
        if before is None:
            picture.from_edge(examples, np.random.default_rng(seed))
        else:
            picture.take(_finer(before.height, coarse.shape))
        for _ in range(ROUNDS):
            picture.draw(examples)
    assert picture is not None  # the finest scale has examples
    return np.where(hole, picture.blended(), height)


@dataclass(eq=False)
class _Drawing:
    """Heights of the wall and what is drawn of the hole so far; rows wrap round, columns do not.

    height  (nu, ns)
    wall    (nu, ns) cells as measured
    hole    (nu, ns) cells to be drawn
    missed  (nu, ns) heights of the wall above those of the patches that reach over it
    """

    height: Floats
    wall: Bools
    hole: Bools
    missed: Floats = field(init=False)

    def __post_init__(self) -> None:
        self.missed = np.zeros_like(self.height)

    def take(self, guess: Floats) -> None:
        """Begin with a guess (nu, ns) in the hole."""
        self.height = np.where(self.hole, guess, self.height)

    def from_edge(self, examples: Floats, chance: np.random.Generator) -> None:
        """Fill the hole patch by patch, those first that know most.

        Of examples that fit as well one is taken by chance: the best alone would be level wall wherever some is.
        """
        level = float((examples**2 @ _bell()).mean())
        filled = self.wall.copy()
        middles = _middles(self.hole)
        while len(middles):
            share = _patches(filled.astype(np.float64), middles).mean(axis=1)
            best = int(share.argmax())
            cells = _cells(middles[best : best + 1], self.hole.shape)[0]
            there = filled[tuple(cells.T)]
            missed = self._missed(examples, self.height[tuple(cells.T)][None], there[None])[0]
            alike = missed <= missed.min() + ALIKE * level * there.mean()
            fitting = int(chance.choice(np.flatnonzero(alike)))
            blank = self.hole[tuple(cells.T)] & ~there
            self.height[tuple(cells[blank].T)] = examples[fitting][blank]
            filled[tuple(cells[blank].T)] = True
            middles = np.delete(middles, best, axis=0)

    def draw(self, examples: Floats) -> None:
        """Choose the best patch of the wall for every place of the hole, and draw the hole as their mean."""
        middles = _middles(self.hole)
        cells = _cells(middles, self.hole.shape)
        at = tuple(cells.reshape(-1, 2).T)
        known = (self.wall | self.hole)[at].reshape(len(middles), -1)
        patches = self.height[at].reshape(len(middles), -1)
        chosen = examples[self._missed(examples, patches, known).argmin(axis=1)]
        missed = ((chosen - patches) ** 2 * known).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
        votes = np.exp(-0.5 * missed / max(float(np.quantile(missed, AGREED)), 1e-12))[:, None] * _bell(SHARP)
        number = np.ravel_multi_index(at, self.hole.shape)
        total = np.bincount(number, (votes * chosen).ravel(), self.hole.size)
        weight = np.bincount(number, votes.ravel(), self.hole.size)
        mean = (total / np.maximum(weight, 1e-12)).reshape(self.hole.shape)
        voted = weight.reshape(self.hole.shape) > 0.0
        self.missed = np.where(self.wall & voted, self.height - mean, 0.0)
        self.height = np.where(self.hole & voted, mean, self.height)

    def blended(self) -> Floats:
        """The heights, where what the patches miss of the wall along the edge fades into the hole."""
        beside = self.wall & ndimage.binary_dilation(self.hole, iterations=2)
        total, share = (
            ndimage.gaussian_filter(x, BLENDED / 2.0, mode=("wrap", "nearest"))
            for x in (np.where(beside, self.missed, 0.0), beside.astype(np.float64))
        )
        fade = np.exp(-((ndimage.distance_transform_edt(self.hole) / BLENDED) ** 2))
        return np.where(self.hole, self.height + fade * total / np.maximum(share, 1e-12), self.height)

    def _missed(self, examples: Floats, patches: Floats, known: Bools) -> Floats:
        """(k, m) by how much m examples miss patches over their known cells (k, n), but for the patches' own power."""
        weight = known * _bell()
        return np.asarray(weight @ (examples**2).T - 2.0 * (weight * patches) @ examples.T)


def _bell(width: float = WIDE) -> Floats:
    """(n,) weights of the cells of a patch."""
    off = np.arange(-HALF_WIDTH, HALF_WIDTH + 1) / (width * HALF_WIDTH)
    return np.exp(-0.5 * (off[:, None] ** 2 + off**2)).ravel()


def _offsets() -> Ints:
    off = np.arange(-HALF_WIDTH, HALF_WIDTH + 1)
    return np.stack(np.meshgrid(off, off, indexing="ij"), axis=-1).reshape(-1, 2)


def _cells(middles: Ints, shape: tuple[int, ...]) -> Ints:
    """(k, n, 2) cells of patches around middles (k, 2); over the last column the last column again."""
    cells = middles[:, None] + _offsets()
    return np.stack([cells[..., 0] % shape[0], np.clip(cells[..., 1], 0, shape[1] - 1)], axis=-1)


def _patches(picture: Floats, middles: Ints) -> Floats:
    """(k, n) values of a picture in patches around middles (k, 2)."""
    cells = _cells(middles, picture.shape)
    return np.asarray(picture[cells[..., 0], cells[..., 1]])


def _middles(hole: Bools) -> Ints:
    """(k, 2) middles of patches, `STRIDE` apart, that together cover the hole."""
    near = ndimage.binary_dilation(hole, iterations=STRIDE)
    cells = np.argwhere(near)
    return cells[(cells % STRIDE == 0).all(axis=1)]


def _examples(height: Floats, known: Bools) -> Floats:
    """(k, n) patches that are wholly known, evenly chosen."""
    width = 2 * HALF_WIDTH + 1
    whole = ndimage.minimum_filter(known.astype(np.uint8), size=width, mode=("wrap", "constant")) > 0
    middles = np.argwhere(whole)
    return _patches(height, middles[:: max(1, -(-len(middles) // MOST_EXAMPLES))])


def _coarser(height: Floats, known: Bools, scale: int) -> tuple[Floats, Bools]:
    """Means of the known cells in blocks of 2^scale, and the blocks of which half is known."""
    size = 2**scale
    total, share = (_blocks(x, size).mean(axis=(1, 3)) for x in (height * known, known.astype(np.float64)))
    return total / np.maximum(share, 1e-12), share >= 0.5


def _coarser_mask(mask: Bools, scale: int) -> Bools:
    return np.asarray(_blocks(mask, 2**scale).any(axis=(1, 3)))


def _blocks(picture: NDArray[np.generic], size: int) -> NDArray[np.generic]:
    """(nu / size, size, ns / size, size), the last row and column repeated where they do not come out even."""
    more = [(0, -n % size) for n in picture.shape]
    padded = np.pad(picture, more, mode="edge")
    return padded.reshape(padded.shape[0] // size, size, padded.shape[1] // size, size)


def _finer(picture: Floats, shape: tuple[int, ...]) -> Floats:
    """A picture of half as many rows and columns, between its cells by straight lines."""
    rows, columns = ((np.arange(n) + 0.5) / 2.0 - 0.5 for n in shape)
    at = np.meshgrid(rows, columns, indexing="ij")
    return np.asarray(ndimage.map_coordinates(picture, at, order=1, mode="nearest"))
