"""One binary grid to one kernel shape, with flat facets or with true faces, and the figures that go with it."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OCP.TopoDS import TopoDS_Shape

from brep_export.analytic import analytic_solid, face_kinds
from brep_export.app.listed_surfaces import free_regions, listed_blends, listed_surfaces
from brep_export.app.mixed_shape import mixed_shape
from brep_export.app.voxel_proof import DEEPEST, FLAT, held_against, proved
from brep_export.app.workshop import Bench
from brep_export.solids import polyhedron_solid
from brep_export.triangulation import triangulate
from brep_export.turned import turned_solid
from recon.errors import NoSolid, NotManifold
from recon.geometry.mesh import TriangleMesh
from recon.geometry.polyhedron import Polyhedron, merge_coplanar, triangle_polyhedron
from recon.geometry.turned import ProfileLine, TurnedPart
from recon.geometry.voxel_grid import VoxelGrid
from recon.numerics.distance import closest_points, sample_surface
from recon.voxel_mesh.analytic_part import AnalyticPart, analytic_part, free_part
from recon.voxel_mesh.marching_cubes import marching_cubes
from recon.voxel_mesh.mixed_part import MixedPart
from recon.voxel_mesh.pipeline import VoxelOptions, voxel_boundary
from recon.voxel_mesh.revoxelise import WrongSide, turned_wrong_side, wrong_side
from recon.voxel_mesh.topology import grid_topology
from recon.voxel_mesh.turned import turned_part

__all__ = ["VoxelBody", "analytic_body", "faceted_body", "smooth_body"]

Floats = NDArray[np.float64]

SMOOTHED = 0.1  # voxels that triangles may lie off the smoothed surface, with the usual tolerance of 0.5
FACETED = 0.05  # voxels that triangles may lie off true faces
TURNED_DEFLECTION = 0.03  # voxels: the same for turned splines, which take ten times as many triangles
SAME = 0.03  # voxels: a grid made from triangles has its own centres on the wrong side of round faces by this much
FEW = (
    0.005  # of the steps from voxel to voxel across the surface may have such centres; a whole face of them is too much
)
PROBES = 20_000
OF_TRUE_FACES = frozenset({"mixed-faces", "left-sharp", "wrong-side"})  # notes that say nothing of triangles


@dataclass(frozen=True, eq=False)
class VoxelBody:
    """Shape of a grid, errors (n,) in model units against the grid's marching cubes surface, and figures.

    polyhedron  the same shape as arrays, where it has planar faces alone
    """

    shape: TopoDS_Shape
    errors: Floats
    figures: dict[str, Any]
    polyhedron: Polyhedron | None = None


def faceted_body(grid: VoxelGrid, options: VoxelOptions, *, bench: Bench) -> VoxelBody:
    """Planar faces: the simplified boundary, coplanar triangles joined."""
    with bench.phase("reconstruct", "finding the boundary"):
        boundary = voxel_boundary(grid, options, doing=bench.doing)
    with bench.phase("brep", "building the solid"):
        polyhedron = _polyhedron(boundary.mesh, FLAT * grid.voxel, bench)
        shape = polyhedron_solid(polyhedron)
    figures = boundary.figures() | {"analytic": None}
    return VoxelBody(shape, boundary.errors * grid.voxel, figures, polyhedron)


def _polyhedron(mesh: TriangleMesh, tolerance: float, bench: Bench) -> Polyhedron:
    """One face a flat region; one a triangle where flats are too small to tell apart."""
    try:
        return merge_coplanar(mesh, tolerance)
    except NotManifold as problem:
        bench.note(f"coplanar triangles were not merged ({problem})", name="not-merged")
        return triangle_polyhedron(mesh)


def analytic_body(grid: VoxelGrid, options: VoxelOptions, *, snap: float | None, bench: Bench) -> VoxelBody:
    """True faces where the part has them, and, with a note, triangles of the smoothed surface where it has none; with
    another note the faceted body, where even these make no solid like the grid.
    """
    turned = _turned_shape(grid, bench)
    if turned is not None and turned.is_curved:
        return _turned_body(grid, turned, snap, bench)
    mixed: MixedPart | None = None
    try:
        with bench.phase("reconstruct", "recognising surfaces"):
            part = analytic_part(grid, doing=bench.doing)
            mixed = part.mixed
        with bench.phase("brep", "building the solid"):
            built = _snapped(part, snap, bench) or _built(part)
        return _analytic(grid, built, bench)
    except NoSolid as problem:
        why = f"no solid of true faces alone: {problem}"
    try:
        return _mixed_body(mixed or free_part(grid), options, why, bench)
    except NoSolid as problem:
        bench.note(f"{why} Nor of true faces and triangles: {problem} It has flat facets instead.", name="flat-facets")
        body = faceted_body(grid, options, bench=bench)
        kinds = {"planes": 0, "cylinders": 0, "cones": 0, "spheres": 0, "tori": 0}
        figures = body.figures | {"analytic": kinds | {"fallback_faces": body.figures["faces"]}}
        return VoxelBody(body.shape, body.errors, figures, body.polyhedron)


def _mixed_body(part: MixedPart, options: VoxelOptions, why: str, bench: Bench) -> VoxelBody:
    """True faces where the voxels bear them out, triangles of the smoothed surface elsewhere."""
    made = mixed_shape(part, _smoothed(options), bench)
    kinds = made.kinds()
    n_true = sum(kinds.values()) - kinds["fallback_faces"]
    bench.note(
        f"{why} {n_true} faces are true ones, {kinds['fallback_faces']} are triangles where none was recognised.",
        name="mixed-faces",
    )
    rows = listed_surfaces(made.boundary.surfaces, made.intervals()) + free_regions(made.boundary)
    body = _true_faces(part.grid, made.shape, made.mesh, made.wrong, rows, bench)
    return VoxelBody(body.shape, body.errors, body.figures | {"analytic": kinds}, made.polyhedron)


def _smoothed(options: VoxelOptions) -> float:
    """Voxels that triangles may lie off the smoothed surface."""
    return SMOOTHED if options.tolerance is None else SMOOTHED * options.tolerance / 0.5


def smooth_body(grid: VoxelGrid, options: VoxelOptions, *, bench: Bench) -> VoxelBody:
    """Planar faces on the surface without terraces: on the part's own surfaces where they are recognised."""
    inner = replace(bench, notes=[], silenced=bench.silenced | OF_TRUE_FACES)
    body = analytic_body(grid, options, snap=None, bench=inner)
    if "surfaces" not in body.figures:  # the terraces are still there, and the notes say why
        bench.notes += inner.notes
    if body.polyhedron is None:
        with bench.phase("brep", "dividing the faces into triangles"):
            mesh = triangulate(body.shape, FACETED * grid.voxel).mesh
            polyhedron = triangle_polyhedron(mesh)
            shape = polyhedron_solid(polyhedron)
        body = _true_faces(grid, shape, mesh, wrong_side(grid, mesh), [], bench)
        body = VoxelBody(shape, body.errors, body.figures | {"faces": mesh.n_faces}, polyhedron)
    return VoxelBody(body.shape, body.errors, body.figures | {"analytic": None, "surfaces": None}, body.polyhedron)


