"""What a solid of a grid has to be: sound by the gate, and around the voxel centres that are solid."""

from OCP.TopoDS import TopoDS_Shape

from brep_export.check import ShapeKind, check
from brep_export.triangulation import triangulate
from recon.errors import NoSolid
from recon.geometry.mesh import TriangleMesh
from recon.geometry.voxel_grid import VoxelGrid
from recon.tolerance import Tolerance
from recon.voxel_mesh.revoxelise import WrongSide, wrong_side

__all__ = ["DEEPEST", "DEFLECTION", "FIT", "FLAT", "held_against", "proved"]

FLAT = 1e-3  # voxels: triangles this near to one plane become one face
FIT = 0.05  # voxels: how far edges may lie from their faces
DEFLECTION = 0.01  # voxels: of the triangles that are compared with the grid
DEEPEST = 0.5  # voxels: a centre farther on the wrong side than this is a feature that was missed


def proved(shape: TopoDS_Shape, voxel: float) -> None:
    """Let a shape through the gate.

    Raises  NoSolid when it refuses the shape.
    """
    report = check(shape, Tolerance(merge=FLAT * voxel, fit=FIT * voxel), expect=ShapeKind.SOLID)
    if not report.passed:
        raise NoSolid(f"the surfaces that were recognised make no sound solid ({report.defects[0]})")


def held_against(grid: VoxelGrid, shape: TopoDS_Shape) -> tuple[TriangleMesh, WrongSide]:
    """A shape as triangles, and the voxel centres on its wrong side.

    Raises  NoSolid when one lies deep there.
    """
    mesh = triangulate(shape, DEFLECTION * grid.voxel).mesh
    wrong = wrong_side(grid, mesh)
    if wrong.deepest > DEEPEST:
        raise NoSolid(
            f"the surfaces that were recognised miss something: {wrong.centres} voxel centres lie on the wrong side,"
            f" one {wrong.deepest:.1f} voxels deep"
        )
    return mesh, wrong
