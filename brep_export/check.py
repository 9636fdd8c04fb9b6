"""The gate: whether a kernel shape is what it claims to be, line by line, and where it is not.

The kernel's own check alone calls a box turned inside out valid, and a solid that cuts itself, so a solid passes when
all of these hold.  A line that rests on an earlier one is drawn only where the earlier one passed: an effect is not
reported beside its cause.

    1  every shell closed, in one piece, and marked so      shell-open  shell-in-pieces  shell-flag  no-solid  no-shell
    2  every edge used twice, in opposite directions        edge-overused  face-flipped  free-edge
    3  the kernel's check; tolerance >= gap; <= asked for;  kernel-invalid  edge-gap  vertex-gap  tolerance
       smooth edges smooth to the angle asked for           edge-angle
    4  triangles: all faces, closed, oriented, no cuts      face-without-triangles  mesh-...  self-intersection
    5  volume positive, and the triangles agree             inside-out  volume-mismatch
    6  the point at infinity is outside                     infinity-inside
    7  read back from the file, the same                    read-back-...

Shells and faces that are meant to be open pass with what applies: 2 (but for free edges), 3, 4 (but for closing), 7.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees, dist

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepCheck import BRepCheck_Status
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS, TopoDS_Face, TopoDS_Shape

from brep_export.advance_copy import AdvanceCopy
from brep_export.check_geometry import (
    angle_defects,
    edge_angles,
    edge_gaps,
    gap_defects,
    kernel_defects,
    max_tolerance,
    tolerance_defects,
)
from brep_export.check_topology import (
    EdgeUses,
    ShapeKind,
    closing_defects,
    edge_polyline,
    edge_use_defects,
    sub_shapes,
)
from brep_export.close_look import cut_faces_still_cut
from brep_export.infinity import infinity_is_outside
from brep_export.kernel_settings import KERNEL_FAILURES
from brep_export.measures import ShapeMeasures, measure
from brep_export.read_back import ReadBack
from brep_export.survey import Survey, survey
from brep_export.triangulation import ShapeTriangulation, triangulate
from recon.errors import GateFailed
from recon.geometry.mesh import TriangleMesh
from recon.geometry.promises import Defect, triangle_mesh_defects
from recon.tolerance import Tolerance

__all__ = ["CheckReport", "ShapeKind", "check"]

Point = tuple[float, float, float]

# what each line of the gate says of a shape that passes it, and the beginnings of the codes of its defects
LINES = (
    ("every shell is closed and in one piece", ("shell-", "no-", "not-a", "beside-solids", "kernel-failure")),
    ("every edge is used twice, in opposite directions", ("edge-overused", "face-flipped", "free-edge")),
    (
        "the kernel's check passes, tolerances cover the gaps, and smooth edges are smooth",
        ("kernel-invalid", "edge-gap", "vertex-gap", "toler", "edge-angle"),
    ),
    ("the triangles close and do not cut each other", ("face-without-triangles", "mesh-", "self-intersection")),
    ("the volume is positive, and the triangles agree", ("inside-out", "volume-mismatch")),
    ("the point at infinity is outside", ("infinity-",)),
    ("the file reads back as what was written", ("read-back-",)),
)


@dataclass(frozen=True, eq=False)
class CheckReport:
    """What the gate found.

    defects        every broken line, each with its place
    max_gap        largest distance between an edge and its faces or vertices
    max_edge_angle  radians, between tangent planes along inner edges, sharp ones too
    max_smooth_edge_angle  the same along those that the shape says are smooth; None where it says so of none
    triangulation  the triangles of the shape, for pictures and mesh files
    seen           what was fetched of the shape, for the writers
    copy           a STEP file that was written ahead and is being read, for the writers
    free_edges     polylines of the edges with one face
    """

    expected: ShapeKind
    measures: ShapeMeasures | None
    defects: tuple[Defect, ...]
    valid: bool = False
    closed: bool = False
    max_tolerance: float = 0.0
    max_gap: float = 0.0
    max_edge_angle: float = 0.0
    max_smooth_edge_angle: float | None = None
    self_intersections: int = 0
    triangulation: TriangleMesh | None = None
    free_edges: tuple[tuple[Point, ...], ...] = ()
    read_back: ReadBack | None = None
    seen: Survey | None = None
    copy: AdvanceCopy | None = None

    @property
    def passed(self) -> bool:
        """Whether no line is broken."""
        return not self.defects

    @property
    def verdict(self) -> str:
        """`pass` or `refused`."""
        return "pass" if self.passed else "refused"

    def require(self) -> "CheckReport":
        """The report itself; raises GateFailed with the defects when there are any."""
        if self.defects:
            raise GateFailed(self.defects)
        return self

    def triangles(self) -> TriangleMesh:
        """The triangulation of a shape that has one; raises GateFailed where the shape has no faces."""
        if self.triangulation is None:
            raise GateFailed(self.defects)
        return self.triangulation

    def with_read_back(self, read_back: ReadBack) -> "CheckReport":
        """The report with line 7 added."""
        return replace(self, read_back=read_back, defects=self.defects + read_back.defects)

    def as_json(self) -> dict[str, object]:
        """The `kernel` object of the command line's JSON."""
        m = self.measures
        return {
            "type": str(m.kind) if m else None,
            "valid": self.valid,
            "closed": self.closed,
            "solids": m.solids if m else 0,
            "shells": m.shells if m else 0,
            "faces": m.faces if m else 0,
            "edges": m.edges if m else 0,
            "free_edges": len(self.free_edges),
            "volume": m.volume if m else None,
            "area": m.area if m else None,
            "bounding_box": [list(corner) for corner in m.bounding_box] if m else None,
            "max_tolerance": self.max_tolerance,
            "max_gap": self.max_gap,
            "max_edge_angle_deg": degrees(self.max_edge_angle),
            "max_smooth_edge_angle_deg": None
            if self.max_smooth_edge_angle is None
            else degrees(self.max_smooth_edge_angle),
            "self_intersections": self.self_intersections,
            "read_back": self.read_back.as_json() if self.read_back else None,
            "gate": [{"line": line, "passed": passed} for line, passed in self.lines()],
        }

    def lines(self) -> tuple[tuple[str, bool | None], ...]:
        """Every line of the gate and whether it passed; None for the last one where no file was read back."""
        codes = [defect.code for defect in self.defects]
        judged = [(line, not any(code.startswith(begin) for code in codes)) for line, begin in LINES]
        return (*judged[:-1], (LINES[-1][0], judged[-1][1] if self.read_back else None))


