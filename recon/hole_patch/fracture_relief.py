"""How far the neighbours' fracture stands off the rungs between the two edges of the hole.

       outer edge  A ----.                     each rung from A to B is sampled at a few heights; from there the
                   |  d   )  fracture          fracture is sought along d, which runs along the walls and so stays
                   | --->(   of a neighbour    between them
       inner edge  B ----'

What was not measured (a gap between sherds, a chip, a face hidden from the scanner) leaves the rung as it is, and the
relief fades into it. Where it was measured, relief is averaged along the edge, but stays behind the nearest of what was
found beside it: a neighbour's tooth keeps its room.
"""

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import TriangleMesh
from recon.numerics.distance import TriangleTree

__all__ = ["fracture_relief"]

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

ROUNDS = 3  # of going to the nearest point of the fracture and back onto d
FARTHEST = 0.5  # of the wall's thickness: what lies farther off is another face
ASIDE = 0.12  # of the thickness: how far the point found may lie beside d
SMOOTHED = 0.5  # mm along the edge: vertices of a scan lie about as far apart
BESIDE = 0.25  # mm along the edge, within which relief stays behind all that was found
DOUBT = 0.15  # weight of the rung as it is beside that of measured points


def fracture_relief(
    rungs: Floats,
    away: Floats,
    fracture: TriangleMesh,
    *,
    thickness: Floats,
    clearance: float = 0.0,
    closed: bool = True,
) -> Floats:
    """(n, HEIGHTS, 3) by how much the fracture leaves the rungs at each height.

    rungs      (n, HEIGHTS, 3) points of the rungs, in their order round the piece, counter-clockwise seen from outside
               the vessel; already drawn in by the clearance
    away       (n, HEIGHTS, 3) unit vectors along the walls, away from the piece
    fracture   faces of the neighbours that look into the hole
    thickness  (n,) of the wall at each rung
    clearance  in millimetres, that the piece keeps from the fracture
    closed     whether the first rung follows on the last
    """
    tree = TriangleTree(fracture.vertices, fracture.face_vertices)
    apart = _distances_along(rungs[:, rungs.shape[1] // 2], closed)
    relief = np.zeros_like(rungs)
    for k in range(rungs.shape[1]):
        off, found = _sought(tree, rungs[:, k], away[:, k], thickness, clearance)
        relief[:, k] = _kept_behind(off, found, apart)[:, None] * away[:, k]
    return relief


def _sought(
    tree: TriangleTree, start: Floats, away: Floats, thickness: Floats, clearance: float
) -> tuple[Floats, Flags]:
    """(n,) signed distance along `away` to the fracture, less the clearance, and whether it was found there."""
    off = np.full(len(start), clearance)
    for _ in range(ROUNDS):
        place = start + off[:, None] * away
        step = tree.closest(place).points - place
        off = off + np.einsum("ij,ij->i", step, away)
    beside = tree.closest(start + off[:, None] * away).distances
    found = (beside < ASIDE * thickness) & (np.abs(off - clearance) < FARTHEST * thickness)
    return off - clearance, found


def _distances_along(points: Floats, closed: bool) -> Floats:
    """(n, n) distances between the rungs along their row of points."""
    steps = np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1)
    place = np.concatenate([[0.0], np.cumsum(steps)])
    apart = np.abs(place[:-1, None] - place[None, :-1])
    return np.minimum(apart, place[-1] - apart) if closed else apart


def _kept_behind(off: Floats, found: Flags, apart: Floats) -> Floats:
    """(n,) what was found, smoothed, but no more than the least that was found beside it; steps rounded off again."""
    least = np.where((apart <= BESIDE) & found, off, np.inf).min(axis=1)
    behind = np.minimum(_smoothed(off, found, np.exp(-0.5 * (apart / SMOOTHED) ** 2)), least)
    near = np.exp(-0.5 * (apart / BESIDE) ** 2)
    return np.asarray(near @ behind / near.sum(axis=1))


def _smoothed(off: Floats, found: Flags, near: Floats) -> Floats:
    """Weighted means over the found neighbours; single points far from the others count little.

    near  (n, n) weights of the other rungs for each
    """
    weight, doubt = found.astype(np.float64), DOUBT * near.sum(axis=1)
    for _ in range(2):
        mean = near @ (weight * off) / (near @ weight + doubt)
        spread = 1.4826 * np.median(np.abs(off - mean)[found]) if found.any() else 1.0
        weight = found / (1.0 + ((off - mean) / max(3.0 * spread, 1e-6)) ** 2) ** 2
    return np.asarray(near @ (weight * off) / (near @ weight + doubt))
