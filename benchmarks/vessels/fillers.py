"""Programs that fill a hole, each behind the same call: a wall with one hole in, the wall with the hole filled out.

    triangulate and fair   CGAL [liepa2003], MeshLib, MeshFix: fine triangles, bent so that they go on as the wall does
    triangulate            MeshLab, VTK: triangles between the points of the edge, refined at most
    plate                  OpenCascade's GeomPlate: a surface of least bending through points of the edge, with normals

Each is told which line is the hole and given its own defaults, but for what makes it smoother: fairing to the second
order (CGAL), curvature and natural smoothing (MeshLib), refinement (MeshFix, MeshLab).
"""

import importlib
import importlib.util
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brep_export.app.patch_job import kernel_piece
from brep_export.app.workshop import Bench, Exit
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import LipPiece, ThickPiece
from recon.hole_patch.pipeline import patch_hole
from recon.numerics.halfedges import vertex_normals
from vessels.cases import outer_face

__all__ = ["FILLERS", "Filler", "fill", "patch"]

Ints = NDArray[np.int64]

PLATE_POINTS = 120
PLATE_ERROR = 0.02  # millimetres by which the spline may leave the plate
PLATE_ROWS = 80


@dataclass(frozen=True)
class Filler:
    """A program beside us.

    module     that must be importable; package  that brings it
    yields     what comes out: "mesh", or "face" where it is a surface of the kernel
    run        (wall, vertices of the hole in order) to triangles that fill it, the wall's own among them or not
    """

    module: str
    package: str
    yields: str
    run: Callable[[TriangleMesh, Ints], TriangleMesh]

    def is_installed(self) -> bool:
        return importlib.util.find_spec(self.module) is not None


def fill(request: Mapping[str, Any], bench: Bench) -> tuple[Exit, dict[str, Any], tuple[str, ...]]:
    """Job: every wall of the request filled by one program, with the seconds and memory that took."""
    filler = FILLERS[request["filler"]]
    importlib.import_module(filler.module)
    filled = {}
    for given, (vertices, faces, hole) in request["walls"].items():
        bench.doing(f"filling the wall as {given}")
        wall = TriangleMesh(vertices, faces)
        with metered() as meter:
            mesh = filler.run(wall, hole)
        filled[given] = (mesh.vertices, mesh.face_vertices, meter)
    return Exit.WRITTEN, {"filled": filled}, ()


def patch(request: Mapping[str, Any], bench: Bench) -> tuple[Exit, dict[str, Any], tuple[str, ...]]:
    """Job: the missing piece from the sherds themselves, settling and the search for the hole included."""
    sherds = [TriangleMesh(vertices, faces) for vertices, faces in request["sherds"]]
    with metered() as meter:
        piece = patch_hole(sherds, doing=bench.doing)
        kernel_piece(piece)
    face, edge = outer_face(piece), piece.outer.edge_distance
    filled = {"sherds": (face.vertices, face.face_vertices, meter)}
    yields = "solid" if isinstance(piece.shape, ThickPiece | LipPiece) else "face"
    return Exit.WRITTEN, {"filled": filled, "yields": yields, "edge": (edge.mean(), edge.max())}, ()


@contextmanager
def metered() -> Iterator[dict[str, float]]:
    """Fill a dictionary with the `seconds` that pass and the `mb` by which the process grows at most."""
    meter: dict[str, float] = {}
    before, start = _held("VmRSS"), time.perf_counter()
    yield meter
    meter.update(seconds=time.perf_counter() - start, mb=_held("VmHWM") - before)


def _held(row: str) -> float:
    """Memory of this process in MB, now (VmRSS) or at most (VmHWM); nan where the system does not say."""
    status = Path("/proc/self/status")
    if not status.is_file():
        return float("nan")
    return float(status.read_text().split(f"{row}:")[1].split()[0]) / 1024.0


def _cgal(wall: TriangleMesh, hole: Ints) -> TriangleMesh:
    from CGAL.CGAL_Kernel import Point_3
    from CGAL.CGAL_Polygon_mesh_processing import triangulate_refine_and_fair_hole
    from CGAL.CGAL_Polyhedron_3 import Polyhedron_3, Polyhedron_modifier

    build = Polyhedron_modifier()
    build.begin_surface(wall.n_vertices, wall.n_faces)
    for point in wall.vertices.tolist():
        build.add_vertex(Point_3(*point))
    for face in wall.face_vertices.tolist():
        build.begin_facet()
        for vertex in face:
            build.add_vertex_to_facet(vertex)
        build.end_facet()
    build.end_surface()
    polyhedron = Polyhedron_3()
    polyhedron.delegate(build)
    middle = wall.vertices[hole].mean(axis=0)
    border = [(h, h.vertex().point()) for h in polyhedron.halfedges() if h.is_border()]
    at = np.array([(p.x(), p.y(), p.z()) for _, p in border])
    on_hole = border[int(np.argmin(np.linalg.norm(at - middle, axis=1)))][0]
    new_faces: list[Any] = []
    new_vertices: list[Any] = []
    triangulate_refine_and_fair_hole(polyhedron, on_hole, new_faces, new_vertices, np.sqrt(2.0), 1)
    corners = [_corners(face.halfedge()) for face in new_faces]
    return _soup(np.array(corners))


def _corners(start: Any) -> list[tuple[float, float, float]]:
    """Corner points of a CGAL triangle."""
    points = [h.vertex().point() for h in (start, start.next(), start.next().next())]
    return [(p.x(), p.y(), p.z()) for p in points]