def check(
    shape: TopoDS_Shape,
    tolerance: Tolerance,
    *,
    expect: ShapeKind = ShapeKind.SOLID,
    deflection: float | None = None,
    copy: AdvanceCopy | None = None,
) -> CheckReport:
    """Draw every line of the gate that applies; never raises on a bad shape, and never changes it.

    expect      SOLID: one or several solids and nothing else; SHELL, FACE, EDGE: one, open or closed; COMPOUND: any
                mixture with faces
    deflection  length, how far triangles may stay from the faces; a thousandth of the diagonal when None
    copy        of this shape, where one was written ahead: what it saw and measured is not asked for again
    """
    if shape.IsNull():
        return CheckReport(expect, None, (Defect("no-shape", "there is no shape"),))
    try:
        return _drawn(shape, tolerance, expect, deflection=deflection, copy=copy)
    except KERNEL_FAILURES as failure:
        sentence = f"the kernel gave up looking at the shape ({type(failure).__name__})"
        return CheckReport(expect, None, (Defect("kernel-failure", sentence),))


def _drawn(
    shape: TopoDS_Shape,
    tolerance: Tolerance,
    expect: ShapeKind,
    *,
    deflection: float | None,
    copy: AdvanceCopy | None,
) -> CheckReport:
    seen = copy.seen if copy else survey(shape)
    uses = seen.uses
    if not uses.faces and expect is ShapeKind.EDGE:
        return _drawn_edge(shape, tolerance)
    if not uses.faces:
        return CheckReport(expect, None, (Defect("no-face", "the shape has no faces"),))
    measures = copy.measures if copy else measure(shape, seen=seen)
    closing = closing_defects(uses)
    structure = closing + edge_use_defects(uses) + ([] if closing else _free_edge_defects(uses))
    gaps, angles = edge_gaps(seen), edge_angles(seen)
    fit = gap_defects(uses, gaps) + tolerance_defects(uses, shape, tolerance.fit)
    valid, invalid = kernel_defects(shape, _explained(structure + fit))
    deflection = deflection or max(1e-3 * dist(*measures.bounding_box), 1e-9)
    triangles, mesh_defects, cuts = _triangulation_defects(shape, seen, deflection, closes=not structure)
    defects = _kind_defects(uses, expect) + structure + fit + invalid + mesh_defects
    defects += angle_defects(uses, angles, tolerance.angle)
    if not structure and not triangles.missing and uses.is_solid.any():
        defects += _volume_defects(measures, triangles, uses, deflection)
    free = uses.free_edges()
    return CheckReport(
        expect,
        measures,
        tuple(defects),
        valid=valid,
        closed=not free and not structure,
        max_tolerance=max_tolerance(shape),
        max_gap=gaps.largest(),
        max_edge_angle=angles.overall(),
        max_smooth_edge_angle=angles.over_smooth_edges(),
        self_intersections=cuts,
        triangulation=triangles.mesh,
        free_edges=tuple(tuple(edge_polyline(edge)) for edge in free),
        seen=seen,
        copy=copy,
    )


