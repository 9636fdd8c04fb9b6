"""Solids with their outside outside: polyhedra, triangle meshes, closed patch networks, thick pieces, rims.

outer sheet      .-----------------.   loop counter-clockwise seen from outside
                /|  wall k        /
               x_k     x_{k+1}   /     x_k  from corner k of the outer loop to corner k of the inner one;
inner sheet  .--|---------------.           the walls k - 1 and k share it
                                       the inner sheet is turned over, the walls too
"""

import numpy as np
from numpy.typing import NDArray
from OCP.BRepGProp import BRepGProp
from OCP.Geom import Geom_Surface
from OCP.GProp import GProp_GProps
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import (
    TopoDS_Compound,
    TopoDS_Edge,
    TopoDS_Face,
    TopoDS_Shape,
    TopoDS_Shell,
    TopoDS_Solid,
    TopoDS_Vertex,
)

from brep_export.compounds import one_or_compound
from brep_export.curves import kernel_curve, kernel_pcurve
from brep_export.faces import (
    BUILDER,
    cover_gap,
    make_degenerate_edge,
    make_edge,
    make_face,
    make_vertex,
    make_wire,
    put_pcurve,
    straight_pcurve,
    turned,
)
from brep_export.shells import PlanarLoops, make_shell, network_shell, planar_shell, side_ends
from brep_export.surfaces import kernel_surface
from recon.errors import NotManifold, NoWall
from recon.geometry.bspline import BSplineSurface
from recon.geometry.mesh import TriangleMesh
from recon.geometry.patches import PatchNetwork, side_curve
from recon.geometry.polyhedron import Polyhedron, merge_coplanar, mesh_bodies
from recon.geometry.trimmed import LipPiece, ThickPiece, TrimmedSurface
from recon.tolerance import Tolerance

__all__ = [
    "polyhedron_solid",
    "triangle_solid",
    "mesh_solid",
    "network_solid",
    "signed_volume",
    "solid_of",
    "solids_of",
    "thick_solid",
    "lip_solid",
]

Floats = NDArray[np.float64]


def polyhedron_solid(polyhedron: Polyhedron) -> TopoDS_Solid | TopoDS_Compound:
    """Kernel solid of a polyhedron, or a compound of solids when it has several bodies, which share nothing.

    Promises  faces outward, voids as inner shells.
    Raises    NotManifold naming a place, when an edge is not run through once in each direction, or a body's volume is
              not positive, or a void's not negative.
    """
    return solids_of(
        [
            [
                planar_shell(polyhedron.vertices, _loops([polyhedron.faces[f].loops for f in shell]), "polyhedron")
                for shell in body
            ]
            for body in polyhedron.bodies
        ],
        "polyhedron",
    )


def _loops(faces: list[tuple[tuple[int, ...], ...]]) -> PlanarLoops:
    loops = [loop for face in faces for loop in face]
    return PlanarLoops(
        np.concatenate([np.array(loop, dtype=np.int64) for loop in loops]),
        np.array([len(loop) for loop in loops]),
        np.repeat(np.arange(len(faces)), [len(face) for face in faces]),
    )


def triangle_solid(mesh: TriangleMesh) -> TopoDS_Solid | TopoDS_Compound:
    """Kernel solid with one face a triangle, or a compound of solids when the mesh has several bodies.

    Promises  faces outward, voids as inner shells; shared vertices and edges; no pcurves, planes need none.
    Raises    NotManifold naming a place, when the mesh is not closed, not oriented outward, or a triangle has no area.
    """
    return solids_of(
        [
            [planar_shell(mesh.vertices, _triangle_loops(mesh, members), mesh.name) for members in body]
            for body in mesh_bodies(mesh)
        ],
        mesh.name,
    )


def _triangle_loops(mesh: TriangleMesh, members: NDArray[np.int64]) -> PlanarLoops:
    n = len(members)
    return PlanarLoops(mesh.face_vertices[members].ravel(), np.full(n, 3), np.arange(n))