def _soup(corners: NDArray[np.float64]) -> TriangleMesh:
    """Triangles (n, 3, 3) as a mesh, each with vertices of its own."""
    return TriangleMesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def _meshlib(wall: TriangleMesh, hole: Ints) -> TriangleMesh:
    from meshlib import mrmeshnumpy, mrmeshpy

    mesh = mrmeshnumpy.meshFromFacesVerts(wall.face_vertices.astype(np.int32), wall.vertices)
    settings = mrmeshpy.FillHoleNicelySettings()
    settings.triangulateParams.metric = mrmeshpy.getUniversalMetric(mesh)
    settings.subdivideSettings.maxEdgeLen = _step(wall, hole)
    settings.subdivideSettings.maxEdgeSplits = 20_000
    settings.smoothCurvature = True
    settings.smoothSettings.naturalSmooth = True
    middle = wall.vertices[hole].mean(axis=0)
    ends = [mesh.edgePoint(edge, 0.5) for edge in mesh.topology.findHoleRepresentiveEdges()]
    away = [np.linalg.norm([p.x - middle[0], p.y - middle[1], p.z - middle[2]]) for p in ends]
    edge = mesh.topology.findHoleRepresentiveEdges()[int(np.argmin(away))]
    mrmeshpy.fillHoleNicely(mesh, edge, settings)
    return TriangleMesh(mrmeshnumpy.getNumpyVerts(mesh), mrmeshnumpy.getNumpyFaces(mesh.topology).astype(np.int64))


def _meshfix(wall: TriangleMesh, hole: Ints) -> TriangleMesh:
    from pymeshfix import PyTMesh

    mesh = PyTMesh()
    mesh.set_quiet(True)
    mesh.load_array(wall.vertices, wall.face_vertices.astype(np.int32))
    mesh.fill_small_boundaries(nbe=len(hole), refine=True)
    vertices, faces = mesh.return_arrays()
    return TriangleMesh(vertices, np.asarray(faces, dtype=np.int64))


def _meshlab(wall: TriangleMesh, hole: Ints) -> TriangleMesh:
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.set_verbosity(False)
    meshes.add_mesh(pymeshlab.Mesh(wall.vertices, wall.face_vertices.astype(np.int32)))
    meshes.meshing_close_holes(
        maxholesize=len(hole) + 1, refinehole=True, refineholeedgelen=pymeshlab.PureValue(_step(wall, hole))
    )
    filled = meshes.current_mesh()
    return TriangleMesh(filled.vertex_matrix(), filled.face_matrix().astype(np.int64))


def _vtk(wall: TriangleMesh, hole: Ints) -> TriangleMesh:
    import pyvista

    radius = float(np.linalg.norm(wall.vertices[hole] - wall.vertices[hole].mean(axis=0), axis=1).max())
    filled = pyvista.PolyData.from_regular_faces(wall.vertices, wall.face_vertices).fill_holes(1.5 * radius)
    return TriangleMesh(np.asarray(filled.points, dtype=np.float64), filled.regular_faces.astype(np.int64))


def _plate(wall: TriangleMesh, hole: Ints) -> TriangleMesh:
    from OCP.Geom import Geom_Plane
    from OCP.GeomPlate import GeomPlate_BuildPlateSurface, GeomPlate_MakeApprox, GeomPlate_PointConstraint
    from OCP.gp import gp_Dir, gp_Pnt

    chosen = hole[np.linspace(0, len(hole), min(PLATE_POINTS, len(hole)), endpoint=False).astype(np.int64)]
    normals = vertex_normals(wall.vertices, wall.face_vertices)[chosen]
    builder = GeomPlate_BuildPlateSurface(3, 15, 3)
    for point, normal in zip(wall.vertices[chosen].tolist(), normals.tolist()):
        plane = Geom_Plane(gp_Pnt(*point), gp_Dir(*normal))
        builder.Add(GeomPlate_PointConstraint(0.0, 0.0, plane, 1, 1e-3, 1e-2, 0.1))
    builder.Perform()
    surface = GeomPlate_MakeApprox(builder.Surface(), PLATE_ERROR, 30, 8, 0.1, 0).Surface()
    u = np.linspace(*surface.Bounds()[:2], PLATE_ROWS)
    v = np.linspace(*surface.Bounds()[2:], PLATE_ROWS)
    points = np.array([(p.X(), p.Y(), p.Z()) for s in u for p in (surface.Value(s, t) for t in v)])
    at = np.arange(PLATE_ROWS**2).reshape(PLATE_ROWS, PLATE_ROWS)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    return TriangleMesh(points, np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3))


def _step(wall: TriangleMesh, hole: Ints) -> float:
    """Usual length of the edges round the hole."""
    points = wall.vertices[hole]
    return float(np.median(np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)))


FILLERS = {
    "CGAL refine and fair": Filler("CGAL", "cgal", "mesh", _cgal),
    "MeshLib": Filler("meshlib", "meshlib", "mesh", _meshlib),
    "MeshFix": Filler("pymeshfix", "pymeshfix", "mesh", _meshfix),
    "MeshLab": Filler("pymeshlab", "pymeshlab", "mesh", _meshlab),
    "VTK": Filler("pyvista", "pyvista", "mesh", _vtk),
    "OCC GeomPlate": Filler("OCP", "cadquery-ocp", "face", _plate),
}
