"""Faces whose coarse triangles cut each other, looked at alone with fine ones: where many faces have small ones."""

from collections.abc import Sequence

import numpy as np
from OCP.BRep import BRep_Builder
from OCP.TopoDS import TopoDS_Compound, TopoDS_Face

from brep_export.triangulation import ShapeTriangulation, triangulate
from recon.geometry.promises import cutting_pairs

__all__ = ["cut_faces_still_cut"]

FINER = 16, 128  # times as fine as the triangles that cut
ANGLE = 0.1


def cut_faces_still_cut(coarse: ShapeTriangulation, faces: Sequence[TopoDS_Face], deflection: float) -> bool:
    """Whether the faces of triangles that cut each other do so with fine triangles too.

    coarse  triangles of the shape; `triangle_face` counts the faces as given, which are in the order of a walk
    """
    pairs = cutting_pairs(coarse.mesh)
    numbers = np.unique(coarse.triangle_face[pairs])
    alone = TopoDS_Compound()
    builder = BRep_Builder()
    builder.MakeCompound(alone)
    for number in numbers.tolist():
        builder.Add(alone, faces[number])
    return all(len(cutting_pairs(triangulate(alone, deflection / times, angle=ANGLE).mesh)) > 0 for times in FINER)
