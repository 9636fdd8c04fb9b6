"""Solids from the surfaces that bound them: all cells that the surfaces cut space into, and a vote which are solid.

  |   :   |          surfaces reach across the whole box; the kernel finds the cells between them (general fuse);
--+---+---+--        a vote says of every cell whether it is solid; faces between a solid cell and an empty one stay,
  | 1 | 1 |          faces of one surface are joined; last the blends, as kernel fillets: so no surface ever has to
--+---+---+--        be cut with one that it touches without crossing
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from OCP.BOPAlgo import BOPAlgo_MakerVolume
from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepFilletAPI import BRepFilletAPI_MakeFillet
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
from OCP.gp import gp_Ax3, gp_Cone, gp_Cylinder, gp_Dir, gp_Pln, gp_Pnt, gp_Sphere
from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS, TopoDS_Face, TopoDS_Shape, TopoDS_Solid
from OCP.TopTools import TopTools_IndexedDataMapOfShapeListOfShape

from brep_export.check_geometry import max_tolerance
from brep_export.check_topology import sub_shapes
from brep_export.compounds import compound_of, one_or_compound
from brep_export.faces import BUILDER
from brep_export.kernel_settings import KERNEL_FAILURES
from brep_export.shells import make_shell
from brep_export.triangulation import triangulate
from recon.errors import NoSolid
from recon.geometry.analytic import AnalyticSurface, Blend, Cone, Cylinder, Plane, Sphere

__all__ = ["analytic_solid", "face_kinds"]

Floats = NDArray[np.float64]
Vote = Callable[[Floats, Floats, Floats], bool]

MOST_SURFACES = 60
INWARD = 0.02  # voxels from the middle of a cell's largest triangle to the point that stands for the cell
WIDEST = 0.05  # voxels that a rounded edge may be off its faces
DEFLECTION = 0.01  # voxels that this triangle may be off its face


def analytic_solid(
    surfaces: Sequence[AnalyticSurface],
    blends: Sequence[Blend],
    *,
    box: tuple[Floats, Floats],
    voxel: float,
    is_solid: Vote,
) -> tuple[TopoDS_Shape, list[Blend]]:
    """Solid, or compound of solids, of the cells that are voted solid; and the blends that the kernel refused.

    box       lowest and highest corner of the part, with room around
    is_solid  called with a point of the cell and the corners of its box
    Raises    NoSolid when the surfaces are too many, the kernel finds no cells, or none is solid.
    """
    if len(surfaces) > MOST_SURFACES:
        raise NoSolid(f"{len(surfaces)} surfaces cut space into too many cells, at most {MOST_SURFACES} are tried")
    try:
        cells = _cells(surfaces, box)
        chosen = [cell for cell in cells if is_solid(*_representative(cell, INWARD * voxel, DEFLECTION * voxel))]
        if not chosen or len(chosen) == len(cells):
            raise NoSolid("no cell between the surfaces is solid")
        shape = _unified(_boundary(chosen, voxel))
        return _blended(shape, surfaces, blends, WIDEST * voxel)
    except KERNEL_FAILURES as failure:
        raise NoSolid(f"the kernel gave up on the cells between the surfaces ({type(failure).__name__})") from failure


def _cells(surfaces: Sequence[AnalyticSurface], box: tuple[Floats, Floats]) -> list[TopoDS_Shape]:
    low, high = box
    reach = 2.0 * float(np.linalg.norm(high - low))
    maker = BOPAlgo_MakerVolume()
    for surface in surfaces:
        maker.AddArgument(_large_face(surface, 0.5 * (low + high), reach))
    for face in sub_shapes(BRepPrimAPI_MakeBox(_point(low), _point(high)).Shape(), TopAbs_ShapeEnum.TopAbs_FACE):
        maker.AddArgument(face)
    maker.SetIntersect(True)
    maker.SetRunParallel(False)
    maker.Perform()
    if maker.HasErrors():
        raise NoSolid("the kernel could not cut space along the surfaces")
    return list(sub_shapes(maker.Shape(), TopAbs_ShapeEnum.TopAbs_SOLID))


def _point(p: Floats) -> gp_Pnt:
    return gp_Pnt(*(float(x) for x in p))


def _frame(point: Floats, axis: Floats) -> gp_Ax3:
    return gp_Ax3(_point(point), gp_Dir(*(float(x) for x in axis)))


def _large_face(surface: AnalyticSurface, centre: Floats, reach: float) -> TopoDS_Face:
    """The surface as far as it can matter."""
    if isinstance(surface, Plane):
        foot = centre - surface.distance(centre[None])[0] * surface.normal_vector
        return BRepBuilderAPI_MakeFace(gp_Pln(_frame(foot, surface.normal_vector)), -reach, reach, -reach, reach).Face()
    if isinstance(surface, Cylinder):
        foot = surface.point + ((centre - surface.point) @ surface.axis) * surface.axis
        round_one = gp_Cylinder(_frame(foot, surface.axis), surface.radius)
        return BRepBuilderAPI_MakeFace(round_one, 0.0, 2 * np.pi, -reach, reach).Face()
    if isinstance(surface, Sphere):
        return BRepBuilderAPI_MakeFace(gp_Sphere(_frame(surface.centre, np.eye(3)[2]), surface.radius)).Face()
    assert isinstance(surface, Cone)
    cone = gp_Cone(_frame(surface.apex, surface.axis), surface.half_angle, 0.0)
    return BRepBuilderAPI_MakeFace(cone, 0.0, 2 * np.pi, 0.0, 2 * reach).Face()


def _representative(cell: TopoDS_Shape, inward: float, deflection: float) -> tuple[Floats, Floats, Floats]:
    """A point inside a cell, and the corners of its box."""
    mesh = triangulate(cell, deflection).mesh
    area = mesh.area_vectors()
    largest = int(np.linalg.norm(area, axis=1).argmax())
    normal = area[largest] / np.linalg.norm(area[largest])
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    return mesh.corners()[largest].mean(axis=0) - inward * normal, low, high


def _boundary(cells: list[TopoDS_Shape], deflection: float) -> TopoDS_Shape:
    """The solids whose faces are those that only one of the cells has."""
    compound = compound_of(cells)
    owners = TopTools_IndexedDataMapOfShapeListOfShape()
    TopExp.MapShapesAndAncestors_s(compound, TopAbs_ShapeEnum.TopAbs_FACE, TopAbs_ShapeEnum.TopAbs_SOLID, owners)
    faces: list[TopoDS_Shape] = []
    for cell in cells:
        for face in sub_shapes(cell, TopAbs_ShapeEnum.TopAbs_FACE):
            if owners.FindFromKey(face).Extent() == 1:
                faces.append(face)
    return _solids(_hanging_together(faces), deflection)


def _hanging_together(faces: list[TopoDS_Shape]) -> list[list[TopoDS_Shape]]:
    """Faces in groups that share edges."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    owners = TopTools_IndexedDataMapOfShapeListOfShape()
    number = TopTools_IndexedDataMapOfShapeListOfShape()
    for face in faces:
        number.Add(face, owners.FindFromIndex(1) if owners.Extent() else _empty_list())
        TopExp.MapShapesAndAncestors_s(face, TopAbs_ShapeEnum.TopAbs_EDGE, TopAbs_ShapeEnum.TopAbs_FACE, owners)
    links: list[tuple[int, int]] = []
    for i in range(1, owners.Extent() + 1):
        around = [number.FindIndex(face) - 1 for face in owners.FindFromIndex(i)]
        links += list(pairwise(around))
    row, column = np.array(links, dtype=np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(row)), (row, column)), shape=(len(faces), len(faces)))
    n, part = connected_components(graph, directed=False)
    return [[faces[f] for f in np.flatnonzero(part == p)] for p in range(n)]


