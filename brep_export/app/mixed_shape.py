"""A part with true faces in part: the solid with triangles for the rest, on ever fewer sheets until one is sound."""

from dataclasses import dataclass

from OCP.TopoDS import TopoDS_Shape

from brep_export.app.voxel_proof import held_against, proved
from brep_export.app.workshop import Bench
from brep_export.mixed import RefusedFaces, mixed_solid
from brep_export.solids import polyhedron_solid
from recon.errors import NoSolid, Refusal
from recon.geometry.analytic import Plane
from recon.geometry.mesh import TriangleMesh
from recon.geometry.mixed import MixedBoundary
from recon.geometry.polyhedron import Polyhedron, triangle_polyhedron
from recon.voxel_mesh.mixed_part import MixedPart, mixed_boundary
from recon.voxel_mesh.open_intervals import open_interval
from recon.voxel_mesh.revoxelise import WrongSide

__all__ = ["MixedShape", "mixed_shape"]

KINDS = {"Plane": "planes", "Cylinder": "cylinders", "Cone": "cones", "Sphere": "spheres"}


@dataclass(frozen=True, eq=False)
class MixedShape:
    """A part's boundary with its kernel shape, proved, as triangles, and the voxel centres on its wrong side.

    polyhedron  the same as arrays, where it has no true face
    """

    part: MixedPart
    boundary: MixedBoundary
    shape: TopoDS_Shape
    mesh: TriangleMesh
    wrong: WrongSide
    polyhedron: Polyhedron | None

    def intervals(self) -> list[tuple[float, float]]:
        """How far each surface may move along its normal without a centre changing sides, in model units."""
        ends, voxel = self.part.ends, self.part.grid.voxel
        found = [open_interval(s.surface, ends.solid[s.members], ends.empty[s.members]) for s in self.part.sheets]
        return [(low * voxel, high * voxel) for low, high in found]

    def kinds(self) -> dict[str, int]:
        """True faces by kind, and how many triangles stay."""
        counts = dict.fromkeys([*KINDS.values(), "tori"], 0)
        for face in self.boundary.faces:
            if face.surface is not None:
                counts[KINDS[type(self.boundary.surfaces[face.surface]).__name__]] += 1
        return counts | {"fallback_faces": self.boundary.n_triangles}


def mixed_shape(part: MixedPart, tolerance: float, bench: Bench) -> MixedShape:
    """The part with as many of its sheets as make a sound solid.

    tolerance  voxels that triangles may lie off the smoothed surface
    Raises     NoSolid when not even one of triangles alone is sound.
    """
    while True:
        try:
            return _built(part, tolerance, bench)
        except RefusedFaces as refused:
            part = part.without(refused.surfaces)
        except (NoSolid, Refusal) as problem:
            if not part.sheets:
                raise NoSolid(f"{problem}") from problem
            round_ones = [k for k, sheet in enumerate(part.sheets) if not isinstance(sheet.surface, Plane)]
            part = part.without(round_ones or range(len(part.sheets)))


def _built(part: MixedPart, tolerance: float, bench: Bench) -> MixedShape:
    with bench.phase("reconstruct", "parting the surface"):
        boundary = mixed_boundary(part, tolerance, doing=bench.doing)
    with bench.phase("brep", "building the solid"):
        polyhedron = None if part.sheets else triangle_polyhedron(boundary.triangle_mesh())
        shape = mixed_solid(boundary) if polyhedron is None else polyhedron_solid(polyhedron)
        proved(shape, part.grid.voxel)
        return MixedShape(part, boundary, shape, *held_against(part.grid, shape), polyhedron)
