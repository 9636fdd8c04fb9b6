"""Control nets of all polynomial B-spline faces of a shape, fetched from the kernel once for all who need them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.Geom import Geom_BSplineSurface
from OCP.TopoDS import TopoDS_Face

from brep_export.bulk_splines import SplineRecord, surface_records
from brep_export.curves import full_knots

__all__ = ["FaceNets", "NetGroup", "face_nets"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_Key = tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...], bytes]


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
    found = [(number, BRep_Tool.Surface_s(face)) for number, face in enumerate(faces)]
    splines = [(number, surface) for number, surface in found if isinstance(surface, Geom_BSplineSurface)]
    rows: dict[_Key, list[int]] = {}
    nets: dict[_Key, list[Floats]] = {}
    for (number, _), record in zip(splines, surface_records([surface for _, surface in splines])):
        if record is not None:
            key = record.degrees, record.counts, record.n_knots, record.tail
            rows.setdefault(key, []).append(number)
            nets.setdefault(key, []).append(record.poles)
    groups = [_group(key, rows[key], nets.pop(key)) for key in rows]
    return FaceNets(len(faces), tuple(group for group in groups if group is not None))


def _group(key: _Key, rows: list[int], nets: list[Floats]) -> NetGroup | None:
    """None where the surfaces are not clamped."""
    degrees, counts, n_knots, tail = key
    (u, repeat_u), (v, repeat_v) = SplineRecord(degrees, counts, n_knots, nets[0], tail).knots()
    if min(repeat_u[0], repeat_u[-1]) <= degrees[0] or min(repeat_v[0], repeat_v[-1]) <= degrees[1]:
        return None
    knots = full_knots(u, repeat_u), full_knots(v, repeat_v)
    return NetGroup(np.array(rows), (degrees[0], degrees[1]), knots, np.array(nets).reshape(-1, *counts, 3))
