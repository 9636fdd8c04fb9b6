"""Where the sherds of a broken vessel touch, and how far they are from touching as they once did.

Two surfaces that broke from one another look into each other's face; two walls that a crack parted go on in one
another. Either way a place of one sherd has a partner on the other, and the distance between them along their common
normal ought to be zero:

     wall a   |   wall b            mating        n_a = -n_b   fracture against fracture
    ---o------|------o---           continuation  n_a =  n_b   wall beside wall, across the crack
        n_a ->|<- n_b               border        as mating; n is the direction in which an open wall ends
              |

p, n   point and unit normal of a sample             reach   length: nothing farther apart can be partners
d      distance along the common normal n_b ∓ n_a, symmetric so that a bent wall may cross a crack [rusinkiewicz2019]
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.hole_patch.assembly import Assembly
from recon.numerics.distance import sample_surface

__all__ = [
    "BORDER",
    "CONTINUATION",
    "KINDS",
    "MATING",
    "Pairs",
    "PartnerTree",
    "Samples",
    "contact_samples",
    "touching",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

MATING, CONTINUATION, BORDER = range(3)
KINDS = 3
COARSE = 40_000  # samples over all sherds, to find which of them touch where
FINE = (8_000, 40_000)  # samples where they touch: at least, at most
ALIKE = 0.75  # cosine between normals that are called equal, or opposite


@dataclass(frozen=True, eq=False)
class Samples:
    """Places on one sherd near others, in the sherd's own pose.

    points, normals  (n, 3); of a border the normal lies in the wall and points away from it
    border           (n,) whether the place is on the border of an open wall
    """

    points: Floats
    normals: Floats
    border: Flags


@dataclass(frozen=True, eq=False)
class Pairs:
    """Partners found for the samples of one sherd on another.

    sample     (m,) number of the sample on the first sherd
    points     (m, 3) of the first sherd; others (m, 3) their partners; normals (m, 3) common, unit
    kind       (m,) MATING, CONTINUATION or BORDER
    """

    sample: Ints
    points: Floats
    others: Floats
    normals: Floats
    kind: Ints

    @property
    def distances(self) -> Floats:
        """(m,) along the common normal, positive where the first sherd lies on the side that the normal points to."""
        return np.einsum("ij,ij->i", self.points - self.others, self.normals)

    def only(self, rows: Flags) -> "Pairs":
        """The pairs of which `rows` (m,) is true."""
        return Pairs(self.sample[rows], self.points[rows], self.others[rows], self.normals[rows], self.kind[rows])

    def moved(self, matrix: Floats) -> "Pairs":
        """The pairs under a (4, 4) rigid motion."""
        turn, shift = matrix[:3, :3].T, matrix[:3, 3]
        return Pairs(
            self.sample, self.points @ turn + shift, self.others @ turn + shift, self.normals @ turn, self.kind
        )


def contact_samples(table: Assembly, normals: Floats, *, n_sherds: int, reach: float) -> tuple[list[Samples], float]:
    """Samples of every sherd within reach of others, spread evenly, and their spacing.

    table     of all sherds, with steady face normals (F, 3)
    n_sherds  of them, those without any face included
    """
    parts = [np.flatnonzero(table.face_sherd == sherd) for sherd in range(n_sherds)]
    near = _faces_near_others(table, parts, reach)
    area = float(table.areas[near].sum())
    count = int(np.clip(area / (0.5 * table.spacing) ** 2, *FINE))
    spacing = float(np.sqrt(area / count)) if area > 0.0 else table.spacing
    samples = [
        _joined(_on_faces(table, normals, faces[near[faces]], spacing), _on_border(table, normals, sherd, spacing))
        for sherd, faces in enumerate(parts)
    ]
    return _close_ones(samples, reach + 2.0 * spacing), spacing


def touching(samples: Sequence[Samples], reach: float) -> list[tuple[int, int]]:
    """Ordered pairs of sherds whose samples' boxes come within reach of each other."""
    n = len(samples)
    low, high = np.full((n, 3), np.inf), np.full((n, 3), -np.inf)
    for i, part in enumerate(samples):
        low[i], high[i] = part.points.min(axis=0, initial=np.inf), part.points.max(axis=0, initial=-np.inf)
    apart = np.asarray((low[:, None] > high[None] + reach).any(axis=2))
    return [(a, b) for a in range(n) for b in range(n) if a != b and not (apart[a, b] or apart[b, a])]


def _faces_near_others(table: Assembly, parts: Sequence[Ints], reach: float) -> Flags:
    """(F,) faces of which some part may lie within reach of another sherd; `parts` are the faces of every sherd."""
    step = float(np.sqrt(table.areas.sum() / COARSE))
    radius = np.linalg.norm(table.vertices[table.faces] - table.centres[:, None], axis=2).max(axis=1)
    limit = reach + 1.5 * step + radius
    near = np.zeros(table.n_faces, dtype=bool)
    for sherd, faces in enumerate(parts):
        if len(faces):
            points, _ = _spread(table, faces, step)
            outside = np.maximum(points.min(axis=0) - table.centres, table.centres - points.max(axis=0))
            asked = np.flatnonzero(~near & (table.face_sherd != sherd) & (outside.max(axis=1) < limit))
            bound = float(limit[asked].max(initial=0.0))
            distance, _ = cKDTree(points).query(table.centres[asked], distance_upper_bound=bound)
            near[asked] |= distance < limit[asked]
    return near


