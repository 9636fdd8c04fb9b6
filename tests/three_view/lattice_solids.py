"""Solids of unit cubes on a small lattice: drawn from their cubes alone, so that counts by brute force are known."""

from itertools import product

import numpy as np

from recon.geometry.views import PROJECTIONS, DrawnView, ThreeViews

PITCH = 10.0


def lattice_drawing(cubes):
    """Front, top and side views of a boolean (nx, ny, nz) array of cubes.

    A unit edge of the lattice is an edge of the solid unless the four cubes around it are alike in pairs. In a view it
    is drawn through when the first cubes met on its two sides are not equally deep.
    """
    return ThreeViews(*(_view(cubes, projection) for projection in PROJECTIONS))


def _view(cubes, projection):
    u, v = projection.axes
    turned = np.transpose(cubes, (u, v, projection.depth))
    if projection.toward < 0:
        turned = turned[:, :, ::-1]
    padded = np.pad(turned, 1)
    depth = np.where(padded.any(axis=2), padded.shape[2] - np.argmax(padded[:, :, ::-1], axis=2), 0)
    segments, hidden = [], []
    for flip in (False, True):
        field, seen = (padded.transpose(1, 0, 2), depth.T) if flip else (padded, depth)
        for i, j in product(range(field.shape[0] - 1), range(1, field.shape[1] - 1)):
            a, b = field[i, j], field[i + 1, j]
            corner = _turns(a, b)
            if corner:
                ends = np.array([[i, j - 1], [i, j]]) * PITCH
                segments.append(ends[:, ::-1] if flip else ends)
                hidden.append(seen[i, j] == seen[i + 1, j])
    return DrawnView(np.array(segments), np.array(hidden))


def _turns(a, b):
    """Whether an edge of the solid runs between two neighbouring rows of cubes, at any depth."""
    for k in range(len(a) - 1):
        around = [a[k], a[k + 1], b[k + 1], b[k]]
        flat = (around[0] == around[1] and around[2] == around[3]) or (
            around[1] == around[2] and around[3] == around[0]
        )
        if not flat:
            return True
    return False


def signature(cubes):
    """What the drawing of a solid shows, as something that can be compared."""
    found = []
    for projection, view in lattice_drawing(cubes):
        rows = {(*segment.ravel().tolist(), bool(dashed)) for segment, dashed in zip(view.segments, view.hidden)}
        found.append((projection.name, frozenset(rows)))
    return tuple(found)


def lattice_solids(shape):
    """Every non-empty set of cubes of a lattice."""
    n = int(np.prod(shape))
    for mask in range(1, 2**n):
        yield np.array([mask >> k & 1 for k in range(n)], dtype=bool).reshape(shape)


def filled_cubes(solid, shape):
    """The set of cubes that a polyhedron fills: a point inside each, by counting faces above it."""
    cubes = np.zeros(shape, dtype=bool)
    for i, j, k in product(*map(range, shape)):
        x, y, z = (np.array([i, j, k]) + 0.5) * PITCH
        cubes[i, j, k] = sum(_above(solid, face, (x, y, z)) for face in solid.faces) % 2 == 1
    return cubes


def _above(solid, face, point):
    x, y, z = point
    crossings = 0
    for loop in face.loops:
        ring = solid.vertices[list(loop)]
        if np.ptp(ring[:, 2]) > 0 or ring[0, 2] < z:
            return False
        for (ax, ay, _), (bx, by, _) in zip(ring, np.roll(ring, -1, axis=0)):
            if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
                crossings += 1
    return crossings % 2 == 1
