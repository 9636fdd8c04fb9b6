"""Edge collapse on a closed mesh: cheapest first, never against one of the promises.

          w                    w            An edge (u, v) shrinks to a point p, two faces and v go.
        / | \\                  |            ring     faces around u and v but those two
       /  |  \\                 |            link     the vertices around them
      u---+---v     ---->      p            Allowed when u and v have two neighbours in common and no more (then the
       \\  |  /                 |            surface stays what it is: bodies, cavities, handles), when no face of the
        \\ | /                  |            ring turns over or thins out, when no end is locked, and when the surface
          w'                   w'           stays within its bound.

Halfedge h = 3 f + k runs from corner k of face f to the next.

mesh.corner (3F,)  vertex at the start of each halfedge    mesh.twin (3F,)    the halfedge that runs back
mesh.out    (V,)   a halfedge that starts at the vertex    mesh.edge (3F,)    edge number, the same for both halves
mesh.half   (E,)   a halfedge of the edge                  mesh.place (V, 3)  where the vertices are

Paper  [nakamura], section 2.2 for the three kinds of edges; [garland1997]; link condition [dey1999].
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.numerics.cell_lookup import CellLookup
from recon.numerics.edge_heap import EdgeHeap, heap_append, heap_arrange, heap_drop, heap_put
from recon.numerics.error_bound import Bound, hand_over, keeps_bound
from recon.numerics.quadrics import lowest_point, moved_sum, quadric_value

__all__ = ["REGULARISER", "CollapseMesh", "collapse_mesh", "collapse_edges"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

# of quadrics: larger ones mix up the order of collapses that cost nothing, and with it every edge of the part
REGULARISER = 1e-9
RING = 512  # faces a ring may have; a vertex with more neighbours is left alone
FLATTEST = 0.2  # cosine of the largest turn of a face's normal in one collapse
FOLDED = -0.5  # cosine of the sharpest edge that a collapse may make: beyond it lie the folds that cut themselves
THINNEST = 0.01  # least height of a triangle over its longest side, in voxels


class CollapseMesh(NamedTuple):
    """The mesh while edges collapse, see the module's key; quadric (V, 10), locked, feature (V,).

    span  (1,) square of the longest side that a face may get
    """

    corner: NDArray[np.int32]
    twin: NDArray[np.int32]
    out: NDArray[np.int32]
    edge: NDArray[np.int32]
    half: NDArray[np.int32]
    place: Floats
    quadric: Floats
    mark: NDArray[np.int32]
    locked: Bools
    feature: Bools
    span: Floats


def collapse_mesh(
    vertices: Floats,
    faces: Ints,
    twin: Ints,
    *,
    quadric: Floats,
    locked: Bools,
    feature: Bools,
    longest: float = np.inf,
) -> CollapseMesh:
    """A closed mesh made ready; `twin` gives for every halfedge the one that runs back."""
    corner = faces.ravel().astype(np.int32)
    out = np.zeros(len(vertices), dtype=np.int32)
    out[corner] = np.arange(len(corner), dtype=np.int32)
    half = np.flatnonzero(np.arange(len(twin)) < twin).astype(np.int32)
    edge = np.empty(len(twin), dtype=np.int32)
    edge[half] = np.arange(len(half), dtype=np.int32)
    edge[twin[half]] = edge[half]
    mark = np.zeros(len(vertices), dtype=np.int32)
    span = np.array([longest**2])
    back = twin.astype(np.int32)
    return CollapseMesh(
        corner, back, out, edge, half, vertices.copy(), quadric, mark, locked.copy(), feature.copy(), span
    )


@njit(cache=True)
def collapse_edges(
    m: CollapseMesh, heap: EdgeHeap, bound: Bound, look: CellLookup, n_faces: int, target: int
) -> int:  # pragma: no cover - compiled
    """Collapse until `target` faces are left or nothing more may; the number of faces left."""
    y, p, q, work = np.empty(3), np.empty(3), np.empty(10), np.empty((3, 4))
    ring = np.empty(RING, dtype=np.int32)
    token = 0
    for e in range(len(m.half)):
        cost = _edge_cost(m, e, y, q, work)
        if cost < np.inf:
            heap_append(heap, e, cost)
    heap_arrange(heap)
    while heap.size[0] > 0 and n_faces > target:
        e = heap.heap[0]
        heap_drop(heap, e)
        h = m.half[e]
        u, v = m.corner[h], m.corner[m.twin[h]]
        token += 2
        if not _linked_simply(m, h, token):
            continue
        n_ring = _gather_ring(m, h, ring)
        if n_ring < 0:
            continue
        _edge_cost(m, e, y, q, work)
        for i in range(3):
            p[i] = m.place[u, i] + y[i]
        # another place for a face that would turn over costs more than the heap knows, and comes too early
        if not _keeps_shape(m, ring, n_ring, p):
            continue
        kept = _may_go(m, bound, look, h, ring, n_ring, p)
        if not kept and bound.limit[0] > 0.0 and not m.feature[u] and not m.feature[v]:
            for end in (u, v):
                if not kept:
                    p[:] = m.place[end]
                    kept = _may_go(m, bound, look, h, ring, n_ring, p)
        if not kept:
            continue
        hand_over(bound, ring, n_ring, h // 3, m.twin[h] // 3)
        _collapse(m, heap, h, p, q)
        n_faces -= 2
        _update_costs(m, heap, u, y, q, work)
    return n_faces


@njit(cache=True)
def _may_go(
    m: CollapseMesh, bound: Bound, look: CellLookup, h: int, ring: NDArray[np.int32], n_ring: int, p: Floats
) -> bool:  # pragma: no cover - compiled
    """Whether the ends of an edge may become one at p."""
    if not _keeps_shape(m, ring, n_ring, p):
        return False
    u, v = m.corner[h], m.corner[m.twin[h]]
    before = m.place[u].copy()
    m.place[u] = p
    kept = keeps_bound(bound, look, m.corner, m.place, ring, n_ring, h // 3, m.twin[h] // 3, u, v, before)
    m.place[u] = before
    return bool(kept)


@njit(cache=True)
def _next(h: int) -> int:  # pragma: no cover - compiled
    return h - 2 if h % 3 == 2 else h + 1


@njit(cache=True)
def _previous(h: int) -> int:  # pragma: no cover - compiled
    return h + 2 if h % 3 == 0 else h - 1


@njit(cache=True)
def _edge_cost(m: CollapseMesh, e: int, y: Floats, q: Floats, work: Floats) -> float:  # pragma: no cover - compiled
    """Cost of an edge, infinite where it must stay; y is where it goes, less u, and q the joint quadric about u."""
    h = m.half[e]
    u, v = m.corner[h], m.corner[m.twin[h]]
    if m.locked[u] or m.locked[v] or (m.feature[u] and m.feature[v]):
        return np.inf
    length = 0.0
    for i in range(3):
        y[i] = m.place[u, i] - m.place[v, i]
        length += y[i] * y[i]
    moved_sum(q, m.quadric[u], m.quadric[v], y)
    if m.feature[u]:
        y[0] = y[1] = y[2] = 0.0
        return quadric_value(q, y)
    if m.feature[v]:
        for i in range(3):
            y[i] = -y[i]
        return quadric_value(q, y)
    dx, dy, dz = y[0], y[1], y[2]
    solved = lowest_point(q, y, work)
    away = (y[0] + 0.5 * dx) ** 2 + (y[1] + 0.5 * dy) ** 2 + (y[2] + 0.5 * dz) ** 2
    if not solved or away > 4.0 * length + 1.0:
        y[0], y[1], y[2] = -0.5 * dx, -0.5 * dy, -0.5 * dz
    return quadric_value(q, y)


@njit(cache=True)
def _linked_simply(m: CollapseMesh, h: int, token: int) -> bool:  # pragma: no cover - compiled
    """Whether the ends of the edge have exactly two neighbours in common, each with more than three of its own."""
    u, v = m.corner[h], m.corner[m.twin[h]]
    g = h
    while True:
        m.mark[m.corner[m.twin[g]]] = token
        g = m.twin[_previous(g)]
        if g == h:
            break
    common = 0
    start = m.twin[h]
    g = start
    while True:
        w = m.corner[m.twin[g]]
        if m.mark[w] == token and w != u:
            common += 1
        g = m.twin[_previous(g)]
        if g == start:
            break
    if common != 2:
        return False
    for g in (_previous(h), _previous(m.twin[h])):
        valence, k = 0, g
        while True:
            valence += 1
            k = m.twin[_previous(k)]
            if k == g:
                break
        if valence <= 3:
            return False
    return v != u


@njit(cache=True)
def _gather_ring(m: CollapseMesh, h: int, ring: NDArray[np.int32]) -> int:  # pragma: no cover - compiled
    """Halfedges out of u and of v, one for each face of the ring; their number, -1 when there are too many."""
    n = 0
    for start in (h, m.twin[h]):
        g = m.twin[_previous(start)]
        while g != start:
            if g // 3 != m.twin[start] // 3 and g // 3 != start // 3:
                if n == len(ring):
                    return -1
                ring[n] = g
                n += 1
            g = m.twin[_previous(g)]
    return n


@njit(cache=True)
def _keeps_shape(
    m: CollapseMesh, ring: NDArray[np.int32], n_ring: int, p: Floats
) -> bool:  # pragma: no cover - compiled
    """Whether no face of the ring turns by more than FLATTEST, gets thinner than THINNEST or longer than the span."""
    for r in range(n_ring):
        h = ring[r]
        o, a, b = m.corner[h], m.corner[_next(h)], m.corner[_previous(h)]
        ex, ey, ez = m.place[b, 0] - m.place[a, 0], m.place[b, 1] - m.place[a, 1], m.place[b, 2] - m.place[a, 2]
        ox, oy, oz = m.place[o, 0] - m.place[a, 0], m.place[o, 1] - m.place[a, 1], m.place[o, 2] - m.place[a, 2]
        qx, qy, qz = p[0] - m.place[a, 0], p[1] - m.place[a, 1], p[2] - m.place[a, 2]
        mx, my, mz = ey * oz - ez * oy, ez * ox - ex * oz, ex * oy - ey * ox
        nx, ny, nz = ey * qz - ez * qy, ez * qx - ex * qz, ex * qy - ey * qx
        old, new = mx * mx + my * my + mz * mz, nx * nx + ny * ny + nz * nz
        if nx * mx + ny * my + nz * mz < FLATTEST * np.sqrt(old * new):
            return False
        longest = max(ex * ex + ey * ey + ez * ez, qx * qx + qy * qy + qz * qz)
        longest = max(longest, (qx - ex) ** 2 + (qy - ey) ** 2 + (qz - ez) ** 2)
        if longest > m.span[0] or new < THINNEST * THINNEST * longest or _folds(m, h, p, nx, ny, nz):
            return False
    return True


@njit(cache=True)
def _folds(m: CollapseMesh, h: int, p: Floats, nx: float, ny: float, nz: float) -> bool:  # pragma: no cover - compiled
    """Whether a ring face, its new normal given, would lie back on the face across its outer edge."""
    t = m.twin[_next(h)]
    b, a, c = m.corner[t], m.corner[_next(t)], m.corner[_previous(t)]
    o = m.corner[h]
    ex, ey, ez = m.place[a, 0] - m.place[b, 0], m.place[a, 1] - m.place[b, 1], m.place[a, 2] - m.place[b, 2]
    cx, cy, cz = m.place[c, 0] - m.place[b, 0], m.place[c, 1] - m.place[b, 1], m.place[c, 2] - m.place[b, 2]
    if c == o:
        cx, cy, cz = p[0] - m.place[b, 0], p[1] - m.place[b, 1], p[2] - m.place[b, 2]
    ax, ay, az = ey * cz - ez * cy, ez * cx - ex * cz, ex * cy - ey * cx
    turn = nx * ax + ny * ay + nz * az
    return turn < FOLDED * np.sqrt((nx * nx + ny * ny + nz * nz) * (ax * ax + ay * ay + az * az))


@njit(cache=True)
def _collapse(m: CollapseMesh, heap: EdgeHeap, h: int, p: Floats, q: Floats) -> None:  # pragma: no cover - compiled
    """Move u to p, hand it v's faces, and close the gap of the two faces that go."""
    t = m.twin[h]
    u, v = m.corner[h], m.corner[t]
    shift = np.empty(3)
    for i in range(3):
        shift[i] = p[i] - m.place[u, i]
    nothing = np.zeros(10)
    moved_sum(m.quadric[u], nothing, q, shift)
    for i in range(3):
        m.place[u, i] = p[i]
    m.feature[u] = m.feature[u] or m.feature[v]
    g = m.twin[_previous(t)]
    while g != t:
        m.corner[g] = u
        g = m.twin[_previous(g)]
    heap_drop(heap, m.edge[h])
    for half in (h, t):
        ahead, behind = _next(half), _previous(half)
        left, right = m.twin[ahead], m.twin[behind]
        gone, kept = (m.edge[ahead], m.edge[behind]) if half == h else (m.edge[behind], m.edge[ahead])
        heap_drop(heap, gone)
        m.twin[left], m.twin[right] = right, left
        m.edge[left] = m.edge[right] = kept
        m.half[kept] = left
        m.half[gone] = -1
        apex = m.corner[behind]
        m.out[apex] = left if m.corner[left] == apex else right
        m.out[u] = left if m.corner[left] == u else right
        m.corner[3 * (half // 3)] = m.corner[3 * (half // 3) + 1] = m.corner[3 * (half // 3) + 2] = -1
    m.out[v] = -1


@njit(cache=True)
def _update_costs(
    m: CollapseMesh, heap: EdgeHeap, u: int, y: Floats, q: Floats, work: Floats
) -> None:  # pragma: no cover - compiled
    """Costs of the edges around a vertex that moved; edges refused before get another chance."""
    start = m.out[u]
    g = start
    while True:
        e = m.edge[g]
        cost = _edge_cost(m, e, y, q, work)
        if cost < np.inf:
            heap_put(heap, e, cost)
        else:
            heap_drop(heap, e)
        g = m.twin[_previous(g)]
        if g == start:
            break
