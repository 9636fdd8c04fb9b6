"""The box around a hole: a square on a circle through three points of the wall, extruded both ways along its normal.

             normal                 seen along the normal
               ^                    +-----------+  high
        +------|------+             |  .-===-.  |           the circle through p1, p2, p3 touches
       /|      |     /|             | p3  _   \\ |           the four sides; the hole lies inside it
      +-------------+ |             |/   |_\\   ||
      | | __.---.__ | |    wall     ||    \\|  p1|           normal: (p1 - p2) x (p3 - p2), turned away
    __|-+--(hole)---+-|__           | \\       / |           from the vessel's inside
      |/            |/              |  'p2--'"  |
      +-------------+          low  +-----------+

Where the circle is wider than the vessel, such a square has sides that miss the wall; a box in the plane of the hole's
edge, narrowed to that edge and a margin, takes its place.

Paper  [kinoshita], section 3.2 steps 1 and 5.
"""

from dataclasses import dataclass, replace
from itertools import combinations
from math import cos, radians, sin

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.hole_patch.surroundings import Wall
from recon.numerics.halfedges import vertex_normals
from recon.numerics.planes import circle_through, enclosing_circle, fit_plane

__all__ = ["Box", "find_picks", "box_through", "edge_box", "outward", "surrounds"]

Floats = NDArray[np.float64]
SAMPLE_RADIUS = 2.0
MARGIN = 0.1
RING_DIRECTIONS = 24
LEAST_GAP, MOST_GAP = radians(75.0), radians(165.0)
FACING = 0.25


@dataclass(frozen=True, eq=False)
class Box:
    """A box in space.

    centre     (3,) on its axis, in millimetres
    axes       (3, 3) unit rows: along x, along y, the normal; right-handed
    low, high  (2,) the rectangle in (x, y), about the centre; a square when it comes from a circle
    reach      how far the box goes along its normal, both ways
    """

    centre: Floats
    axes: Floats
    low: Floats
    high: Floats
    reach: float

    def local(self, points: Floats) -> Floats:
        """(m, 3) coordinates (x, y, height) in the box's frame."""
        return (points - self.centre) @ self.axes.T

    def point(self, local: Floats) -> Floats:
        """(..., 3) points in space from (x, y, height); the inverse of `local`."""
        return self.centre + local @ self.axes

    def turned(self, angle: float) -> "Box":
        """The same rectangle, turned about the normal by an angle in radians."""
        x, y, normal = self.axes
        along = cos(angle) * x + sin(angle) * y
        return replace(self, axes=np.stack([along, np.cross(normal, along), normal]))

    def narrowed(self, edge: Floats, margin: float) -> "Box":
        """The box with its four sides moved in to `margin` from the points of the edge, never out."""
        flat = self.local(edge)[:, :2]
        low = np.maximum(self.low, flat.min(axis=0) - margin)
        return replace(self, low=low, high=np.minimum(self.high, flat.max(axis=0) + margin))


def find_picks(wall: Wall) -> Floats | None:
    """Three wall vertices (3, 3) whose circle surrounds the hole, or None where the wall has none.

    Of all triples near a circle somewhat larger than the smallest around the edge, and spread around it, the one whose
    plane is least tilted against the edge's own.
    Paper  [kinoshita], section 3.2 step 1, where a person picks them.
    """
    box = edge_box(wall)
    return _least_tilted(_ring_vertices(wall, box), wall.edge.points, box.axes[2])


def edge_box(wall: Wall) -> Box:
    """The box on a circle somewhat larger than the smallest around the edge, in the edge's least-squares plane."""
    centre, axes = fit_plane(wall.edge.points)
    axes = axes if axes[2] @ outward(wall) >= 0 else axes * np.array([[1.0], [-1.0], [-1.0]])
    middle, radius = enclosing_circle((wall.edge.points - centre) @ axes[:2].T)
    half = np.full(2, radius * (1.0 + MARGIN) + SAMPLE_RADIUS)
    return Box(centre + middle @ axes[:2], axes, -half, half, reach=float(half[0]))


def box_through(picks: Floats, wall: Wall) -> Box:
    """The paper's box on the circle through three points (3, 3); its x axis runs from the second pick to the first."""
    centres, radii, normals = circle_through(picks[:1], picks[1:2], picks[2:])
    normal = normals[0] if normals[0] @ outward(wall) >= 0 else -normals[0]
    along = picks[0] - picks[1]
    along /= np.linalg.norm(along)
    half = np.full(2, radii[0])
    return Box(centres[0], np.stack([along, np.cross(normal, along), normal]), -half, half, reach=float(radii[0]))


def outward(wall: Wall) -> Floats:
    """(3,) unit vector away from the vessel's inside: the area vector of the edge, which runs counter-clockwise."""
    edge = wall.edge.points - wall.edge.points.mean(axis=0)
    area = np.cross(edge, np.roll(edge, -1, axis=0)).sum(axis=0)
    return np.asarray(area / np.linalg.norm(area))


def surrounds(centre: Floats, normal: Floats, radius: float, points: Floats) -> bool:
    """Whether all points lie inside the cylinder on a circle."""
    offset = points - centre
    across = offset - np.outer(offset @ normal, normal)
    return bool((np.linalg.norm(across, axis=1) <= radius).all())


def _ring_vertices(wall: Wall, box: Box) -> Floats:
    """(k, 3) wall vertices near a box's circle, one for each of the evenly spread directions that has one."""
    local, radius = box.local(wall.plain.vertices), box.reach
    facing = vertex_normals(wall.plain.vertices, wall.plain.face_vertices) @ box.axes[2] > FACING
    kept = np.flatnonzero(facing & (np.abs(local[:, 2]) < radius))
    angles = np.linspace(0.0, 2.0 * np.pi, RING_DIRECTIONS, endpoint=False)
    if len(kept) == 0:
        return np.zeros((0, 3))
    away, nearest = cKDTree(local[kept, :2]).query(radius * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    found = away < np.pi * radius / RING_DIRECTIONS
    return np.asarray(wall.plain.vertices[kept[np.unique(nearest[found])]])


def _least_tilted(ring: Floats, edge: Floats, normal: Floats) -> Floats | None:
    """The triple of ring vertices, spread around, whose circle surrounds the edge and is least tilted."""
    if len(ring) < 3:
        return None
    triples = ring[np.array(list(combinations(range(len(ring)), 3)))]
    centres, radii, normals = circle_through(*triples.transpose(1, 0, 2))
    facing = normals @ normal
    order = np.argsort(-np.abs(facing))
    for i in order[np.isfinite(radii[order])]:
        if _is_spread(triples[i], centres[i], normals[i]) and surrounds(centres[i], normals[i], radii[i], edge):
            # Second and third change places where the circle ran clockwise as seen from outside.
            return np.asarray(triples[i] if facing[i] > 0 else triples[i][[0, 2, 1]])
    return None


def _is_spread(triple: Floats, centre: Floats, normal: Floats) -> bool:
    arms = triple - centre
    x, y = arms[0], np.cross(normal, arms[0])
    angles = np.sort(np.arctan2(arms @ y, arms @ x))
    gaps = np.diff(np.append(angles, angles[0] + 2 * np.pi))
    return bool(gaps.min() >= LEAST_GAP and gaps.max() <= MOST_GAP)
