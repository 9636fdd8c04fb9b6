"""A shape as the gate and the writers look at it, fetched from the kernel once.

Calls into the kernel cost more than what they bring, where a shape has tens of thousands of faces: so uses of edges,
control nets, straight pcurves and planar faces are fetched here, and all that is measured from them is measured in
arrays.

          v ^  e2 <--- s2
            |  |        ^         a face is whole when its uses run once around the border of the parameter rectangle;
            |  v        |         a collapsed side has no use, and is bridged
            | (bridge)  e1
            |           |
            +--s0--->--e0--> u
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.Geom2d import Geom2d_BSplineCurve, Geom2d_Curve, Geom2d_Line
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopoDS import TopoDS_Shape

from brep_export.check_topology import EdgeUses, edge_uses
from brep_export.face_nets import FaceNets, NetGroup, face_nets
from brep_export.flat_faces import FlatFaces, flat_faces
from brep_export.occ_arrays import points_from_kernel

__all__ = ["Survey", "survey"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

ON_BORDER = 1e-9  # of the parameter rectangle
NEAR_BORDER = 1e-7  # the same where the kernel has projected a side on its surface
NOWHERE = (np.nan,) * 4
_REVERSED = TopAbs_Orientation.TopAbs_REVERSED


@dataclass(frozen=True, eq=False)
class Survey:
    """Uses of edges of a shape, control nets of its faces, straight pcurves, and planar faces.

    ends      (M, 2, 2) parameter pairs of every use at the two ends of its edge's own range; NaN where its face is in
              no group of nets, or its pcurve neither straight nor along the border
    straight  (M,) whether the pcurve is a line, run through at even speed
    planes    its planar faces between straight edges
    """

    uses: EdgeUses
    nets: FaceNets
    planes: FlatFaces
    ends: Floats
    straight: Flags

    def whole(self) -> Flags:
        """(F,) whether a face with a net runs once around the border of its parameter rectangle, along lines."""
        found = np.zeros(self.nets.n_faces, dtype=bool)
        order, first = self._in_face_order()
        for group in self.nets.groups:
            counts = np.diff(first)[group.faces]
            for count in np.unique(counts[counts > 1]).tolist():
                faces = group.faces[counts == count]
                rows = order[first[faces][:, None] + np.arange(count)]
                # a face that is turned over has its uses in the order of its surface, or the other way once it was read
                found[faces] = self._goes_around(rows, group) | self._goes_around(rows[:, ::-1], group, joined=True)
        return found

    def _in_face_order(self) -> tuple[Ints, Ints]:
        """Uses sorted by their face, and where those of each face begin."""
        order = np.argsort(self.uses.face, kind="stable")
        return order, np.searchsorted(self.uses.face[order], np.arange(self.nets.n_faces + 1))

    def _goes_around(self, rows: Ints, group: NetGroup, *, joined: bool = False) -> Flags:
        """(n,) of the faces with the uses (n, k).

        joined  whether every use has to begin where the one before ends: else they may be a collapsed side apart
        """
        low = np.array([knots[0] for knots in group.knots])
        high = np.array([knots[-1] for knots in group.knots])
        ends = (self.ends[rows] - low) / (high - low)
        turned = [self.uses.faces[f].Orientation() == _REVERSED for f in self.uses.face[rows[:, 0]].tolist()]
        forward = self.uses.forward[rows] != np.array(turned)[:, None]  # as in the surface's own face
        ends = np.where(forward[..., None, None], ends, ends[:, :, ::-1])
        corners = ends.reshape(len(rows), -1, 2)
        following = np.roll(corners, -1, axis=1)
        # one coordinate stays, at 0 or at 1; so do corners that follow themselves
        same = np.abs(corners - following) < NEAR_BORDER
        at_border = (np.abs(corners) < ON_BORDER) | (np.abs(corners - 1.0) < ON_BORDER)
        along = (same & at_border).any(axis=2).all(axis=1)
        if joined:
            along &= same[:, 1::2].all(axis=(1, 2))
        x, y = np.moveaxis(corners, -1, 0)
        to_x, to_y = np.moveaxis(following, -1, 0)
        area = 0.5 * (x * to_y - y * to_x).sum(axis=1)
        return np.asarray(along & (np.abs(np.abs(area) - 1.0) < NEAR_BORDER))


def survey(shape: TopoDS_Shape) -> Survey:
    """Walk through a shape once; nothing is measured yet."""
    uses = edge_uses(shape)
    nets = face_nets(uses.faces)
    grouped = nets.grouped()
    ends: list[tuple[float, ...]] = []
    straight: list[bool] = []
    for edge, number in zip(uses.use_edges, uses.face.tolist()):
        face = uses.faces[number]
        pcurve = BRep_Tool.CurveOnSurface_s(edge, face, 0.0, 0.0) if grouped[number] else None
        straight.append(isinstance(pcurve, Geom2d_Line))
        if isinstance(pcurve, Geom2d_Line):
            first, last = BRep_Tool.Range_s(edge, face)
            (u, v), (to_u, to_v) = pcurve.Location().Coord(), pcurve.Direction().Coord()
            ends.append((u + first * to_u, v + first * to_v, u + last * to_u, v + last * to_v))
        else:
            ends.append(_along_border(pcurve, BRep_Tool.Surface_s(face).Bounds()) if pcurve is not None else NOWHERE)
    return Survey(uses, nets, flat_faces(uses), np.array(ends).reshape(-1, 2, 2), np.array(straight, dtype=bool))


def _along_border(curve: Geom2d_Curve, bounds: tuple[float, float, float, float]) -> tuple[float, ...]:
    """Ends of a spline that lies on one side of the rectangle, as files give a side that ends in a collapsed one."""
    if not isinstance(curve, Geom2d_BSplineCurve):
        return NOWHERE
    poles = points_from_kernel(curve.Poles())
    ends = poles[[0, -1]]
    for side, value in enumerate(bounds):
        axis, size = side // 2, bounds[side // 2 * 2 + 1] - bounds[side // 2 * 2]
        if (np.abs(poles[:, axis] - value) < NEAR_BORDER * size).all():
            ends[:, axis] = value
    return tuple(ends.ravel().tolist())