def mesh_solid(mesh: TriangleMesh, tolerance: Tolerance) -> TopoDS_Solid | TopoDS_Compound:
    """Kernel solid of a closed mesh whose coplanar triangles, within tolerance.merge, have become one face each.

    Raises  NotManifold as `triangle_solid`, or where the mesh is thinner than the tolerance.
    """
    return polyhedron_solid(merge_coplanar(mesh, tolerance.merge))


def solids_of(bodies: list[list[tuple[TopoDS_Shell, float]]], what: str) -> TopoDS_Solid | TopoDS_Compound:
    """One solid a body, given by its shells as for `solid_of`, whose errors it raises; a compound of several."""
    return one_or_compound([solid_of(body, what) for body in bodies])


def solid_of(shells: list[tuple[TopoDS_Shell, float]], what: str) -> TopoDS_Solid:
    """Kernel solid between shells, each with its signed volume: the outer one first, positive, then voids, negative.

    Raises  NotManifold when a shell is turned inside out.
    """
    solid = TopoDS_Solid()
    BUILDER.MakeSolid(solid)
    for i, (shell, volume) in enumerate(shells):
        if not (volume > 0 if i == 0 else volume < 0):
            raise NotManifold(what, f"{'a body' if i == 0 else 'a void'} is turned inside out (volume {volume:.3g})")
        BUILDER.Add(solid, shell)
    solid.Closed(True)
    return solid


def network_solid(network: PatchNetwork, tolerance: Tolerance) -> TopoDS_Solid:
    """Kernel solid inside a closed patch network; patches may point either way, the solid's faces point outward.

    Raises  NotManifold naming a place, when the network is open, has one side only, falls into several parts, or gapes.
    """
    shell = network_shell(network, tolerance)
    _refuse_open(network)
    volume = signed_volume(shell)
    if volume < 0:
        shell = make_shell([face.Reversed() for face in _faces(shell)], closed=True)
    return solid_of([(shell, abs(volume))], "patch network")


def _refuse_open(network: PatchNetwork) -> None:
    used = network.side_edges[network.side_edges >= 0]
    uses = np.bincount(used, minlength=len(network.edge_vertices))
    if (uses != 2).any():
        place = network.vertices[network.edge_vertices[int(np.argmax(uses != 2)), 0]]
        raise NotManifold(
            "patch network", f"is open: {int((uses != 2).sum())} edges have one patch only, the first", place
        )
    part = np.arange(len(network.patches))
    owners = np.repeat(part, 4)[network.side_edges.ravel() >= 0][np.argsort(used, kind="stable")].reshape(-1, 2)
    part = _parts(owners, len(part))
    if part.max() > 0:
        place = network.vertices[network.corner_vertices[int(np.argmax(part > 0)), 0]]
        raise NotManifold(
            "patch network", f"falls into {part.max() + 1} closed parts; build each alone; the second", place
        )


def _parts(pairs: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def signed_volume(shape: TopoDS_Shape) -> float:
    """Signed volume by the kernel's plain quadrature: good enough for its sign."""
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, properties)
    return float(properties.Mass())


def _faces(shell: TopoDS_Shape) -> list[TopoDS_Shape]:
    found, walk = [], TopExp_Explorer(shell, TopAbs_ShapeEnum.TopAbs_FACE)
    while walk.More():
        found.append(walk.Current())
        walk.Next()
    return found


