"""Faces whose coarse triangles cut each other, looked at alone with fine ones: where many faces have small ones."""

from collections.abc import Sequence

import numpy as np
from OCP.BRep import BRep_Builder
from OCP.TopoDS import TopoDS_Compound, TopoDS_Face

from brep_export.triangulation import ShapeTriangulation, triangulate
from recon.geometry.promises import cutting_pairs

__all__ = ["cut_faces_still_cut"]

FINER = 4, 16, 64, 256  # times as fine as the triangles that cut
MOST = 600_000  # triangles that are looked at; what still cuts then cuts
GROWTH = 4  # times as many triangles where they are four times as fine


def cut_faces_still_cut(coarse: ShapeTriangulation, faces: Sequence[TopoDS_Face], deflection: float) -> bool:
    """Whether faces whose triangles cut each other, or themselves, do so with finer and finer triangles too.

    At every fineness the chord of a curved edge may pass an inner node of a narrow face; what cuts in truth cuts at all
    of them, so that only those faces are looked at again that still cut. The angle stays: a smaller one brings nodes
    inside, nearer to the edges than their chords are.

    coarse  triangles of the shape; `triangle_face` counts the faces as given, which are in the order of a walk
    """
    triangles, numbers = coarse, list(range(len(faces)))
    for times in FINER:
        cutting = _cutting(triangles)
        if not cutting or GROWTH * int(np.isin(triangles.triangle_face, cutting).sum()) > MOST:
            return bool(cutting)
        numbers = [numbers[number] for number in cutting]
        triangles = triangulate(_alone([faces[number] for number in numbers]), deflection / times)
    return bool(_cutting(triangles))


def _cutting(triangles: ShapeTriangulation) -> list[int]:
    """Faces with triangles that cut others."""
    found: list[int] = np.unique(triangles.triangle_face[cutting_pairs(triangles.mesh)]).tolist()
    return found


def _alone(faces: Sequence[TopoDS_Face]) -> TopoDS_Compound:
    compound, builder = TopoDS_Compound(), BRep_Builder()
    builder.MakeCompound(compound)
    for face in faces:
        builder.Add(compound, face)
    return compound