def _drawn_edge(shape: TopoDS_Shape, tolerance: Tolerance) -> CheckReport:
    """What applies to a curve alone: the kernel's check and the tolerances."""
    measures = measure(shape)
    if measures.kind is not ShapeKind.EDGE:
        return CheckReport(ShapeKind.EDGE, measures, (Defect("not-an-edge", "the shape is not one edge"),))
    valid, invalid = kernel_defects(shape)
    widest = max_tolerance(shape)
    wide = Defect("tolerance", "a tolerance above the one asked for", None, widest, tolerance.fit)
    defects = invalid + ([wide] if widest > tolerance.fit else [])
    closed = bool(BRep_Tool.IsClosed_s(shape))
    return CheckReport(ShapeKind.EDGE, measures, tuple(defects), valid=valid, closed=closed, max_tolerance=widest)


def _kind_defects(uses: EdgeUses, expect: ShapeKind) -> list[Defect]:
    solids, others = int(uses.is_solid.sum()), int((~uses.is_solid).sum())
    if expect is ShapeKind.SOLID and not solids:
        return [Defect("no-solid", "the shape has no solid", None, 0.0, 1.0)]
    if expect is ShapeKind.SOLID and others:
        return [Defect("beside-solids", "there are faces that belong to no solid", None, float(others), 0.0)]
    if expect is ShapeKind.SHELL and [*uses.body_kinds] != [ShapeKind.SHELL]:
        return [Defect("not-a-shell", "the shape is not one shell")]
    if expect is ShapeKind.FACE and len(uses.faces) != 1:
        return [Defect("not-a-face", "the shape is not one face", None, float(len(uses.faces)), 1.0)]
    return []


def _free_edge_defects(uses: EdgeUses) -> list[Defect]:
    """Free edges of solids whose shells the kernel calls closed all the same."""
    body, edge, count, _ = uses.counts()
    free = edge[(count == 1) & uses.is_solid[body]]
    if not len(free):
        return []
    place = edge_polyline(uses.edges[free[0]])[0]
    return [Defect("free-edge", "edges of a solid with one face only", place, float(len(free)), 0.0)]


def _explained(defects: list[Defect]) -> set[BRepCheck_Status]:
    """What the kernel's check may say of defects that were found already."""
    return set().union(*(_EXPLAINS.get(defect.code, set()) for defect in defects)) if defects else set()


_S = BRepCheck_Status
_OPEN = {
    _S.BRepCheck_NotClosed,
    _S.BRepCheck_FreeEdge,
    _S.BRepCheck_BadOrientationOfSubshape,
    _S.BRepCheck_NotConnected,
}
_OPEN |= {_S.BRepCheck_InvalidMultiConnexity, _S.BRepCheck_UnorientableShape, _S.BRepCheck_InvalidImbricationOfShells}
_OFF = {_S.BRepCheck_InvalidCurveOnSurface, _S.BRepCheck_InvalidSameParameterFlag, _S.BRepCheck_InvalidToleranceValue}
_OFF |= {_S.BRepCheck_UnorientableShape}  # said of a face one of whose edges failed
_OFF |= {_S.BRepCheck_InvalidPointOnCurve, _S.BRepCheck_InvalidPointOnCurveOnSurface, _S.BRepCheck_InvalidSameRangeFlag}
_EXPLAINS = dict.fromkeys(("shell-open", "shell-in-pieces", "edge-overused", "face-flipped", "free-edge"), _OPEN)
_EXPLAINS |= dict.fromkeys(("edge-gap", "vertex-gap", "tolerance"), _OFF)