def _empty_list():  # type: ignore[no-untyped-def]
    from OCP.TopTools import TopTools_ListOfShape

    return TopTools_ListOfShape()


def _solids(groups: list[list[TopoDS_Shape]], deflection: float) -> TopoDS_Shape:
    """Each group a shell: outer ones make solids, inner ones become voids of the smallest solid around."""
    outer: list[tuple[float, TopoDS_Shape, tuple[Floats, Floats]]] = []
    voids: list[tuple[TopoDS_Shape, Floats]] = []
    for group in groups:
        shell = make_shell(group, closed=True)
        alone = TopoDS_Solid()
        BUILDER.MakeSolid(alone)
        BUILDER.Add(alone, shell)
        mesh = triangulate(alone, deflection).mesh
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        if mesh.volume() > 0:
            outer.append((mesh.volume(), alone, (low, high)))
        else:
            voids.append((shell, 0.5 * (low + high)))
    for shell, middle in voids:
        around = [o for o in outer if (o[2][0] < middle).all() and (middle < o[2][1]).all()]
        if not around:
            raise NoSolid("a void lies in no body")
        BUILDER.Add(min(around, key=lambda o: o[0])[1], shell)
    return one_or_compound([solid for _, solid, _ in outer])


def _unified(shape: TopoDS_Shape) -> TopoDS_Shape:
    joiner = ShapeUpgrade_UnifySameDomain(shape, True, True, False)
    joiner.Build()
    return joiner.Shape()


