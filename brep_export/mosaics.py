"""Patch mosaics to kernel shells and solids: one face a patch, one edge a stretch that two patches share.

An edge of a mosaic has a curve of its own, and on each patch it runs along an iso-parametric line at even speed, so its
pcurves are straight. Edges across which the surface is smooth are marked so (G1): the gate measures their angle.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from OCP.Geom import Geom_Surface
from OCP.GeomAbs import GeomAbs_Shape
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS, TopoDS_Compound, TopoDS_Edge, TopoDS_Face, TopoDS_Shape, TopoDS_Shell, TopoDS_Solid
from scipy import sparse
from scipy.sparse import csgraph

from brep_export.compounds import one_or_compound
from brep_export.curves import kernel_curve
from brep_export.faces import (
    BUILDER,
    FORWARD,
    REVERSED,
    cover_gap,
    make_degenerate_edge,
    make_edge,
    make_face,
    make_vertex,
    make_wire,
    put_pcurve,
    straight_pcurve,
)
from brep_export.shells import make_shell
from brep_export.solids import solid_of
from brep_export.surfaces import kernel_surface
from recon.errors import NotManifold
from recon.geometry.bspline import BSplineSurface
from recon.geometry.cone_volume import cone_volume
from recon.geometry.patches import PatchMosaic
from recon.tolerance import Tolerance

__all__ = ["mosaic_shape"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class _Use(NamedTuple):
    """One stretch of a patch's side on an edge: parameters of the patch at the edge's start and end."""

    patch: int
    start: Floats
    end: Floats
    forward: bool  # whether the edge runs as the outer wire of the patch does


def mosaic_shape(mosaic: PatchMosaic, tolerance: Tolerance) -> TopoDS_Solid | TopoDS_Shell | TopoDS_Compound:
    """A solid inside a closed mosaic, a shell of an open one, a compound of these when it falls into several parts.

    Promises  the faces of a solid point outward; every edge's tolerance covers the distance measured to its patches.
    Raises    NotManifold naming a place, when an edge has more than two patches, two patches run along it in the same
              direction, or they are farther apart than tolerance.fit.
    """
    uses = _edge_uses(mosaic)
    surfaces: list[Geom_Surface] = [kernel_surface(patch) for patch in mosaic.patches]
    edges = _edges(mosaic, uses, surfaces, tolerance)
    faces = _faces(mosaic, surfaces, edges)
    for e in np.flatnonzero(mosaic.smooth_edges).tolist():
        if len(uses[e]) == 2:
            BUILDER.Continuity(edges[e], faces[uses[e][0].patch], faces[uses[e][1].patch], GeomAbs_Shape.GeomAbs_G1)
    part, closed = _parts(mosaic, uses)
    apex = mosaic.vertices.mean(axis=0)
    volumes = np.bincount(part, [cone_volume(patch, apex) for patch in mosaic.patches])
    made = [
        _body([faces[p] for p in np.flatnonzero(part == k)], float(volumes[k]), closed=bool(c))
        for k, c in enumerate(closed)
    ]
    return one_or_compound(made)


def _body(faces: list[TopoDS_Shape], volume: float, *, closed: bool) -> TopoDS_Solid | TopoDS_Shell:
    shell = make_shell(faces, closed=closed)
    if not closed:
        return shell
    if volume < 0:
        shell = make_shell([face.Reversed() for face in faces], closed=True)
    return solid_of([(shell, abs(volume))], "patch mosaic")


def _edge_uses(mosaic: PatchMosaic) -> list[list[_Use]]:
    uses: list[list[_Use]] = [[] for _ in mosaic.edge_curves]
    starts = mosaic.side_starts.tolist()
    for p, patch in enumerate(mosaic.patches):
        for side in range(4):
            for k in range(starts[4 * p + side], starts[4 * p + side + 1]):
                ends = [_on_side(patch, side, t) for t in mosaic.side_ranges[k].tolist()]
                way = bool(mosaic.side_forward[k]) == (side < 2)
                uses[int(mosaic.side_edges[k])].append(_Use(p, ends[0], ends[1], way))
    for e, found in enumerate(uses):
        if not 1 <= len(found) <= 2:
            raise NotManifold("patch mosaic", f"an edge belongs to {len(found)} patches", _middle(mosaic, e))
        if len(found) == 2 and found[0].forward == found[1].forward:
            problem = "two patches that share an edge face opposite ways"
            raise NotManifold("patch mosaic", problem, _middle(mosaic, e))
    return uses


def _on_side(patch: BSplineSurface, side: int, t: float) -> Floats:
    (u0, u1), (v0, v1) = patch.domain
    return np.array(((t, v0), (u1, t), (t, v1), (u0, t))[side])


def _middle(mosaic: PatchMosaic, e: int) -> list[float]:
    curve = mosaic.edge_curves[e]
    return [float(x) for x in curve.point([sum(curve.domain) / 2])[0]]


def _edges(
    mosaic: PatchMosaic, uses: list[list[_Use]], surfaces: list[Geom_Surface], tolerance: Tolerance
) -> list[TopoDS_Edge]:
    vertices = [make_vertex(point) for point in mosaic.vertices]
    edges = []
    for e, ((start, end), curve) in enumerate(zip(mosaic.edge_vertices.tolist(), mosaic.edge_curves)):
        domain = curve.domain
        edge = make_edge(kernel_curve(curve), domain, (vertices[start], vertices[end]))
        pcurves = [straight_pcurve(use.start, use.end, domain) for use in uses[e]]
        if len(uses[e]) == 2 and uses[e][0].patch == uses[e][1].patch:
            pair = (pcurves[0], pcurves[1]) if uses[e][0].forward else (pcurves[1], pcurves[0])
            put_pcurve(edge, pair, surfaces[uses[e][0].patch], domain)
        else:
            for use, pcurve in zip(uses[e], pcurves):
                put_pcurve(edge, pcurve, surfaces[use.patch], domain)
        gap = cover_gap(edge, [surfaces[use.patch] for use in uses[e]])
        if gap > tolerance.fit:
            problem = f"patches are {gap:.3g} apart along an edge, allowed {tolerance.fit:.3g},"
            raise NotManifold("patch mosaic", problem, _middle(mosaic, e))
        edges.append(edge)
    return edges


def _faces(mosaic: PatchMosaic, surfaces: list[Geom_Surface], edges: list[TopoDS_Edge]) -> list[TopoDS_Face]:
    starts, side_edges = mosaic.side_starts.tolist(), mosaic.side_edges.tolist()
    forward = mosaic.side_forward.tolist()
    faces = []
    for p, surface in enumerate(surfaces):
        wire: list[TopoDS_Shape] = []
        for side in range(4):
            row = range(starts[4 * p + side], starts[4 * p + side + 1])
            if not row:
                wire.append(_collapsed_side(mosaic.patches[p], side, surface, wire[-1]))
            for k in row if side < 2 else reversed(row):
                wire.append(edges[side_edges[k]].Oriented(FORWARD if forward[k] == (side < 2) else REVERSED))
        faces.append(make_face(surface, [make_wire(wire)]))
    return faces


def _collapsed_side(patch: BSplineSurface, side: int, surface: Geom_Surface, before: TopoDS_Shape) -> TopoDS_Shape:
    """The edge of a side that is a point: the one where the wire has come to."""
    vertex = TopExp.LastVertex_s(TopoDS.Edge_s(before), True)
    domain = patch.domain[side % 2]
    pcurve = straight_pcurve(_on_side(patch, side, domain[0]), _on_side(patch, side, domain[1]), domain)
    edge = make_degenerate_edge(pcurve, surface, domain, TopoDS.Vertex_s(vertex.Oriented(FORWARD)))
    return edge.Oriented(FORWARD if side < 2 else REVERSED)


def _parts(mosaic: PatchMosaic, uses: list[list[_Use]]) -> tuple[Ints, NDArray[np.bool_]]:
    """(P,) the part of every patch, and whether each part is closed."""
    pairs = np.array([(found[0].patch, found[-1].patch) for found in uses])
    n = len(mosaic.patches)
    graph = sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    count, part = csgraph.connected_components(graph, directed=False)
    closed = np.ones(count, dtype=bool)
    closed[part[pairs[np.array([len(found) for found in uses]) == 1, 0]]] = False
    return np.asarray(part, dtype=np.int64), closed
