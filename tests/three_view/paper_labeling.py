"""The paper's own choice of faces, as a search over labels: slow, and knowing nothing of cells or clauses.

Units are the minimal regions of the candidate planes. The paper's units are faces, which may be unions of them; but by
its condition 2 two adjacent coplanar faces of one orientation are never both present, so which faces are present
follows from the labels of the minimal regions, and the labelings correspond one to one.
"""

import numpy as np
from shapely.geometry import Point, Polygon

ABSENT, ALONG, AGAINST = 0, 1, -1  # S0, and S1 or S2 by the side that the viewer stands on


def count_of_the_paper(arranged, drawing):
    """Number of labelings that keep conditions 1, 3, 4 and 5, and draw every line in its type."""
    made = arranged.fragments
    around = _around_edges(made)
    sights = [_lines_of_sight(made, graph) for graph in arranged.graphs]
    last = {edge: max(f for f, _ in members) for edge, members in around.items()}
    due = {}
    for edge, f in last.items():
        due.setdefault(f, []).append(around[edge])
    found = 0
    labels = np.zeros(len(made.plane), dtype=np.int64)

    def search(k):
        nonlocal found
        if k == len(labels):
            found += all(_draws(arranged, graph, sight, labels) for graph, sight in zip(arranged.graphs, sights))
            return
        for label in (ABSENT, ALONG, AGAINST):
            labels[k] = label
            if all(_even(members, labels) for members in due.get(k, [])):
                search(k + 1)
        labels[k] = ABSENT

    search(0)
    return found


def _around_edges(made):
    """For each edge its fragments by angle, and the side, 0 or 1 of the edge, on which each lies in its plane."""
    around = {}
    for use, (edge, plane) in enumerate(zip(made.use_edge.tolist(), made.use_plane.tolist())):
        a, b = made.wire.vertices[made.wire.edges[edge]]
        left = np.cross(made.planes.normals[plane], b - a)
        for side, fragment in enumerate(made.region[use].tolist()):
            if fragment >= 0:
                around.setdefault(edge, []).append((left if side == 0 else -left, fragment, side, b - a))
    sorted_around = {}
    for edge, members in around.items():
        way = members[0][3]
        first = np.cross(way, np.eye(3)[np.argmin(np.abs(way))])
        second = np.cross(way, first) / np.linalg.norm(way)
        members.sort(key=lambda m: np.arctan2(m[0] @ second, m[0] @ first))
        sorted_around[edge] = [(fragment, side) for _, fragment, side, _ in members]
    return sorted_around


def _even(members, labels):
    """Condition 3: an even number of faces at an edge; they enclose solid and empty space in turn."""
    faces = [labels[f] * (1 if side == 0 else -1) for f, side in members if labels[f]]
    return len(faces) % 2 == 0 and all(a != b for a, b in zip(faces, faces[1:] + faces[:1]))


def _lines_of_sight(made, graph):
    """For both sides of each drawn edge the fragments met, nearest first, with whether their front is seen."""
    projection = graph.projection
    shapes = []
    for f in range(len(made.plane)):
        shapes.append(_outline(made, f, projection))
    rows = []
    for a, b in graph.positions[graph.edges]:
        way = b - a
        aside = np.array([-way[1], way[0]]) * 1e-3
        middle = a + 0.4731 * way
        rows.append([_met(made, shapes, middle + offset, projection) for offset in (aside, -aside)])
    return rows


def _outline(made, fragment, projection):
    ends = [
        made.wire.vertices[made.wire.edges[made.use_edge[use]]][:, projection.axes]
        for use, side in np.argwhere(made.region == fragment)
    ]
    following = {}
    for (a, b), (_use, side) in zip(ends, np.argwhere(made.region == fragment)):
        start, end = (a, b) if side == 0 else (b, a)
        following[tuple(start)] = tuple(end)
    walk = [next(iter(following))]
    while (after := following[walk[-1]]) != walk[0] and len(walk) <= len(following):
        walk.append(after)
    return Polygon(walk) if len(walk) > 2 else Polygon()


def _met(made, shapes, at, projection):
    met = []
    for f, shape in enumerate(shapes):
        n = made.planes.normals[made.plane[f]]
        if abs(n[projection.depth]) > 1e-9 and shape.contains(Point(at)):
            depth = (made.planes.offsets[made.plane[f]] - n[list(projection.axes)] @ at) / n[projection.depth]
            met.append((-depth * projection.toward, f, n[projection.depth] * projection.toward > 0))
    return [(f, front) for _, f, front in sorted(met)]


def _draws(arranged, graph, sights, labels):
    """Conditions 1, 4 and 5 on every line of sight, and the line type of every drawn edge."""
    for edge, (left, right) in enumerate(sights):
        nearest = []
        for row in (left, right):
            faces = [(f, labels[f] == (ALONG if front else AGAINST)) for f, front in row if labels[f]]
            if len(faces) % 2 or any(toward != (k % 2 == 0) for k, (_, toward) in enumerate(faces)):
                return False
            nearest.append(arranged.fragments.plane[faces[0][0]] if faces else -1)
        if (nearest[0] == nearest[1]) != bool(graph.hidden[edge]):
            return False
        if graph.hidden[edge] and not _turns_behind(arranged, graph, edge, labels):
            return False
    return True


def _turns_behind(arranged, graph, edge, labels):
    """A dashed line stands for an edge: somewhere behind it faces of two planes, or more than one pair, meet."""
    made = arranged.fragments
    a, b = graph.positions[graph.edges[edge]]
    middle = a + 0.4731 * (b - a)
    for e, ends in enumerate(made.wire.vertices[made.wire.edges]):
        p, q = ends[:, graph.projection.axes]
        if np.allclose(p, q) or made.is_cut[e]:
            continue
        share = (middle - p) @ (q - p) / ((q - p) @ (q - p))
        if not 0 < share < 1 or np.linalg.norm(p + share * (q - p) - middle) > 1e-6:
            continue
        present = [f for use, edge_of in enumerate(made.use_edge) if edge_of == e for f in made.region[use] if f >= 0]
        planes = [made.plane[f] for f in present if labels[f]]
        if len(planes) > 2 or len(set(planes)) > 1:
            return True
    return False
