"""Steps that do not fold the surface, and folds taken out of a control mesh.

The tangent distance lets control points slide, and where the scan is sharp they slide over one another:

    1. a step that would fold the surface is halved around the fold; then a careful one is tried, and at last none
    2. the control points around are stiffer from then on (`pipeline`), so the next step is another one
    3. folds that are there already, after a refinement say, are drawn smooth bit by bit
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from recon.geometric_fit.guards import Guards, neighbour_means
from recon.geometry.control_mesh import ControlMesh

__all__ = ["Step", "smoothed_out", "stepped", "unfolded"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

HALVINGS = 3  # of a step that folds the surface
HELD = 0.2  # of its way: what goes less is held by folds
UNFOLDINGS, UNFOLDING = 24, 0.25  # steps that take folds out, and how far toward the mean each goes
WIDENINGS = 2  # times that as many steps follow which move the neighbours, too, where folds are left


class Step(NamedTuple):
    """Control points after a step, and (V,) which of them the whole step would have folded, which are folded, and
    which were held: they went less than HELD of their way."""

    points: Floats
    folding: Bools
    folded: Bools
    held: Bools


class FoldGuards(Protocol):
    """What tells which control points (V,) are around folds, and widens such a set by their neighbours."""

    def folded(self, control_points: Floats) -> Bools: ...
    def widened(self, control_points: Bools) -> Bools: ...


def stepped(guards: FoldGuards, old: Floats, new: Floats, careful: Floats | None = None) -> Step:
    """The step, shortened where it would fold the surface.

    Where halving does not help, a careful move (V, 3) is tried, if there is one, and half of it; then the step is taken
    back with that of all neighbours: what did not fold before does not fold after. What folded before may go on to
    move.
    """
    folding = folded = guards.folded(new)
    if not folded.any():
        return Step(new, folding, folded, folded)
    before, move = guards.folded(old), new - old
    for number in range(2 * HALVINGS + 1):
        wide = guards.widened(folded & ~before)
        if not wide.any():
            break
        move[wide] = _shorter(number, move[wide], None if careful is None else careful[wide])
        folded = guards.folded(old + move)
    held = np.linalg.norm(move, axis=1) < HELD * np.linalg.norm(new - old, axis=1)
    return Step(old + move, folding, folded, held)


def _shorter(number: int, move: Floats, careful: Floats | None) -> Floats:
    """What is tried after so many attempts in vain."""
    if number < HALVINGS:
        return 0.5 * move
    if careful is None or number > HALVINGS + 1:
        return np.zeros_like(move)
    return careful if number == HALVINGS else 0.5 * careful


def unfolded(mesh: ControlMesh, guards: Guards) -> tuple[ControlMesh, int]:
    """The mesh with control points of faces that fold drawn toward their neighbours' mean; how many still fold.

    Where no way leads out of all folds, the state with the fewest is kept.
    """
    held = np.zeros(mesh.n_vertices, dtype=np.bool_)
    held[mesh.crease_edges] = True
    points, fewest = smoothed_out(mesh.vertices, guards, neighbour_means(mesh), held)
    return mesh.with_vertices(points), fewest


def smoothed_out(
    points: Floats, guards: FoldGuards, means: sparse.csr_array, held: Bools | None = None
) -> tuple[Floats, int]:
    """The same of control points (V, 3) with the matrix of their neighbours' means.

    held  (V,) points that move only where they are folded themselves
    """
    folded = guards.folded(points)
    best, fewest = points, int(folded.sum())
    for number in range(UNFOLDINGS * (1 + WIDENINGS)):
        if not folded.any():
            break
        moving = folded
        for _ in range(number // UNFOLDINGS):
            moving = guards.widened(moving)
        if held is not None:
            moving = moving & (folded | ~held)
        points = np.where(moving[:, None], points + UNFOLDING * (means @ points - points), points)
        folded = guards.folded(points)
        if folded.sum() < fewest:
            best, fewest = points, int(folded.sum())
    return best, fewest