def thick_solid(piece: ThickPiece, tolerance: Tolerance) -> TopoDS_Solid:
    """Kernel solid of a thick piece: outer sheet, inner sheet turned over, one face a wall surface.

    An edge between sheet and wall is the wall's own border in space; its pcurves are the sheet's trim curve and a
    straight line on the wall. Walls share their cross edges, all meet in shared corners.
    Promises  every edge's tolerance covers the distance measured, which is at most tolerance.fit.
    Raises    NoWall when a wall's border leaves its sheet's trim curve, or its neighbour, by more than tolerance.fit;
              NotManifold when the inner sheet lies outside the outer one.
    """
    sheets = [kernel_surface(sheet.surface) for sheet in (piece.outer, piece.inner)]
    walls = [kernel_surface(wall) for wall in piece.wall]
    n = len(walls)
    corners = [[make_vertex(p) for p in _corners(piece.wall, row)] for row in (0, 1)]
    rims = [
        [_rim_edge(piece, k, row, (corners[row][k], corners[row][(k + 1) % n])) for k in range(n)] for row in (0, 1)
    ]
    crosses = [_cross_edge(piece.wall[k], (corners[0][k], corners[1][k])) for k in range(n)]
    for k, wall in enumerate(walls):
        _put_cross_pcurves(piece.wall, k, (crosses[k], walls))
        for row, sheet in enumerate(sheets):
            _put_rim_pcurves(piece, k, row, (rims[row][k], sheet, wall))
    for k in range(n):
        for row, sheet in enumerate(sheets):
            _close(rims[row][k], [sheet, walls[k]], tolerance, f"wall {k} and the {('outer', 'inner')[row]} sheet")
        _close(crosses[k], [walls[k - 1], walls[k]], tolerance, f"walls {(k - 1) % n} and {k}")
    faces = [
        make_face(sheets[0], [make_wire(rims[0])]),
        make_face(sheets[1], [make_wire(rims[1])]).Reversed(),
        *(_wall_face(walls[k], (rims[0][k], crosses[(k + 1) % n], rims[1][k], crosses[k])) for k in range(n)),
    ]
    shell = make_shell(faces, closed=True)
    return solid_of([(shell, signed_volume(shell))], "thick piece")


def _corners(walls: tuple[BSplineSurface, ...], row: int) -> Floats:
    return np.array([wall.control_net[0, -row] for wall in walls])


def _rim_edge(piece: ThickPiece, k: int, row: int, ends: tuple[TopoDS_Vertex, TopoDS_Vertex]) -> TopoDS_Edge:
    """Border of wall k along the outer (row 0) or inner (row 1) sheet."""
    curve = side_curve(piece.wall[k], 2 * row)
    return make_edge(kernel_curve(curve), curve.domain, ends)


def _cross_edge(wall: BSplineSurface, ends: tuple[TopoDS_Vertex, TopoDS_Vertex]) -> TopoDS_Edge:
    curve = side_curve(wall, 3)
    return make_edge(kernel_curve(curve), curve.domain, ends)


def _put_rim_pcurves(piece: ThickPiece, k: int, row: int, made: tuple[TopoDS_Edge, Geom_Surface, Geom_Surface]) -> None:
    edge, sheet, wall = made
    domain = piece.wall[k].domain[0]
    trimmed: TrimmedSurface = (piece.outer, piece.inner)[row]
    put_pcurve(edge, kernel_pcurve(trimmed.loops[0].pcurves[k]), sheet, trimmed.loops[0].pcurves[k].domain)
    put_pcurve(edge, straight_pcurve(*side_ends(piece.wall[k], 2 * row), domain), wall, domain)


def _put_cross_pcurves(walls: tuple[BSplineSurface, ...], k: int, made: tuple[TopoDS_Edge, list[Geom_Surface]]) -> None:
    """Straight pcurves where wall k begins and wall k - 1 ends; a pair when that is one wall, closed upon itself."""
    edge, surfaces = made
    domain = walls[k].domain[1]
    begin = straight_pcurve(*side_ends(walls[k], 3), domain)
    end = straight_pcurve(*side_ends(walls[k - 1], 1), domain)
    if len(walls) == 1:
        put_pcurve(edge, (end, begin), surfaces[k], domain)
    else:
        put_pcurve(edge, begin, surfaces[k], domain)
        put_pcurve(edge, end, surfaces[k - 1], domain)


