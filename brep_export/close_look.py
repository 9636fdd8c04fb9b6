"""Faces whose coarse triangles cut each other, or crowd on an edge, looked at alone with fine ones.

That is where many faces have small ones. The kernel may also cover a corner of a narrow face twice.
"""

from collections.abc import Sequence

import numpy as np
from OCP.TopoDS import TopoDS_Face
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from brep_export.compounds import compound_of
from brep_export.triangulation import ShapeTriangulation, triangulate
from recon.geometry.promises import crowded_pairs, cutting_pairs

__all__ = ["cut_faces_still_cut"]

FINER = 4, 16, 64, 256  # times as fine as the triangles that cut
MOST = 600_000  # triangles that are looked at; what still cuts then cuts
GROWTH = 4  # times as many triangles where they are four times as fine


def cut_faces_still_cut(coarse: ShapeTriangulation, faces: Sequence[TopoDS_Face], deflection: float) -> bool:
    """Whether faces whose triangles cut each other, or themselves, do so with finer and finer triangles too.

    An edge with more than two triangles counts as a cut; with more than two faces it is one at every fineness.

    At every fineness the chord of a curved edge may pass an inner node of a narrow face; what cuts in truth cuts at all
    of them, so that only those faces are looked at again that still cut. The angle stays: a smaller one brings nodes
    inside, nearer to the edges than their chords are. Faces that cut each other are looked at as a group, one group
    after another: memory is that of the largest.

    coarse  triangles of the shape; `triangle_face` counts the faces as given, which are in the order of a walk
    """
    waiting = [(0, *group) for group in _groups(coarse)]
    while waiting:
        times, numbers, count = waiting.pop()
        if times == len(FINER) or GROWTH * count > MOST:
            return True
        triangles = triangulate(compound_of(faces[number] for number in numbers), deflection / FINER[times])
        waiting += [(times + 1, [numbers[number] for number in group], count) for group, count in _groups(triangles)]
    return False


def _groups(triangles: ShapeTriangulation) -> list[tuple[list[int], int]]:
    """Faces with triangles that cut each other, by what they cut, and how many triangles they have together."""
    pairs = triangles.triangle_face[np.vstack([cutting_pairs(triangles.mesh), crowded_pairs(triangles.mesh)])]
    cutting, place = np.unique(pairs, return_inverse=True)
    first, second = place.reshape(-1, 2).T
    n = len(cutting)
    n_groups, group = connected_components(
        coo_array((np.ones(len(first)), (first, second)), shape=(n, n)), directed=False
    )
    sizes = np.bincount(triangles.triangle_face, minlength=int(cutting.max(initial=0)) + 1)[cutting]
    return [(cutting[group == g].tolist(), int(sizes[group == g].sum())) for g in range(n_groups)]
