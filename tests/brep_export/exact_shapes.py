"""Surfaces of revolution, exact as NURBS; meshes of boxes; and the measures that kernel shapes are judged by."""

from collections import Counter

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepGProp import BRepGProp
from OCP.GProp import GProp_GProps
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp, TopExp_Explorer
from OCP.TopoDS import TopoDS
from OCP.TopTools import TopTools_IndexedMapOfShape

from recon.geometry.bspline import BSplineSurface
from recon.geometry.mesh import TriangleMesh

CIRCLE = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]], dtype=float)
CIRCLE_WEIGHTS = np.array([1, 0.5**0.5] * 4 + [1])
CIRCLE_KNOTS = np.array([0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4], dtype=float)
LINE = np.array([0, 0, 1, 1], dtype=float)


def revolved(profile, weights, degree, knots):
    """The profile (n, 2) of radii and heights turned about z; u runs around."""
    net = np.zeros((9, len(profile), 3))
    net[..., :2] = CIRCLE[:, None] * np.asarray(profile, dtype=float)[None, :, :1]
    net[..., 2] = np.asarray(profile, dtype=float)[None, :, 1]
    return BSplineSurface(2, degree, CIRCLE_KNOTS, knots, net, CIRCLE_WEIGHTS[:, None] * np.asarray(weights)[None])


def torus(large=3.0, small=1.0):
    profile = np.column_stack([large + small * CIRCLE[:, 0], small * CIRCLE[:, 1]])
    return revolved(profile, CIRCLE_WEIGHTS, 2, CIRCLE_KNOTS)


def sphere(radius=2.0):
    half = radius * np.array([[0, -1], [1, -1], [1, 0], [1, 1], [0, 1]], dtype=float)
    return revolved(half, CIRCLE_WEIGHTS[:5], 2, CIRCLE_KNOTS[[0, 1, 2, 3, 4, 5, 6, 6]])


def barrel(bottom_radius, top_radius, height):
    """A cylinder, a cone, or with equal heights a flat ring; a zero radius collapses that side."""
    return revolved([[bottom_radius, 0], [top_radius, height]], [1, 1], 1, LINE)


def disk(radius, height):
    return revolved([[radius, height], [0, height]], [1, 1], 1, LINE)


def quarters(surface):
    """The four Bezier strips around the axis."""
    knots = np.array([0, 0, 0, 1, 1, 1], dtype=float)
    picks = [slice(2 * i, 2 * i + 3) for i in range(4)]
    return [
        BSplineSurface(2, surface.degree_v, knots, surface.knots_v, surface.control_net[p], surface.weights[p])
        for p in picks
    ]


def swapped(surface):
    """The same surface with u and v exchanged: its normal points the other way."""
    return BSplineSurface(
        surface.degree_v,
        surface.degree_u,
        surface.knots_v,
        surface.knots_u,
        surface.control_net.transpose(1, 0, 2),
        surface.weights.T,
    )


def box_mesh(low, high, inside_out=False):
    """A box of twelve triangles."""
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    return TriangleMesh(low + corner * (high - low), faces[:, ::-1] if inside_out else faces)


def together(*meshes):
    """Several meshes as one."""
    shift = np.cumsum([0] + [m.n_vertices for m in meshes[:-1]])
    return TriangleMesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.face_vertices + s for m, s in zip(meshes, shift)]),
    )


def volume(shape, epsilon=1e-9):
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, properties, epsilon)
    return properties.Mass()


def area(shape, epsilon=1e-9):
    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(shape, properties, epsilon)
    return properties.Mass()


def is_valid(shape):
    return BRepCheck_Analyzer(shape, True).IsValid()


def shapes_in(shape, kind):
    """The different parts of a kind: VERTEX, EDGE, FACE, SHELL, SOLID."""
    found = TopTools_IndexedMapOfShape()
    TopExp.MapShapes_s(shape, getattr(TopAbs_ShapeEnum, f"TopAbs_{kind}"), found)
    return [found.FindKey(i) for i in range(1, found.Extent() + 1)]


def edges_of(shape):
    """Edges that have a length."""
    edges = [TopoDS.Edge_s(edge) for edge in shapes_in(shape, "EDGE")]
    return [edge for edge in edges if not BRep_Tool.Degenerated_s(edge)]


def each_edge_is_used_once_each_way(shape):
    uses, names = Counter(), TopTools_IndexedMapOfShape()
    walk = TopExp_Explorer(shape, TopAbs_ShapeEnum.TopAbs_EDGE)
    while walk.More():
        if not BRep_Tool.Degenerated_s(TopoDS.Edge_s(walk.Current())):
            uses[names.Add(walk.Current()), walk.Current().Orientation()] += 1
        walk.Next()
    ways = (TopAbs_Orientation.TopAbs_FORWARD, TopAbs_Orientation.TopAbs_REVERSED)
    return uses == Counter({(i, way): 1 for i in range(1, names.Extent() + 1) for way in ways})


def assert_sound(solid):
    """Valid for the kernel, shells closed, every edge run through once in each direction, volume positive."""
    assert is_valid(solid)
    assert all(BRep_Tool.IsClosed_s(shell) and shell.Closed() for shell in shapes_in(solid, "SHELL"))
    assert each_edge_is_used_once_each_way(solid)
    assert volume(solid, 1e-4) > 0