def _spread(table: Assembly, faces: Ints, step: float) -> tuple[Floats, Ints]:
    """Points spread evenly over the faces, one for each square of the step, and the face of each."""
    count = max(int(table.areas[faces].sum() / step**2), 1)
    points = sample_surface(table.vertices, table.faces[faces], count)
    # the samples come in the order of the faces, each from the middle of its own equal share of the area
    total = np.cumsum(table.areas[faces])
    at = np.searchsorted(total, (np.arange(count) + 0.5) / count * total[-1], side="right")
    return points, faces[np.minimum(at, len(faces) - 1)]


def _on_faces(table: Assembly, normals: Floats, faces: Ints, spacing: float) -> Samples:
    if not len(faces):
        return Samples(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=bool))
    points, face = _spread(table, faces, spacing)
    return Samples(points, normals[face], np.zeros(len(points), dtype=bool))


def _on_border(table: Assembly, normals: Floats, sherd: int, spacing: float) -> Samples:
    """Samples along the border edges, with the direction in which the wall ends there."""
    mine = table.face_sherd[table.border_faces] == sherd
    begin, end = table.vertices[table.border_edges[mine]].transpose(1, 0, 2)
    length = np.linalg.norm(end - begin, axis=1)
    count = np.floor(np.cumsum(length) / spacing).astype(np.int64)
    count = np.diff(count, prepend=0)
    edge = np.repeat(np.arange(len(count)), count)
    t = (np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[edge]
    away = np.cross(end - begin, normals[table.border_faces[mine]])
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-300)
    points = begin[edge] + t[:, None] * (end - begin)[edge]
    return Samples(points, away[edge], np.ones(len(edge), dtype=bool))


def _joined(faces: Samples, border: Samples) -> Samples:
    return Samples(
        np.concatenate([faces.points, border.points]),
        np.concatenate([faces.normals, border.normals]),
        np.concatenate([faces.border, border.border]),
    )


def _close_ones(samples: list[Samples], limit: float) -> list[Samples]:
    """Only the samples that lie within the limit of a sample of another sherd."""
    trees = [cKDTree(part.points) for part in samples]
    close = [np.zeros(len(part.points), dtype=bool) for part in samples]
    for a, b in touching(samples, limit):
        close[a] |= np.isfinite(trees[b].query(samples[a].points, distance_upper_bound=limit)[0])
    return [Samples(part.points[c], part.normals[c], part.border[c]) for part, c in zip(samples, close)]


class PartnerTree:
    """Samples of one sherd, ready to be asked for partners.

    Nearness counts place and direction together, a turned normal as much as the reach for each radian; so a place on a
    fracture finds the fracture against it, not the wall beside that.
    """

    def __init__(self, samples: Samples, reach: float) -> None:
        self._samples, self._reach = samples, reach
        self._faces, self._borders = np.flatnonzero(~samples.border), np.flatnonzero(samples.border)
        self._face_tree = self._tree(self._faces)
        self._border_tree = self._tree(self._borders)

    def _tree(self, rows: Ints) -> cKDTree | None:
        if not len(rows):
            return None
        return cKDTree(np.concatenate([self._samples.points[rows], self._reach * self._samples.normals[rows]], axis=1))

    def partners(self, asking: Samples) -> Pairs:
        """Partners of the samples of another sherd, which are given in this sherd's own pose."""
        face, border = np.flatnonzero(~asking.border), np.flatnonzero(asking.border)
        return _stacked(
            [
                self._nearest(self._face_tree, self._faces, asking, face, MATING),
                self._nearest(self._face_tree, self._faces, asking, face, CONTINUATION),
                self._nearest(self._border_tree, self._borders, asking, border, BORDER),
            ]
        )

    def _nearest(self, tree: cKDTree | None, rows: Ints, asking: Samples, asked: Ints, kind: int) -> Pairs:
        if tree is None or not len(asked):
            nowhere = np.zeros((0, 3))
            return Pairs(asked[:0], nowhere, nowhere, nowhere, asked[:0])
        sign = 1.0 if kind == CONTINUATION else -1.0
        key = np.concatenate([asking.points[asked], sign * self._reach * asking.normals[asked]], axis=1)
        limit = self._reach * float(np.sqrt(1.0 + 2.0 * (1.0 - ALIKE)))
        distance, at = tree.query(key, distance_upper_bound=limit)
        asked, other = asked[np.isfinite(distance)], rows[at[np.isfinite(distance)]]
        p, q, turned = asking.points[asked], self._samples.points[other], self._samples.normals[other]
        common = turned + sign * asking.normals[asked]
        near = (np.linalg.norm(p - q, axis=1) < self._reach) & ((turned * common).sum(axis=1) > 1.0 + ALIKE)
        common = common[near] / np.linalg.norm(common[near], axis=1, keepdims=True)
        return Pairs(asked[near], p[near], q[near], common, np.full(int(near.sum()), kind))


def _stacked(parts: Sequence[Pairs]) -> Pairs:
    return Pairs(
        np.concatenate([part.sample for part in parts]),
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.others for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.kind for part in parts]),
    )