@dataclass(frozen=True, eq=False)
class _Turned:
    """A part turned about an axis, held against its grid."""

    part: TurnedPart
    shape: TopoDS_Shape
    mesh: TriangleMesh
    wrong: WrongSide

    @property
    def is_curved(self) -> bool:
        """Whether its profile has more than straight lines: those the recognition of single surfaces finds as well."""
        return any(not isinstance(piece, ProfileLine) for loop in self.part.loops for piece in loop)


def _turned_shape(grid: VoxelGrid, bench: Bench) -> _Turned | None:
    """The part as a solid of revolution; None where it is none."""
    try:
        with bench.phase("reconstruct", "looking for an axis"):
            part = turned_part(grid, doing=bench.doing)
        with bench.phase("brep", "turning the profile"):
            shape = turned_solid(part)
            proved(shape, grid.voxel)
            mesh = triangulate(shape, TURNED_DEFLECTION * grid.voxel).mesh
            wrong = turned_wrong_side(grid, part)
    except NoSolid:
        return None
    return _Turned(part, shape, mesh, wrong) if wrong.deepest <= DEEPEST else None


def _turned_body(grid: VoxelGrid, turned: _Turned, snap: float | None, bench: Bench) -> VoxelBody:
    if snap is not None:
        bench.note("not snapped: a turned part keeps the sizes of its fitted profile", name="not-snapped")
    rows: list[dict[str, Any]] = [
        {"kind": "axis", "point": turned.part.origin.tolist(), "direction": turned.part.axis.tolist()}
    ]
    return _true_faces(grid, turned.shape, turned.mesh, turned.wrong, rows, bench)


