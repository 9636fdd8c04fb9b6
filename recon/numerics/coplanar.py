"""Coplanar triangles of a closed mesh to polygons: which triangles share a plane, and which vertices are corners still.

    +---+---+         +-------+      regions   triangles joined over edges within one plane
    |  /|  /|         |       |      loops     borders of a region; material to the left
    | / | / |   ->    |       |      corners   vertices that remain: three regions meet, or a border bends
    |/  |/  |         |       |
    +---+---+         +-------+      twin      opposite half-edges (recon.numerics.closed_mesh)

Four nearly flat points lie within ε of a common plane when 3 V <= ε ΣA, with V the volume and A the four face areas of
their tetrahedron: over the plane that is best for the worst point all four heights are equal, with the areas as their
affine dependence. Unlike an angle this treats slivers as what they are: flat with anything along them.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

__all__ = ["coplanar_regions", "region_planes", "region_loops", "corner_vertices", "meet_planes"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def coplanar_regions(vertices: Floats, face_vertices: Ints, twin: Ints, tolerance: float) -> Ints:
    """(F,) number of the flat region each face belongs to.

    Promises  a region hangs together over edges; its vertices lie within about `tolerance` of its plane, and none of
              its faces, slivers apart, looks the other way. Where flats run into one another, large faces come first.
    """
    corners = vertices[face_vertices]
    flat = _flat_edges(vertices, face_vertices, twin, tolerance)
    part = _connected(flat, twin, len(face_vertices))
    bad = ~_is_flat(corners, part, tolerance)
    if not bad.any():
        return part
    return _split(corners, _Links(twin, flat), part, bad[part], tolerance)


def _flat_edges(vertices: Floats, face_vertices: Ints, twin: Ints, tolerance: float) -> Bools:
    """(3 F,) whether the four points around a half-edge share a plane and its two faces look the same way."""
    start, end = face_vertices.ravel(), np.roll(face_vertices, -1, axis=1).ravel()
    apex = np.roll(face_vertices, -2, axis=1).ravel()
    once = np.flatnonzero(np.arange(len(twin)) < twin)
    a, b, c, d = (vertices[k] for k in (start[once], end[once], apex[once], apex[twin[once]]))
    left, right = np.cross(b - a, c - a), np.cross(a - b, d - b)
    others = np.cross(c - a, d - a), np.cross(c - b, d - b)
    doubles = sum(np.linalg.norm(n, axis=1) for n in (left, right, *others))
    six_volumes = np.abs(np.einsum("ij,ij->i", left, d - a))
    longest = np.linalg.norm(b - a, axis=1)
    sliver = np.minimum(np.linalg.norm(left, axis=1), np.linalg.norm(right, axis=1)) <= tolerance * longest
    same_way = sliver | (np.einsum("ij,ij->i", left, right) > 0)
    flat = np.zeros(len(twin), dtype=bool)
    flat[once] = (six_volumes <= tolerance * doubles) & same_way
    flat[twin[once]] = flat[once]
    return flat


def _connected(joined: Bools, twin: Ints, n_faces: int) -> Ints:
    h = np.flatnonzero(joined)
    graph = coo_array((np.ones(len(h), dtype=np.int8), (h // 3, twin[h] // 3)), shape=(n_faces, n_faces))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def region_planes(corners: Floats, region: Ints) -> tuple[Floats, Floats]:
    """(R, 3) unit normals and (R,) offsets of the regions' planes, n · x = offset, from (F, 3, 3) corner points.

    The normal is that of the summed area vectors, which depends on a region's border alone; the plane lies halfway
    between the lowest and the highest vertex.
    """
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    n_regions = int(region.max(initial=-1)) + 1
    normal = np.stack([np.bincount(region, area[:, k], n_regions) for k in range(3)], axis=1)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, size, out=np.zeros_like(normal), where=size > 0)
    low, high = _height_range(corners, region, normal)
    return normal, (low + high) / 2


def _height_range(corners: Floats, region: Ints, normal: Floats) -> tuple[Floats, Floats]:
    heights = np.einsum("fkj,fj->fk", corners, normal[region])
    low, high = np.full(len(normal), np.inf), np.full(len(normal), -np.inf)
    np.minimum.at(low, region, heights.min(axis=1))
    np.maximum.at(high, region, heights.max(axis=1))
    return low, high


def _is_flat(corners: Floats, part: Ints, tolerance: float) -> Bools:
    """(R,) whether the vertices of a part lie within `tolerance` of its plane and its faces look one way."""
    normal, _ = region_planes(corners, part)
    low, high = _height_range(corners, part, normal)
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    against = (np.einsum("ij,ij->i", area, normal[part]) <= 0) & ~_slivers(corners, area, tolerance)
    return (high - low <= 2 * tolerance) & (np.bincount(part, against, len(normal)) == 0)


def _slivers(corners: Floats, double_area: Floats, tolerance: float) -> Bools:
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return np.linalg.norm(double_area, axis=1) <= tolerance * longest


class _Links:
    """Neighbours of faces over flat edges."""

    def __init__(self, twin: Ints, flat: Bools) -> None:
        self.neighbour = np.where(flat, twin // 3, -1).reshape(-1, 3)

    def around(self, faces: Ints) -> Ints:
        found = np.unique(self.neighbour[faces])
        return found[found >= 0]


def _split(corners: Floats, links: _Links, part: Ints, bad: Bools, tolerance: float) -> Ints:
    """Grow regions anew, from the largest face left over each time, in the parts that turned out not to be flat."""
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(area, axis=1)
    thin = _slivers(corners, area, tolerance)
    region = np.where(bad, -1, part)
    number = int(part.max()) + 1
    seeds = np.flatnonzero(bad)
    for seed in seeds[np.argsort(-size[seeds], kind="stable")].tolist():
        if region[seed] < 0:
            _grow(seed, number, region, corners, links, (area, thin, tolerance))
            number += 1
    return np.unique(region, return_inverse=True)[1].astype(np.int64)


def _grow(
    seed: int, number: int, region: Ints, corners: Floats, links: _Links, measures: tuple[Floats, Bools, float]
) -> None:
    """Label the flat region around `seed`, wave after wave, its plane refitted to what it holds."""
    area, thin, tolerance = measures
    region[seed] = number
    total = area[seed].copy()
    heft = np.linalg.norm(area[seed])
    moment = heft * corners[seed].mean(axis=0)
    front = np.array([seed])
    while len(front) and heft > 0:
        normal = total / np.linalg.norm(total)
        near = links.around(front)
        near = near[region[near] < 0]
        heights = (corners[near] - moment / heft) @ normal
        same_way = thin[near] | (area[near] @ normal > 0)
        front = near[(np.abs(heights).max(axis=1) <= tolerance) & same_way]
        region[front] = number
        weight = np.linalg.norm(area[front], axis=1)
        total, heft = total + area[front].sum(axis=0), heft + weight.sum()
        moment = moment + weight @ corners[front].mean(axis=1)


def region_loops(twin: Ints, region: Ints) -> list[Ints]:
    """Borders of the regions: rows of half-edges, each ending where the next begins, the region to the left.

    A border that touches itself at a vertex turns there within the region, so that it never crosses itself.
    """
    border = region[twin // 3] != np.repeat(region, 3)
    following = _next_in_face(np.arange(len(twin)))
    inner = np.flatnonzero(border & ~border[following])
    while len(inner):
        following[inner] = _next_in_face(twin[following[inner]])
        inner = inner[~border[following[inner]]]
    return _cycles(following.tolist(), np.flatnonzero(border).tolist())


def _next_in_face(halfedge: Ints) -> Ints:
    return np.where(halfedge % 3 == 2, halfedge - 2, halfedge + 1)


def _cycles(following: list[int], members: list[int]) -> list[Ints]:
    unseen = dict.fromkeys(members)
    cycles = []
    while unseen:
        h, _ = unseen.popitem()
        cycle = [h]
        while (h := following[h]) != cycle[0]:
            del unseen[h]
            cycle.append(h)
        cycles.append(np.array(cycle, dtype=np.int64))
    return cycles


def corner_vertices(vertices: Floats, loops: list[Ints], tolerance: float) -> Bools:
    """(V,) whether a vertex is a corner still: loops are rows of vertex numbers, each border line in two of them.

    A vertex with two border lines goes when the line between the corners that remain passes it within `tolerance`.
    """
    on_loops = np.concatenate(loops) if loops else np.zeros(0, dtype=np.int64)
    lines = np.bincount(on_loops, minlength=len(vertices))
    corner = lines > 0
    corner[lines == 2] = False
    for loop in loops:
        if not corner[loop].all():
            _mark_bends(vertices, loop, corner, tolerance, fixed=lines > 2)
    return corner


def _mark_bends(vertices: Floats, loop: Ints, corner: Bools, tolerance: float, *, fixed: Bools) -> None:
    ends = np.flatnonzero(fixed[loop])
    if not len(ends):  # two flats that meet along a closed line: begin where any walk around it would
        ends = np.array([int(np.argmin(loop))])
        corner[loop[ends]] = True
    turned = np.roll(loop, -ends[0])
    stops = np.append(ends - ends[0], len(loop))
    for first, last in zip(stops[:-1].tolist(), stops[1:].tolist()):
        chain = np.append(turned[first:last], turned[last % len(loop)])
        # each line is met twice, from both sides: walk it the same way both times, to the same result
        chain = chain if (chain[0], chain[1]) < (chain[-1], chain[-2]) else chain[::-1]
        corner[chain[_bends(vertices[chain], tolerance)]] = True


def _bends(points: Floats, tolerance: float) -> list[int]:
    """Inner points that a polyline within `tolerance` of all of them keeps; [douglas1973]."""
    kept, spans = [], [(0, len(points) - 1)]
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        away = _from_segment(points[first + 1 : last], points[first], points[last])
        far = int(np.argmax(away))
        if away[far] > tolerance:
            kept.append(first + 1 + far)
            spans += [(first, kept[-1]), (kept[-1], last)]
    return kept


def _from_segment(points: Floats, a: Floats, b: Floats) -> Floats:
    step = b - a
    square = float(step @ step)
    t = np.clip((points - a) @ step / square, 0.0, 1.0) if square > 0 else np.zeros(len(points))
    return np.linalg.norm(points - a - t[:, None] * step, axis=1)


def meet_planes(points: Floats, incidence: tuple[Ints, Ints], planes: tuple[Floats, Floats], reach: float) -> Floats:
    """Move points onto the planes they belong to, by the shortest way.

    points     (V, 3)
    incidence  point numbers and plane numbers, one pair for each point on a plane
    planes     (R, 3) unit normals and (R,) offsets
    Promises   a point that would have to go farther than `reach`, or is there already but for rounding, stays;
               directions that its planes, being nearly parallel, leave open are not used.
    """
    at, on = np.unique(np.stack(incidence, axis=1), axis=0).T
    miss = planes[1][on] - np.einsum("ij,ij->i", planes[0][on], points[at])
    off = np.unique(at[np.abs(miss) > 1e-13 * np.abs(points).max(initial=0.0)])
    here = np.isin(at, off)
    row, normal, miss = np.searchsorted(off, at[here]), planes[0][on[here]], miss[here]
    matrix, pull = np.zeros((len(off), 3, 3)), np.zeros((len(off), 3))
    np.add.at(matrix, row, normal[:, :, None] * normal[:, None, :])
    np.add.at(pull, row, normal * miss[:, None])
    step = np.einsum("vij,vj->vi", np.linalg.pinv(matrix, rcond=1e-3, hermitian=True), pull)
    near = np.linalg.norm(step, axis=1) <= reach
    moved = np.array(points)
    moved[off[near]] += step[near]
    return moved
