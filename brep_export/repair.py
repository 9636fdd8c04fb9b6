"""Mending a shape, only when asked, with a list of what was changed.

Nothing here is called by a builder, a reader, a writer or the gate.  Each step is tried in turn and listed only when
it made a difference; whether the result is sound is for the gate to say, not for this module.

    1  edges measured again          tolerances are raised to what is measured, never above the one asked for
    2  faces turned                  until neighbours run through their edges in opposite directions
    3  closed shells made solids     and solids turned so that their volume is positive
    4  shells marked as they are     closed or open
"""

from dataclasses import dataclass

from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
from OCP.BRepLib import BRepLib
from OCP.ShapeFix import ShapeFix_Shell
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS, TopoDS_Shape, TopoDS_Shell, TopoDS_Solid

from brep_export.check_geometry import edge_gaps
from brep_export.check_topology import sub_shapes
from brep_export.compounds import one_or_compound
from brep_export.survey import Survey, survey
from recon.tolerance import Tolerance

__all__ = ["Change", "repair"]

_SHELL, _SOLID, _FACE = TopAbs_ShapeEnum.TopAbs_SHELL, TopAbs_ShapeEnum.TopAbs_SOLID, TopAbs_ShapeEnum.TopAbs_FACE


@dataclass(frozen=True)
class Change:
    """One thing that was changed: a stable word, a sentence, and how often."""

    code: str
    what: str
    times: int

    def __str__(self) -> str:
        return f"{self.code}: {self.what} ({self.times})"


def repair(shape: TopoDS_Shape, tolerance: Tolerance) -> tuple[TopoDS_Shape, list[Change]]:
    """A mended copy of a shape and what was changed; the shape itself stays as it was.

    Promises  an empty list of changes when the gate's lines 1 to 3 found nothing to mend.
    """
    shape = BRepBuilderAPI_Copy(shape).Shape()
    changes = [_raise_tolerances(survey(shape), tolerance.fit)]
    shells = [TopoDS.Shell_s(shell) for shell in sub_shapes(shape, _SHELL)]
    turned, flipped = _turned(shells)
    changes.append(Change("face-turned", "shells some of whose faces were turned over", flipped))
    changes.append(_mark(turned))
    solids, made = _solids(shape, turned)
    changes += made
    loose = list(sub_shapes(shape, _FACE, _SHELL))
    changes = [change for change in changes if change.times]
    if not any(change.code in _REBUILDS for change in changes):
        return shape, changes
    return one_or_compound([*solids, *loose]), changes


_REBUILDS = ("face-turned", "solid-made", "solid-turned", "shell-marked")


def _raise_tolerances(seen: Survey, allowed: float) -> Change:
    """Tolerances that are smaller than the gap they should cover, where the gap is one that may be covered."""
    uses, gaps = seen.uses, edge_gaps(seen)
    builder, raised = BRep_Builder(), set()
    for edge, number, gap in zip(uses.use_edges, uses.edge.tolist(), gaps.on_faces.tolist()):
        if BRep_Tool.Tolerance_s(edge) * 1.001 < gap <= allowed and gap > 1e-7:
            builder.UpdateEdge(edge, gap)
            raised.add(number)
    for number, (edge, gap) in enumerate(zip(uses.edges, gaps.at_ends.tolist())):
        for vertex in sub_shapes(edge, TopAbs_ShapeEnum.TopAbs_VERTEX):
            vertex = TopoDS.Vertex_s(vertex)
            least = max(BRep_Tool.Tolerance_s(edge), gap if gap <= allowed else 0.0)
            if BRep_Tool.Tolerance_s(vertex) < least:
                builder.UpdateVertex(vertex, least)
                raised.add(number)
    return Change("tolerance-raised", "edges whose tolerance now covers their measured gap", len(raised))


def _turned(shells: list[TopoDS_Shell]) -> tuple[list[TopoDS_Shell], int]:
    turned, flipped = [], 0
    for shell in shells:
        fix = ShapeFix_Shell(shell)
        changed = fix.FixFaceOrientation(shell)
        parts = [TopoDS.Shell_s(part) for part in sub_shapes(fix.Shape(), _SHELL)] if changed else [shell]
        turned += parts
        flipped += bool(changed)
    return turned, flipped


def _mark(shells: list[TopoDS_Shell]) -> Change:
    wrong = [shell for shell in shells if shell.Closed() != BRep_Tool.IsClosed_s(shell)]
    for shell in wrong:
        shell.Closed(not shell.Closed())
    return Change("shell-marked", "shells marked as closed or open, as they are", len(wrong))


def _solids(shape: TopoDS_Shape, shells: list[TopoDS_Shell]) -> tuple[list[TopoDS_Shape], list[Change]]:
    """Solids of the shells: those of the shape, so that voids stay where they are, or one for each closed shell."""
    bodies: list[TopoDS_Shape] = []
    made = outward = 0
    sizes = [sum(1 for _ in sub_shapes(solid, _SHELL)) for solid in sub_shapes(shape, _SOLID)]
    # turning faces may take a shell to pieces; then nobody knows which piece was whose
    starts = [sum(sizes[:i]) for i in range(len(sizes))] if sum(sizes) <= len(shells) else []
    groups = [shells[start : start + size] for start, size in zip(starts, sizes)]
    for shell in shells[sum(len(group) for group in groups) :]:
        if BRep_Tool.IsClosed_s(shell):
            groups.append([shell])
            made += 1
        else:
            bodies.append(shell)
    for group in groups:
        solid, turned = _outward(group)
        bodies.append(solid)
        outward += turned
    return bodies, [
        Change("solid-made", "closed shells made solids", made),
        Change("solid-turned", "solids turned outside out", outward),
    ]


def _outward(shells: list[TopoDS_Shell]) -> tuple[TopoDS_Solid, bool]:
    builder, solid = BRep_Builder(), TopoDS_Solid()
    builder.MakeSolid(solid)
    for shell in shells:
        builder.Add(solid, shell)
    before = [face.Orientation() for face in sub_shapes(solid, _FACE)]
    BRepLib.OrientClosedSolid_s(solid)
    return solid, before != [face.Orientation() for face in sub_shapes(solid, _FACE)]