Built = tuple[AnalyticPart, TopoDS_Shape, TriangleMesh, WrongSide, int]


def _built(part: AnalyticPart) -> Built:
    """The solid of a part, held against its grid.

    Raises  NoSolid when it cannot be built, the gate refuses it, or some voxel lies deep on its wrong side.
    """
    voxel = part.grid.voxel
    shape, refused = analytic_solid(part.surfaces, part.blends, box=part.box, voxel=voxel, is_solid=part.vote())
    proved(shape, voxel)
    mesh, wrong = held_against(part.grid, shape)
    return part, shape, mesh, wrong, len(refused)


def _snapped(part: AnalyticPart, snap: float | None, bench: Bench) -> Built | None:
    """The part at round values, where it gives the same voxels again, but for centres right on its surface; its axes
    where they are, where round places for them do not.
    """
    if snap is None:
        return None
    built, problem = _as_snapped(part.snapped(snap))
    if problem:
        built, _ = _as_snapped(part.snapped(snap, places=False))
    if built is None:
        bench.note(f"not snapped: {problem}", name="not-snapped")
    elif problem:
        bench.note(f"axes were not snapped, sizes were: {problem}", name="axes-not-snapped")
    return built


def _as_snapped(part: AnalyticPart) -> tuple[Built | None, str]:
    """The built part, or why it may not stand for its grid."""
    try:
        built = _built(part)
    except NoSolid as problem:
        return None, str(problem)
    wrong, solid = built[3], part.grid.solid
    steps = sum(np.count_nonzero(np.diff(solid, axis=axis)) for axis in range(3))
    if wrong.deepest > SAME or wrong.centres > FEW * steps:
        return None, f"{wrong.centres} voxels would change sides, one by {wrong.deepest:.2f} voxels"
    return built, ""


def _analytic(grid: VoxelGrid, built: Built, bench: Bench) -> VoxelBody:
    part, shape, mesh, wrong, refused = built
    if refused:
        bench.note(f"{refused} rounded edges were left sharp: the kernel could not round them", name="left-sharp")
    return _true_faces(
        grid, shape, mesh, wrong, listed_surfaces(part.surfaces, part.intervals) + listed_blends(part.blends), bench
    )


def _true_faces(
    grid: VoxelGrid, shape: TopoDS_Shape, mesh: TriangleMesh, wrong: WrongSide, rows: list[dict[str, Any]], bench: Bench
) -> VoxelBody:
    surface = marching_cubes(grid)
    own = grid.placed(surface.vertices, surface.face_vertices)
    there, back = (sample_surface(m.vertices, m.face_vertices, PROBES) for m in (own, mesh))
    errors = np.concatenate(
        [
            closest_points(there, mesh.vertices, mesh.face_vertices).distances,
            closest_points(back, own.vertices, own.face_vertices).distances,
        ]
    )
    if wrong.centres:
        wide = f"{wrong.centres} voxel centres lie on the wrong side, the deepest {wrong.deepest:.2f} voxels"
        bench.note(wide, name="wrong-side")
    kinds = face_kinds(shape)
    figures = {
        "faces_marching_cubes": own.n_faces,
        "faces": sum(kinds.values()),
        "reduction": 1.0 - sum(kinds.values()) / own.n_faces,
        "max_error_voxels": float(errors.max()) / grid.voxel,
        "rms_error_voxels": float(np.sqrt((errors**2).mean())) / grid.voxel,
        "feature_voxels": None,
        "features_kept": None,
        **grid_topology(grid.solid)._asdict(),
        "analytic": kinds | {"fallback_faces": 0},
        "voxels_on_wrong_side": wrong.centres,
        "surfaces": rows,
    }
    return VoxelBody(shape, errors, figures)
