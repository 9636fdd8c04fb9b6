"""Which edge bounds which face, and whether the faces close: lines 1 and 2 of the gate.

A closed shell is one in which every edge is run through twice, once in each direction.  The kernel's own checks
accept a shell that lacks a face when it is asked with the wrong question, so the uses are counted here.

         ______e______
        /      >      /|       face 1 uses e forward, face 2 uses it reversed: inner edge
       /   1   <     / |       used once: free edge;  twice the same way: one of the faces is turned over
      /____________ /2 |       three times or more: no surface can do that

body   a solid, or a shell outside every solid, or all faces outside every shell together
use    one appearance of an edge in the wire of a face; a seam has two uses in one face
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.BRepCheck import BRepCheck_Shell, BRepCheck_Status
from OCP.GeomAbs import GeomAbs_CurveType
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp, TopExp_Explorer
from OCP.TopoDS import TopoDS, TopoDS_Edge, TopoDS_Face, TopoDS_Shape
from OCP.TopTools import TopTools_IndexedMapOfShape

from recon.geometry.promises import Defect

__all__ = [
    "ShapeKind",
    "EdgeUses",
    "edge_uses",
    "closing_defects",
    "count",
    "each_once",
    "edge_polyline",
    "edge_use_defects",
    "sub_shapes",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]
Point = tuple[float, float, float]

_SHELL, _SOLID, _FACE, _EDGE = (
    TopAbs_ShapeEnum.TopAbs_SHELL,
    TopAbs_ShapeEnum.TopAbs_SOLID,
    TopAbs_ShapeEnum.TopAbs_FACE,
    TopAbs_ShapeEnum.TopAbs_EDGE,
)


class ShapeKind(StrEnum):
    """What a shape is, or is meant to be; decides which lines of the gate apply."""

    SOLID = "solid"
    SHELL = "shell"
    FACE = "face"
    EDGE = "edge"
    COMPOUND = "compound"


@dataclass(frozen=True, eq=False)
class EdgeUses:
    """Every use of every edge of a shape, in the order of its faces.

    edges       one of each, without the collapsed sides of patches (degenerate edges)
    faces       oriented as in the shape
    bodies      solids first, then shells, then (as the shape itself) the faces that belong to none
    body_kinds  the kind of each body
    use_edges   the edge of each use, oriented as in its face
    edge, face, body  (M,) numbers of edge, face and body of each use; forward (M,) its direction
    """

    edges: tuple[TopoDS_Edge, ...]
    faces: tuple[TopoDS_Face, ...]
    bodies: tuple[TopoDS_Shape, ...]
    body_kinds: tuple[ShapeKind, ...]
    use_edges: tuple[TopoDS_Edge, ...]
    edge: Ints
    face: Ints
    body: Ints
    forward: Flags
    face_body: Ints

    @property
    def is_solid(self) -> Flags:
        """(B,) whether each body is a solid."""
        return np.array([kind is ShapeKind.SOLID for kind in self.body_kinds], dtype=bool)

    def counts(self) -> tuple[Ints, Ints, Ints, Ints]:
        """Body, edge, number of uses and number of forward uses of every edge within every body."""
        key, slot = np.unique(self.body * max(len(self.edges), 1) + self.edge, return_inverse=True)
        body, edge = np.divmod(key, max(len(self.edges), 1))
        forward = np.bincount(slot[self.forward], minlength=len(key))
        return body, edge, np.bincount(slot, minlength=len(key)), forward

    def free_edges(self) -> list[TopoDS_Edge]:
        """Edges that one face alone uses, once."""
        _, edge, uses, _ = self.counts()
        return [self.edges[i] for i in edge[uses == 1]]


def edge_uses(shape: TopoDS_Shape) -> EdgeUses:
    """Walk the shape once and note every use of every edge; edges inside a face (no border) are left out."""
    edge_numbers = TopTools_IndexedMapOfShape()
    faces: list[TopoDS_Face] = []
    face_body: list[int] = []
    uses: list[tuple[int, int, bool]] = []
    use_edges: list[TopoDS_Edge] = []
    bodies, kinds = _bodies(shape)
    for body, (owner, kind) in enumerate(zip(bodies, kinds)):
        for face in sub_shapes(owner, _FACE, _SHELL if kind is ShapeKind.FACE else None):
            for edge in sub_shapes(face, _EDGE):
                direction = edge.Orientation()
                edge = TopoDS.Edge_s(edge)
                if direction in _BORDER and not BRep_Tool.Degenerated_s(edge):
                    uses.append(
                        (edge_numbers.Add(edge) - 1, len(faces), direction == TopAbs_Orientation.TopAbs_FORWARD)
                    )
                    use_edges.append(edge)
            faces.append(TopoDS.Face_s(face))
            face_body.append(body)
    table = np.array(uses, dtype=np.int64).reshape(-1, 3)
    edges = tuple(TopoDS.Edge_s(edge_numbers(i)) for i in range(1, edge_numbers.Extent() + 1))
    bodies_of_faces = np.array(face_body, dtype=np.int64)
    return EdgeUses(
        edges,
        tuple(faces),
        tuple(bodies),
        tuple(kinds),
        tuple(use_edges),
        table[:, 0],
        table[:, 1],
        bodies_of_faces[table[:, 1]],
        table[:, 2].astype(bool),
        bodies_of_faces,
    )


_BORDER = (TopAbs_Orientation.TopAbs_FORWARD, TopAbs_Orientation.TopAbs_REVERSED)


def sub_shapes(
    shape: TopoDS_Shape, kind: TopAbs_ShapeEnum, avoid: TopAbs_ShapeEnum | None = None
) -> Iterator[TopoDS_Shape]:
    """Every appearance of a kind of shape in a shape, in order, oriented as there; not those inside `avoid`."""
    explorer = TopExp_Explorer(shape, kind) if avoid is None else TopExp_Explorer(shape, kind, avoid)
    while explorer.More():
        yield explorer.Current()
        explorer.Next()


def each_once(shape: TopoDS_Shape, kind: TopAbs_ShapeEnum) -> list[TopoDS_Shape]:
    """The different shapes of a kind in a shape, whatever their orientation."""
    found = _different(shape, kind)
    return [found(i) for i in range(1, found.Extent() + 1)]


def count(shape: TopoDS_Shape, kind: TopAbs_ShapeEnum) -> int:
    """How many different shapes of a kind there are."""
    return int(_different(shape, kind).Extent())


def _different(shape: TopoDS_Shape, kind: TopAbs_ShapeEnum) -> TopTools_IndexedMapOfShape:
    found = TopTools_IndexedMapOfShape()
    TopExp.MapShapes_s(shape, kind, found)
    return found


def _bodies(shape: TopoDS_Shape) -> tuple[list[TopoDS_Shape], list[ShapeKind]]:
    solids = list(sub_shapes(shape, _SOLID))
    shells = list(sub_shapes(shape, _SHELL, _SOLID))
    loose = [shape] if next(sub_shapes(shape, _FACE, _SHELL), None) is not None else []
    kinds = [ShapeKind.SOLID] * len(solids) + [ShapeKind.SHELL] * len(shells) + [ShapeKind.FACE] * len(loose)
    return solids + shells + loose, kinds


def closing_defects(uses: EdgeUses) -> list[Defect]:
    """Line 1: every shell of every solid is closed, in one piece, and says so of itself."""
    solids = [body for body, solid in zip(uses.bodies, uses.is_solid) if solid]
    free, overused = uses.free_edges(), bool((uses.counts()[2] > 2).any())
    defects = []
    for solid in solids:
        shells = list(sub_shapes(solid, _SHELL))
        if not shells:
            defects.append(Defect("no-shell", "a solid has no shell"))
        for shell in shells:
            defects += _shell_defects(shell, free, overused=overused)
    return defects


def _shell_defects(shell: TopoDS_Shape, free: list[TopoDS_Edge], *, overused: bool) -> list[Defect]:
    status = BRepCheck_Shell(TopoDS.Shell_s(shell)).Closed(False)
    is_closed = status == BRepCheck_Status.BRepCheck_NoError and BRep_Tool.IsClosed_s(shell)
    if status == BRepCheck_Status.BRepCheck_NotConnected:
        return [Defect("shell-in-pieces", "the faces of one shell do not hang together")]
    if not is_closed and free:
        sentence = "a shell of a solid is open: edges with one face only"
        return [Defect("shell-open", sentence, edge_polyline(free[0])[0], float(len(free)), 0.0)]
    if not is_closed and not overused:  # an edge with more than two uses is named by the next line
        return [Defect("shell-open", "the kernel calls a shell of a solid open, though no edge is free")]
    if is_closed and not shell.Closed():
        return [Defect("shell-flag", "a shell is closed but is marked as open")]
    return []


def edge_use_defects(uses: EdgeUses) -> list[Defect]:
    """Line 2: no edge has more than two uses, and two uses run in opposite directions."""
    _, edge, count, forward = uses.counts()
    over, same = count > 2, (count == 2) & (forward != 1)
    rows = ((over, "edge-overused", "edges with more than two faces", 2.0), (same, "face-flipped", _FLIPPED, 0.0))
    defects = []
    for broken, code, sentence, allowed in rows:
        if broken.any():
            measured = float(count.max() if code == "edge-overused" else same.sum())
            place = edge_polyline(uses.edges[edge[np.argmax(broken)]])[0]
            defects.append(Defect(code, sentence, place, measured, allowed))
    return defects


_FLIPPED = "edges whose two faces run through them the same way, one face being turned over"


def edge_polyline(edge: TopoDS_Edge, n: int = 24) -> list[Point]:
    """Points along an edge, two for a straight one, n else; the vertices' points when it has no curve in space."""
    if BRep_Tool.Curve_s(edge, 0.0, 0.0) is None:
        vertices = sub_shapes(edge, TopAbs_ShapeEnum.TopAbs_VERTEX)
        return [BRep_Tool.Pnt_s(TopoDS.Vertex_s(v)).Coord() for v in vertices] or [(0.0, 0.0, 0.0)]
    curve = BRepAdaptor_Curve(edge)
    straight = curve.GetType() == GeomAbs_CurveType.GeomAbs_Line
    ends = np.linspace(curve.FirstParameter(), curve.LastParameter(), 2 if straight else n)
    return [curve.Value(float(t)).Coord() for t in ends]
