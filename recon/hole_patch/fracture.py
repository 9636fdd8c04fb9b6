"""Which faces are fracture, and which fracture looks into the hole.

A fracture face of one sherd usually lies against that of its neighbour. Where it does, it is fracture for certain;
where a fracture face finds nobody against it, it looks into the hole.

     sherd A  |  sherd B            mated: nearest faces of another sherd within the gap, turned against it,
      --------+--------             and on its outer side (the far wall of a thin neighbour lies on its inner side)
        A  -> | <-  B
      --------+-----.               alone: the right end of B, where the hole begins
                    |  hole
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.hole_patch.assembly import Assembly

__all__ = ["has_far_side", "looks_into_hole", "majority", "mated_faces", "wall_thickness"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

NEIGHBOURS = 6


def wall_thickness(table: Assembly, fracture: Flags | None = None) -> float:
    """Mean thickness of closed sherds: twice the volume over the area of both walls.

    fracture  (F,) faces that are no wall; when not yet known, a fifth of the area is taken off
    """
    a, b, c = (table.vertices[table.faces] - table.centres.mean(axis=0)).transpose(1, 0, 2)
    volume = abs(float(np.einsum("ij,ij->", a, np.cross(b, c)))) / 6.0
    walls = 0.8 * table.areas.sum() if fracture is None else table.areas[~fracture].sum()
    return 2.0 * volume / max(float(walls), 1e-300)


def mated_faces(table: Assembly, normals: Floats, gap: float) -> Flags:
    """(F,) whether a face of another sherd lies against a face within the gap.

    gap  length, along the normal; half as much overlap is allowed, since sherds are placed with errors
    """
    mated = np.zeros(table.n_faces, dtype=bool)
    reach = float(np.hypot(gap, 1.5 * table.spacing))
    for a, b in _touching(table, reach):
        in_a, in_b = np.flatnonzero(table.face_sherd == a), np.flatnonzero(table.face_sherd == b)
        in_a, in_b = _near_box(table, in_a, in_b, reach), _near_box(table, in_b, in_a, reach)
        if len(in_a) and len(in_b):
            mated[in_a] |= _faced(table, normals, in_a, in_b, gap, reach)
            mated[in_b] |= _faced(table, normals, in_b, in_a, gap, reach)
    return mated


def _touching(table: Assembly, reach: float) -> list[tuple[int, int]]:
    """Pairs of sherds whose boxes, grown by the reach, overlap."""
    n = table.n_sherds
    low, high = np.full((n, 3), np.inf), np.full((n, 3), -np.inf)
    np.minimum.at(low, table.face_sherd, table.centres)
    np.maximum.at(high, table.face_sherd, table.centres)
    apart = np.asarray((low[:, None] > high[None] + reach).any(axis=2))
    return [(a, b) for a in range(n) for b in range(a + 1, n) if not (apart[a, b] or apart[b, a])]


def _near_box(table: Assembly, mine: Ints, theirs: Ints, reach: float) -> Ints:
    if not len(theirs):
        return mine[:0]
    low, high = table.centres[theirs].min(axis=0) - reach, table.centres[theirs].max(axis=0) + reach
    p = table.centres[mine]
    return mine[((p > low) & (p < high)).all(axis=1)]


def _faced(table: Assembly, normals: Floats, mine: Ints, theirs: Ints, gap: float, reach: float) -> Flags:
    tree = cKDTree(table.centres[theirs])
    _, near = tree.query(table.centres[mine], k=min(NEIGHBOURS, len(theirs)), distance_upper_bound=reach)
    near = near.reshape(len(mine), -1)
    found = near < len(theirs)
    other = theirs[np.minimum(near, len(theirs) - 1)]
    ahead = ((table.centres[other] - table.centres[mine][:, None]) * normals[mine][:, None]).sum(axis=2)
    against = (normals[other] * normals[mine][:, None]).sum(axis=2) < -0.7
    return np.asarray((found & against & (ahead < gap) & (ahead > -0.5 * gap)).any(axis=1))


def has_far_side(table: Assembly, normals: Floats, thickness: float) -> Flags:
    """(F,) whether the other side of the wall lies behind a face, at 0.6 to 2 thicknesses; not so behind a fracture."""
    found = np.zeros(table.n_faces, dtype=bool)
    for sherd in range(table.n_sherds):
        faces = np.flatnonzero(table.face_sherd == sherd)
        if not len(faces):
            continue
        tree = cKDTree(table.centres[faces])
        for depth in (1.0, 0.75, 1.3, 1.7):
            open_ = faces[~found[faces]]
            probe = table.centres[open_] - depth * thickness * normals[open_]
            distance, near = tree.query(probe, distance_upper_bound=0.5 * thickness + table.spacing)
            far = faces[np.minimum(near, len(faces) - 1)]
            beyond = np.abs(((table.centres[far] - probe) * normals[far]).sum(axis=1)) < 0.25 * thickness
            against = (normals[far] * normals[open_]).sum(axis=1) < -0.7
            found[open_] = np.isfinite(distance) & beyond & against
    return found


def looks_into_hole(table: Assembly, fracture: Flags, mated: Flags, *, radius: float) -> Flags:
    """(F,) fracture faces most of whose surroundings, on the same sherd, have nobody against them.

    radius  length, of the surroundings that vote; somewhat less than the wall's thickness
    """
    alone = np.zeros(table.n_faces, dtype=bool)
    for sherd in range(table.n_sherds):
        faces = np.flatnonzero(fracture & (table.face_sherd == sherd))
        if len(faces):
            alone[faces] = majority(table.centres[faces], table.areas[faces], ~mated[faces], radius=radius)
    return alone


def majority(points: Floats, weights: Floats, vote: Flags, *, radius: float) -> Flags:
    """(m,) whether most of the weight within the radius, a point's own included, votes yes."""
    tree = cKDTree(points)
    near = tree.sparse_distance_matrix(tree, radius, output_type="coo_matrix").tocsr()
    near.data[:] = 1.0
    total = near @ weights + weights
    yes = near @ (weights * vote) + weights * vote
    return np.asarray(yes > 0.5 * total)