def _blended(
    shape: TopoDS_Shape, surfaces: Sequence[AnalyticSurface], blends: Sequence[Blend], allowed: float
) -> tuple[TopoDS_Shape, list[Blend]]:
    """The shape with its blends: all at once, or one after the other where the kernel refuses that or makes no sound
    solid of it, no edge of which is farther than allowed from its faces.
    """
    wanted = [(blend, edges) for blend in blends if (edges := _edges_of(shape, surfaces, blend))]
    refused = [blend for blend in blends if not any(blend is b for b, _ in wanted)]
    if not wanted:
        return shape, refused
    done = _filleted(shape, wanted, allowed)
    if done is not None:
        return done, refused
    for blend, _ in wanted:
        edges = _edges_of(shape, surfaces, blend)
        done = _filleted(shape, [(blend, edges)], allowed) if edges else None
        if done is None:
            refused.append(blend)
        else:
            shape = done
    return shape, refused


def _filleted(
    shape: TopoDS_Shape, wanted: list[tuple[Blend, list[TopoDS_Shape]]], allowed: float
) -> TopoDS_Shape | None:
    maker = BRepFilletAPI_MakeFillet(shape)
    done_edges: list[TopoDS_Shape] = []
    for blend, edges in wanted:
        for edge in edges:
            if not any(edge.IsSame(other) for other in done_edges):
                maker.Add(blend.radius, TopoDS.Edge_s(edge))
                done_edges.append(edge)
    try:
        maker.Build()
        done = maker.Shape() if maker.IsDone() else None
    except KERNEL_FAILURES:
        return None
    if done is None or max_tolerance(done) > allowed or not BRepCheck_Analyzer(done).IsValid():
        return None
    solids = list(sub_shapes(done, TopAbs_ShapeEnum.TopAbs_SOLID))
    return solids[0] if len(solids) == 1 else done


def _edges_of(shape: TopoDS_Shape, surfaces: Sequence[AnalyticSurface], blend: Blend) -> list[TopoDS_Shape]:
    """Edges on both surfaces of a blend, as near to its middle as a rounding of its radius can be."""
    found = []
    for edge in sub_shapes(shape, TopAbs_ShapeEnum.TopAbs_EDGE):
        curve = BRepAdaptor_Curve(TopoDS.Edge_s(edge))
        first, last = curve.FirstParameter(), curve.LastParameter()
        points = np.array(
            [(p.X(), p.Y(), p.Z()) for p in (curve.Value(first + (last - first) * t / 16) for t in range(17))]
        )
        off = max(np.abs(surfaces[k].distance(points)).max() for k in (blend.first, blend.second))
        near = np.linalg.norm(points - blend.middle, axis=1).min()
        step = np.linalg.norm(np.diff(points, axis=0), axis=1).max()
        if off < 1e-4 * blend.radius and near <= blend.radius + step:
            found.append(edge)
    return found


def face_kinds(shape: TopoDS_Shape) -> dict[str, int]:
    """Faces of a shape by kind: planes, cylinders, cones, spheres, tori, others."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import GeomAbs_SurfaceType as Kind

    names = {
        Kind.GeomAbs_Plane: "planes",
        Kind.GeomAbs_Cylinder: "cylinders",
        Kind.GeomAbs_Cone: "cones",
        Kind.GeomAbs_Sphere: "spheres",
        Kind.GeomAbs_Torus: "tori",
        Kind.GeomAbs_SurfaceOfRevolution: "revolutions",
    }
    counts = dict.fromkeys([*names.values(), "others"], 0)
    for face in sub_shapes(shape, TopAbs_ShapeEnum.TopAbs_FACE):
        counts[names.get(BRepAdaptor_Surface(TopoDS.Face_s(face)).GetType(), "others")] += 1
    return counts
