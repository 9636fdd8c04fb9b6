"""Shapes for the tests of the gate and the writers, sound ones and ones broken on purpose."""

from math import cos, pi, sin

import cadquery as cq
from OCP.BRep import BRep_Builder
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS_Compound, TopoDS_Shape, TopoDS_Shell, TopoDS_Solid

from brep_export.check_topology import sub_shapes


def box(*, size: tuple[float, float, float] = (10, 20, 30), at: tuple[float, float, float] = (0, 0, 0)) -> TopoDS_Shape:
    """A box about a point, its geometry in place."""
    corner = cq.Vector(*(a - s / 2 for a, s in zip(at, size)))
    return cq.Solid.makeBox(*size, corner).wrapped


def faces(shape: TopoDS_Shape) -> list[TopoDS_Shape]:
    return list(sub_shapes(shape, TopAbs_ShapeEnum.TopAbs_FACE))


def reversed_faces(shape: TopoDS_Shape) -> list[TopoDS_Shape]:
    return [face.Reversed() for face in faces(shape)]


def shell(parts: list[TopoDS_Shape], *, marked_closed: bool = True) -> TopoDS_Shell:
    builder, result = BRep_Builder(), TopoDS_Shell()
    builder.MakeShell(result)
    for part in parts:
        builder.Add(result, part)
    result.Closed(marked_closed)
    return result


def solid(*shells: TopoDS_Shape) -> TopoDS_Solid:
    builder, result = BRep_Builder(), TopoDS_Solid()
    builder.MakeSolid(result)
    for part in shells:
        builder.Add(result, part)
    return result


def compound(*parts: TopoDS_Shape) -> TopoDS_Compound:
    builder, result = BRep_Builder(), TopoDS_Compound()
    builder.MakeCompound(result)
    for part in parts:
        builder.Add(result, part)
    return result


def lens() -> TopoDS_Shape:
    """An elliptic piece of a wavy spline plate: trimmed spline faces above and below, as a patched vessel has."""
    rows = [[cq.Vector(x, y, 2 * sin(x * 0.1) * cos(y * 0.08)) for y in range(-20, 21, 4)] for x in range(-20, 21, 4)]
    plate = cq.Workplane(cq.Face.makeSplineApprox(rows, tol=1e-2).thicken(3))
    return plate.intersect(cq.Workplane().ellipse(12, 8).extrude(20, both=True)).val().wrapped


def spline_prism(n: int = 120, height: float = 5.0) -> tuple[TopoDS_Shape, float]:
    """A prism over r = 10 (1 + sin(5 t) / 5), and its volume: half the integral of r^2 is 102 pi."""
    angles = [2 * pi * i / n for i in range(n)]
    points = [(10 * cos(t) * (1 + sin(5 * t) / 5), 10 * sin(t) * (1 + sin(5 * t) / 5)) for t in angles]
    prism = cq.Workplane().spline(points, periodic=True).close().extrude(height)
    return prism.val().wrapped, 102 * pi * height


def sound_shapes() -> dict[str, TopoDS_Shape]:
    """Seams, degenerate edges, a void, two bodies, spline faces: everything here must pass."""
    profile = cq.Workplane("XZ").lineTo(2, 0).spline([(5, 3), (3, 7), (4, 10)], includeCurrent=True).lineTo(0, 10)
    loft = cq.Workplane().rect(10, 10).workplane(offset=5).circle(3).workplane(offset=5).ellipse(4, 2).loft()
    return {
        "box": box(),
        "cylinder": cq.Solid.makeCylinder(5, 10).wrapped,
        "sphere": cq.Solid.makeSphere(10, angleDegrees1=-90).wrapped,
        "torus": cq.Solid.makeTorus(10, 3).wrapped,
        "cone": cq.Solid.makeCone(5, 0, 10).wrapped,
        "box with a void": solid(shell(faces(box())), shell(reversed_faces(box(size=(2, 2, 2))))),
        "two bodies": compound(box(), box(at=(30, 0, 0))),
        "spline of revolution": profile.close().revolve().val().wrapped,
        "loft": loft.val().wrapped,
        "spline prism": spline_prism()[0],
        "trimmed spline faces": lens(),
    }
