"""Control nets of all polynomial B-spline faces of a shape, fetched from the kernel once for all who need them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.Geom import Geom_BSplineSurface
from OCP.TopoDS import TopoDS_Face

from brep_export.curves import full_knots
from brep_export.occ_arrays import numbers_from_kernel, point_grid_from_kernel

__all__ = ["FaceNets", "NetGroup", "face_nets"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_Key = tuple[int, int, bytes, bytes]


@dataclass(frozen=True, eq=False)
class NetGroup:
    """Faces whose surfaces are polynomial and clamped, over the same knots.

    faces    (n,) their numbers, growing
    degrees, knots  in u and in v, the knots at full multiplicity
    nets     (n, nu, nv, 3)
    """

    faces: Ints
    degrees: tuple[int, int]
    knots: tuple[Floats, Floats]
    nets: Floats


@dataclass(frozen=True, eq=False)
class FaceNets:
    """What was fetched of a row of faces, in groups; faces on other surfaces are in none."""

    n_faces: int
    groups: tuple[NetGroup, ...]

    def grouped(self) -> NDArray[np.bool_]:
        """(n_faces,) whether a face is in a group."""
        found = np.zeros(self.n_faces, dtype=bool)
        for group in self.groups:
            found[group.faces] = True
        return found

    def part(self, first: int, last: int) -> "FaceNets":
        """Those of the faces first to last, without that one, numbered from 0."""
        groups = []
        for group in self.groups:
            rows = slice(*np.searchsorted(group.faces, [first, last]).tolist())
            if rows.start < rows.stop:
                groups.append(NetGroup(group.faces[rows] - first, group.degrees, group.knots, group.nets[rows]))
        return FaceNets(last - first, tuple(groups))


def face_nets(faces: Sequence[TopoDS_Face]) -> FaceNets:
    """The control nets of the faces, whole or trimmed, where these are plain B-splines."""
    rows: dict[_Key, list[int]] = {}
    nets: dict[_Key, list[Floats]] = {}
    for number, face in enumerate(faces):
        surface = BRep_Tool.Surface_s(face)
        if not isinstance(surface, Geom_BSplineSurface):
            continue
        key = _key(surface)
        if key is not None:
            rows.setdefault(key, []).append(number)
            nets.setdefault(key, []).append(point_grid_from_kernel(surface.Poles()))
    groups = [
        NetGroup(np.array(rows[k]), k[:2], (np.frombuffer(k[2]), np.frombuffer(k[3])), np.array(nets.pop(k)))
        for k in rows
    ]
    return FaceNets(len(faces), tuple(groups))


def _key(surface: Geom_BSplineSurface) -> _Key | None:
    """Degrees and knots; None for a surface that is rational, periodic or not clamped."""
    if surface.IsURational() or surface.IsVRational() or surface.IsUPeriodic() or surface.IsVPeriodic():
        return None
    p, q = surface.UDegree(), surface.VDegree()
    if surface.NbUPoles() == p + 1 and surface.NbVPoles() == q + 1 and surface.NbUKnots() == surface.NbVKnots() == 2:
        u0, u1, v0, v1 = surface.Bounds()  # a Bezier patch: nothing to ask beyond its domain
        return p, q, np.repeat([u0, u1], p + 1).tobytes(), np.repeat([v0, v1], q + 1).tobytes()
    if min(surface.UMultiplicity(1), surface.UMultiplicity(surface.NbUKnots())) <= p:
        return None
    if min(surface.VMultiplicity(1), surface.VMultiplicity(surface.NbVKnots())) <= q:
        return None
    u = full_knots(numbers_from_kernel(surface.UKnots()), numbers_from_kernel(surface.UMultiplicities()))
    v = full_knots(numbers_from_kernel(surface.VKnots()), numbers_from_kernel(surface.VMultiplicities()))
    return p, q, u.tobytes(), v.tobytes()