def _triangulation_defects(
    shape: TopoDS_Shape, seen: Survey, deflection: float, *, closes: bool
) -> tuple[ShapeTriangulation, list[Defect], int]:
    """Line 4.  Coarse triangles of a thin wall may cut where the faces do not, so these are looked at again closer."""
    uses, triangles = seen.uses, triangulate(shape, deflection, planes=seen.planes)
    defects = _mesh_defects(triangles, uses, closes=closes)
    if _cut(defects) and len(triangles.triangle_face) <= REFINED_AT_MOST:
        finer = triangulate(shape, deflection / 4, angle=0.2)
        finer_defects = _mesh_defects(finer, uses, closes=closes)
        if not _cut(finer_defects):
            triangles, defects = finer, finer_defects
    if _cut(defects) and not cut_faces_still_cut(triangles, _faces(shape), deflection):
        defects = [d for d in defects if d.code not in _LOOKED_AT]
    cuts = sum(int(d.measured or 0) for d in defects if d.code == "self-intersection")
    return triangles, defects, cuts


_LOOKED_AT = "self-intersection", "mesh-edge-overused"  # what coarse triangles may say of faces that are sound


def _cut(defects: Sequence[Defect]) -> bool:
    return any(d.code in _LOOKED_AT for d in defects)


def _faces(shape: TopoDS_Shape) -> list[TopoDS_Face]:
    return [TopoDS.Face_s(face) for face in sub_shapes(shape, TopAbs_ShapeEnum.TopAbs_FACE)]


def _mesh_defects(triangles: ShapeTriangulation, uses: EdgeUses, *, closes: bool) -> list[Defect]:
    if triangles.missing:
        what = "faces that cannot be triangulated"
        return [
            Defect("face-without-triangles", what, _place_of(uses, triangles.missing[0]), len(triangles.missing), 0.0)
        ]
    found: dict[str, Defect] = {}
    for body, solid in enumerate(uses.is_solid):
        rows = np.flatnonzero(uses.face_body[triangles.triangle_face] == body)
        for defect in triangle_mesh_defects(triangles.mesh.part(rows), closed=bool(solid)):
            if closes or defect.code == "mesh-cuts-itself":
                found.setdefault(defect.code, defect)
    cut = found.pop("mesh-cuts-itself", None)
    return [*found.values()] + ([replace(cut, code="self-intersection", what=_CUTS)] if cut else [])


REFINED_AT_MOST = 50_000  # triangles up to which all faces are cut into finer ones first

_CUTS = "faces that cut themselves or each other, in pairs of triangles"


def _place_of(uses: EdgeUses, face: int) -> Point | None:
    rows: NDArray[np.int64] = np.flatnonzero(uses.face == face)
    return edge_polyline(uses.use_edges[rows[0]])[0] if len(rows) else None


def _volume_defects(
    measures: ShapeMeasures, triangles: ShapeTriangulation, uses: EdgeUses, deflection: float
) -> list[Defect]:
    """Lines 5 and 6; that infinity is inside follows from a negative volume, so it is asked of positive ones only."""
    if min(measures.solid_volumes) <= 0.0:
        sentence = "the volume of a solid is negative: its faces look inward"
        return [Defect("inside-out", sentence, None, min(measures.solid_volumes), 0.0)]
    solids = [body for body, is_solid in zip(uses.bodies, uses.is_solid) if is_solid]
    return _volume_mismatch(measures, triangles, uses, deflection) + _infinity_defects(solids)


def _volume_mismatch(
    measures: ShapeMeasures, triangles: ShapeTriangulation, uses: EdgeUses, deflection: float
) -> list[Defect]:
    body_of_triangle = uses.face_body[triangles.triangle_face]
    for body, volume in enumerate(measures.solid_volumes):
        mesh = triangles.mesh.part(np.flatnonzero(body_of_triangle == body))
        area = float(np.linalg.norm(mesh.area_vectors(), axis=1).sum())
        between, allowed = abs(volume - mesh.volume()), area * deflection + 2e-3 * volume
        if between > allowed:
            sentence = "the kernel's volume and that of the triangles disagree"
            return [Defect("volume-mismatch", sentence, None, between, allowed)]
    return []


def _infinity_defects(solids: list[TopoDS_Shape]) -> list[Defect]:
    for solid in solids:
        if not infinity_is_outside(solid):
            return [Defect("infinity-inside", "the point at infinity is not outside the solid")]
    return []