def _close(edge: TopoDS_Edge, surfaces: list[Geom_Surface], tolerance: Tolerance, what: str) -> None:
    gap = cover_gap(edge, surfaces, adapt_above=tolerance.fit)
    if gap > tolerance.fit:
        raise NoWall(f"Thick piece: {what} are {gap:.3g} apart along their common edge, allowed {tolerance.fit:.3g}.")


def _wall_face(surface: Geom_Surface, sides: tuple[TopoDS_Edge, ...]) -> TopoDS_Shape:
    """Face of a wall from the edges on its four sides; turned over, since its own normal points into the material."""
    wire = make_wire(turned(edge, side >= 2) for side, edge in enumerate(sides))
    face: TopoDS_Face = make_face(surface, [wire])
    return face.Reversed()


def lip_solid(piece: LipPiece, tolerance: Tolerance) -> TopoDS_Solid:
    """Kernel solid of a piece of a rim: its face over the lip, and one face a wall surface, the outermost of which end
    in degenerate edges at the lip points.

    Promises, Raises  as `thick_solid`.
    """
    sheet, walls = kernel_surface(piece.face.surface), [kernel_surface(wall) for wall in piece.wall]
    n = len(walls)
    ends = [make_vertex(rung[0]) for rung in (piece.wall[0].control_net[0], piece.wall[-1].control_net[-1])]
    corners = [[ends[0], *map(make_vertex, _corners(piece.wall, row)[1:]), ends[1]] for row in (0, 1)]
    rims = [[_border(piece.wall[k], row, corners[row][k : k + 2]) for k in range(n)] for row in (0, 1)]
    crosses = [_cross_edge(piece.wall[k], (corners[0][k], corners[1][k])) for k in range(1, n)]
    for k, wall in enumerate(walls):
        for row in (0, 1):
            pcurve = piece.face.loops[0].pcurves[k] if row == 0 else piece.face.loops[0].pcurves[-1 - k].reversed()
            put_pcurve(rims[row][k], kernel_pcurve(pcurve), sheet, pcurve.domain)
            line = straight_pcurve(*side_ends(piece.wall[k], 2 * row), pcurve.domain)
            put_pcurve(rims[row][k], line, wall, pcurve.domain)
            _close(rims[row][k], [sheet, wall], tolerance, f"wall {k} and the {('outer', 'inner')[row]} edge")
    for k, cross in enumerate(crosses, start=1):
        _put_cross_pcurves(piece.wall, k, (cross, walls))
        _close(cross, [walls[k - 1], walls[k]], tolerance, f"walls {k - 1} and {k}")
    crosses = [
        _collapsed(piece.wall[0], 3, walls[0], ends[0]),
        *crosses,
        _collapsed(piece.wall[-1], 1, walls[-1], ends[1]),
    ]
    loop = [*rims[0], *(turned(edge, True) for edge in reversed(rims[1]))]
    faces = [
        make_face(sheet, [make_wire(loop)]),
        *(_wall_face(walls[k], (rims[0][k], crosses[k + 1], rims[1][k], crosses[k])) for k in range(n)),
    ]
    shell = make_shell(faces, closed=True)
    return solid_of([(shell, signed_volume(shell))], "piece of the rim")


def _border(wall: BSplineSurface, row: int, ends: list[TopoDS_Vertex]) -> TopoDS_Edge:
    curve = side_curve(wall, 2 * row)
    return make_edge(kernel_curve(curve), curve.domain, (ends[0], ends[1]))


def _collapsed(wall: BSplineSurface, side: int, surface: Geom_Surface, vertex: TopoDS_Vertex) -> TopoDS_Edge:
    domain = wall.domain[1]
    return make_degenerate_edge(straight_pcurve(*side_ends(wall, side), domain), surface, domain, vertex)
