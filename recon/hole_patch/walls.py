"""Which faces of the sherds are the vessel's outer wall, its inner wall, or fracture; and the two walls as meshes.

A thrown wall comes back all round the axis at the same radius, height and slope; a crack does so nowhere. Each face
has a guess from that and from its neighbours across cracks; a random walker then spreads the guesses over the mesh,
easily along a smooth surface and hardly across a crease.

       outer    (p - c)·n > 0          c, on the axis at the height of the mouth: from there the inner wall
        |  |    inner                  is seen from its front, the outer wall from its back
        |  | .c
        |  |/
        |__|____ base
Paper  [grady2005] for the random walker with priors, [taubin1995] for the plain wall.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.spatial import cKDTree

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.assembly import Assembly, label_groups
from recon.hole_patch.axis import SECTORS, coverage
from recon.hole_patch.fracture import has_far_side, majority
from recon.hole_patch.surroundings import Axis

__all__ = [
    "FRACTURE",
    "INNER",
    "OUTER",
    "depths_in_wall",
    "fracture_faces",
    "label_walls",
    "lip_height",
    "spread",
    "wall_mesh",
    "wall_trust",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

FRACTURE, OUTER, INNER = 0, 1, 2
CREASE = np.radians(15.0)
MAX_STEPS = 200
BELIEF = 0.07  # of a face that comes back often or seldom, or lies deep, in what that says
RECURRING = 0.6  # of the turn that is there; no crack comes back so often at one depth, one slope
ASKED, MOST_ASKED = 15, 20_000  # wall faces that say how deep another lies, and of how many they are taken
NEAR_EDGE = 1.25  # thicknesses from the outer edge of a crack, that its faces are where the wall is even
DOUBTFUL = 0.04  # share of wall in a fracture face; between cracks and lumps there is a wide gap
ALONG = 0.57  # cosine to the wall beside it of what lies along it: within 55°
DEEP, DEEPEST = 0.15, 0.3  # of the thickness: neither relief nor a lump lies so far below the surface of an even wall


def spread(table: Assembly, normals: Floats, *, guess: Floats, belief: Floats) -> Floats:
    """(F,) guesses between 0 and 1 after a random walk that hardly crosses creases.

    guess, belief  (F,) what each face says by itself, and how much it insists on it; belief of some face is positive
    Paper          [grady2005]: minimise Σ w_ij (x_i - x_j)² + Σ belief_i (x_i - guess_i)².
    """
    i, j = table.pairs.T
    cosine = np.clip((normals[i] * normals[j]).sum(axis=1), -1.0, 1.0)
    weight = np.exp(-((np.arccos(cosine) / CREASE) ** 2)) + 1e-6
    n = table.n_faces
    sums = np.bincount(i, weight, n) + np.bincount(j, weight, n) + belief + 1e-9
    across = coo_array((np.tile(weight, 2), (np.concatenate([i, j]), np.concatenate([j, i]))), shape=(n, n)).tocsr()
    return _descend(diags_array(sums).tocsr() - across, belief * guess, guess, 1.0 / sums)


def _descend(matrix: csr_array, right: Floats, start: Floats, scale: Floats) -> Floats:
    """Preconditioned conjugate gradients to a thousandth.

    Sums are taken by einsum: the threads of a BLAS product cost more than they save on vectors of this size.
    """
    x, r = start, right - matrix @ start
    z = scale * r
    p, rz = z, float(np.einsum("i,i->", r, z))
    enough = 1e-6 * rz
    for _ in range(MAX_STEPS):
        if rz <= enough:
            break
        q = matrix @ p
        step = rz / float(np.einsum("i,i->", p, q))
        x, r = x + step * p, r - step * q
        z = scale * r
        rz, before = float(np.einsum("i,i->", r, z)), rz
        p = z + (rz / before) * p
    return x


def fracture_faces(
    table: Assembly, normals: Floats, axis: Axis, *, mated: Flags, thickness: float
) -> tuple[Flags, Flags]:
    """(F,) whether a face of closed sherds is fracture; and (F,) which of them may be a lump on a wall as well.

    mated      (F,) faces with a neighbour's fracture against them
    thickness  of the wall; parts smaller than its square go to what surrounds them
    """
    around = coverage(axis, table.centres, normals, step=0.15 * thickness, among=~mated)
    recurs = around / min(SECTORS, int(around.max()))
    wall = np.clip((recurs - 1 / 6) / (1 / 3 - 1 / 6), 0.0, 1.0)
    far = has_far_side(table, normals, thickness)
    # of a base that lost its half no face recurs as often as others do
    sheet = ((recurs > RECURRING) | ((wall == 1.0) & far)) & ~mated
    allowed = min(max(DEEP * thickness, 2.0 * axis.quality), DEEPEST * thickness)
    deep = depths_in_wall(table, normals, axis, sheet, of=np.arange(table.n_faces)) > allowed
    height = axis.cylindrical(table.centres)[:, 2]
    deep &= height < lip_height(height)  # an uneven lip lies below its own higher parts
    mated = mated & ~((recurs > RECURRING) & far & ~deep)  # wall beside a crack, that the neighbour's slope faces
    belief = BELIEF * np.abs(2.0 * wall - 1.0)
    lump, level = _contradicted(table, normals, wall, far=far, mated=mated)
    belief[(lump & ~deep) | level] *= 0.03
    sunk = deep & ~mated & ~far
    wall[sunk], belief[sunk] = 0.0, BELIEF
    guess = np.where(mated, 0.0, wall)
    share = spread(table, normals, guess=guess, belief=np.where(mated, 0.2, belief))
    fracture = _without_specks(table, (share < 0.5).astype(np.int64), thickness**2) == 1
    return fracture, fracture & (share > DOUBTFUL) & ~mated


def lip_height(height: Floats) -> float:
    """Above which the lip is, given the heights of all faces."""
    low, high = np.quantile(height, [0.001, 0.999])
    return float(high - 0.1 * (high - low))


def depths_in_wall(table: Assembly, normals: Floats, axis: Axis, sheet: Flags, *, of: Ints) -> Floats:
    """(k,) how deep in the wall faces lie: below the surface that wall faces of like radius and height make.

    sheet   (F,) faces that are wall for certain; the nearest of all round the turn are asked, their median counts
    of      (k,) numbers of the faces that are asked about
    """
    known = np.flatnonzero(sheet)
    if not len(known):
        return np.zeros(len(of))
    known = known[:: max(1, len(known) // MOST_ASKED)]
    centres = table.centres[known]
    sections, place = (axis.cylindrical(x)[:, 1:] for x in (centres, table.centres[of]))
    slope = axis.slopes(centres, normals[known])
    count = min(ASKED, len(known))
    near = cKDTree(sections).query(place, k=count)[1].reshape(len(place), count)
    below = ((sections[near] - place[:, None]) * slope[near]).sum(axis=2)
    return np.asarray(np.median(below, axis=1))


def _contradicted(table: Assembly, normals: Floats, wall: Floats, *, far: Flags, mated: Flags) -> tuple[Flags, Flags]:
    """(F,) and (F,) faces whose guess does not go with how they lie to the certain wall faces nearest to them.

    A lump on a wall recurs nowhere, yet has the wall's far side behind it or lies within 55° of the wall; so does a
    crack that runs slantwise through the wall, but that is deep in it. A crack that runs level round the vessel recurs
    everywhere, yet has no far side and lies steeper than 66°.
    """
    none = np.zeros(table.n_faces, dtype=bool)
    sure = np.flatnonzero(far & (wall == 1.0) & ~mated)
    if not len(sure):
        return none, none
    unsure = np.flatnonzero(~far & ~mated)
    along = np.ones(table.n_faces)
    along[unsure] = _along(table, normals, sure, unsure)
    return (wall < 0.5) & (far | (along > ALONG)), (wall >= 0.5) & ~far & (along < 0.4)


def _along(table: Assembly, normals: Floats, walls: Ints, faces: Ints) -> Floats:
    """(k,) cosine between faces (k,) and the wall faces nearest to them, the median of a few."""
    count = min(6, len(walls))
    _, near = cKDTree(table.centres[walls]).query(table.centres[faces], k=count)
    cosines = (normals[walls[near.reshape(len(faces), count)]] * normals[faces][:, None]).sum(axis=2)
    return np.asarray(np.median(np.abs(cosines), axis=1))


def _without_specks(table: Assembly, labels: Ints, area: float) -> Ints:
    """Groups smaller than the area take the label of most of their border; whole sherds are never turned over."""
    labels = labels.copy()
    for _ in range(3):
        group, size = label_groups(table, labels)
        i, j = table.pairs[labels[table.pairs[:, 0]] != labels[table.pairs[:, 1]]].T
        lengths = np.linalg.norm(table.centres[i] - table.centres[j], axis=1)
        here, there = np.concatenate([i, j]), np.concatenate([j, i])
        vote = np.zeros((len(size), int(labels.max()) + 1))
        np.add.at(vote, (group[here], labels[there]), np.tile(lengths, 2))
        turn = (size < area) & (vote.sum(axis=1) > 0)
        if not turn.any():
            break
        labels = np.where(turn[group], vote.argmax(axis=1)[group], labels)
    return labels


def label_walls(
    table: Assembly, normals: Floats, axis: Axis, *, fracture: Flags, doubtful: Flags, thickness: float
) -> Ints:
    """(F,) OUTER, INNER or FRACTURE for every face.

    fracture, doubtful  (F,) as `fracture_faces` found them

    Groups of wall faces are told apart by the side they turn to a point on the axis at the height of the mouth; the two
    walls meet along the lip.
    """
    facing, hidden = _seen_from_mouth(table, normals, axis, thickness)
    guess = np.clip(0.5 + facing, 0.0, 1.0)
    belief = 0.002 + 0.1 * np.clip(np.abs(facing) - 0.1, 0.0, None) * np.where(hidden & (facing < 0.0), 0.02, 1.0)
    belief[fracture] = 0.0
    share = spread(table, normals, guess=guess, belief=belief)
    labels = np.where(fracture, FRACTURE, np.where(share > 0.5, OUTER, INNER))
    labels = _without_specks(table, labels, thickness**2)
    labels[_lumps(table, labels, doubtful, thickness)] = INNER
    return _without_specks(table, labels, thickness**2)


def _seen_from_mouth(table: Assembly, normals: Floats, axis: Axis, thickness: float) -> tuple[Floats, Flags]:
    """(F,) cosine by which a face turns its back to the middle of the mouth, and whether something lies before it.

    The inside of a hollow foot turns its front to the mouth, as the inner wall does, but the base hides it.
    """
    top = float(np.quantile(axis.cylindrical(table.centres)[:, 2], 0.999))
    sight = table.centres - (axis.point + top * axis.direction)
    distance = np.maximum(np.linalg.norm(sight, axis=1), 1e-12)
    facing = (sight * normals).sum(axis=1) / distance
    slot = np.floor(np.arccos(np.clip(-sight @ axis.direction / distance, -1.0, 1.0)) * 100.0).astype(np.int64)
    order = np.lexsort((distance, slot))
    first = np.searchsorted(slot[order], np.arange(slot.max() + 2))
    front = distance[order[np.minimum(first[:-1] + np.diff(first) // 20, len(order) - 1)]]
    return facing, distance > front[slot] + 1.5 * thickness


def _lumps(table: Assembly, labels: Ints, doubtful: Flags, thickness: float) -> Flags:
    """(F,) fracture faces that no edge between outer wall and fracture is near, and that are doubtful.

    A crack that does not reach the outside is no crack, but a lump on the inner wall. Where the wall is thick, as
    beside a base, cracks reach as far from their outer edge, but of them there is no doubt.
    """
    i, j = table.pairs.T
    meet = (np.minimum(labels[i], labels[j]) == FRACTURE) & (np.maximum(labels[i], labels[j]) == OUTER)
    far = labels == FRACTURE
    if not meet.any() or not far.any():
        return far
    edge = table.vertices[table.pair_edges[meet]].mean(axis=1)
    distance, _ = cKDTree(edge).query(table.centres[far], distance_upper_bound=NEAR_EDGE * thickness)
    far[far] = np.isinf(distance)
    for sherd in range(table.n_sherds):
        faces = np.flatnonzero(far & (table.face_sherd == sherd))
        if len(faces):
            far[faces] = majority(table.centres[faces], table.areas[faces], doubtful[faces], radius=thickness)
    return far


def wall_mesh(table: Assembly, faces: Flags, *, turned: bool) -> tuple[TriangleMesh, Ints]:
    """The given faces as one mesh, and the sherd of each of its vertices; `turned` reverses every face.

    Promises  the faces around every vertex form one fan: where two fans met in one point, each has its own.
    """
    corners = table.faces[faces]
    fan, vertex_of_fan = _fans(corners)
    if turned:
        fan = fan[:, ::-1]
    return TriangleMesh(table.vertices[vertex_of_fan], fan, "wall"), table.vertex_sherd[vertex_of_fan]


def _fans(corners: Ints) -> tuple[Ints, Ints]:
    """Number the corners so that two of them share a number when faces joined by edges link them round their vertex."""
    from scipy.sparse.csgraph import connected_components

    n = len(corners)
    corner = np.arange(3 * n).reshape(n, 3)
    begin, end = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    first, second = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    key = np.minimum(begin, end) * (corners.max(initial=0) + 1) + np.maximum(begin, end)
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order][1:] == key[order][:-1])
    a, b = order[same], order[same + 1]  # the two faces run through their edge in opposite directions
    link = coo_array(
        (
            np.ones(2 * len(a), dtype=np.int8),
            (np.concatenate([first[a], second[a]]), np.concatenate([second[b], first[b]])),
        ),
        shape=(3 * n, 3 * n),
    )
    n_fans, fan = connected_components(link, directed=False)
    vertex = np.zeros(n_fans, dtype=np.int64)
    vertex[fan] = corners.ravel()
    return fan.reshape(n, 3).astype(np.int64), vertex


def wall_trust(wall: TriangleMesh, *, reach: float) -> Floats:
    """(V,) 0 on the border of a sherd's wall, where smoothing holds the vertices, rising to 1 at the given distance."""
    begin = wall.face_vertices.ravel()
    end = np.roll(wall.face_vertices, -1, axis=1).ravel()
    key = np.minimum(begin, end) * wall.n_vertices + np.maximum(begin, end)
    _, at, count = np.unique(key, return_index=True, return_counts=True)
    border = np.unique(np.concatenate([begin[at[count == 1]], end[at[count == 1]]]))
    if not len(border):
        return np.ones(wall.n_vertices)
    distance, _ = cKDTree(wall.vertices[border]).query(wall.vertices, distance_upper_bound=reach)
    t = np.minimum(distance / reach, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))
