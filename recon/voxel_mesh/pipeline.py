"""From a binary grid to the surface of a CAD solid, in the steps of the paper.

marching cubes -> feature voxels -> constrained collapse: the boundary as few triangles (`voxel_boundary`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadOption, NotManifold
from recon.geometry.mesh import TriangleMesh
from recon.geometry.voxel_grid import VoxelGrid
from recon.voxel_mesh.feature_voxels import feature_voxels
from recon.voxel_mesh.marching_cubes import GridSurface, marching_cubes
from recon.voxel_mesh.simplify import Goal, simplified
from recon.voxel_mesh.topology import Topology, grid_topology, mesh_topology

__all__ = ["VoxelBoundary", "VoxelOptions", "voxel_boundary"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class VoxelOptions:
    """What the boundary shall be like.

    tolerance      largest distance to the marching cubes surface, in voxels, both ways; None leaves it open
    n_faces        stop at this many faces
    reduction      or when this share of the faces is gone; neither: as far as the tolerance goes
    features       protect feature voxels by the paper's three rules
    opening, closing  radii of the two balls that find them, in voxels
    Raises  BadOption when a value makes no sense, or nothing says when to stop.
    """

    tolerance: float | None = 0.5
    n_faces: int | None = None
    reduction: float | None = None
    features: bool = False
    opening: float = 3.0
    closing: float = 2.0

    def __post_init__(self) -> None:
        if self.tolerance is not None and not self.tolerance > 0:
            raise BadOption("--tolerance", "must be positive")
        if self.n_faces is not None and self.n_faces < 4:
            raise BadOption("--faces", "a closed surface has at least 4 faces")
        if self.reduction is not None and not 0.0 <= self.reduction < 1.0:
            raise BadOption(
                "--reduction", f"is the share of the faces that go, from 0 to below 1, not {self.reduction}"
            )
        if self.n_faces is not None and self.reduction is not None:
            raise BadOption("--faces", "say how many faces are left or which share goes, not both")
        if self.tolerance is None and self.n_faces is None and self.reduction is None:
            raise BadOption("--fast", "bounds no error, so say where to stop: --faces or --reduction")

    def goal(self, n_before: int) -> Goal:
        """When the collapse of a surface of so many faces stops."""
        n = self.n_faces if self.n_faces is not None else n_before * (1.0 - (self.reduction or 1.0))
        return Goal(max(4, round(n)) if self.reduction is not None or self.n_faces else 4, self.tolerance)


@dataclass(frozen=True, eq=False)
class VoxelBoundary:
    """The boundary and how it compares with the grid's own; lengths named `voxels` are in smallest spacings.

    mesh             closed, in model units
    surface          the marching cubes surface, in voxels
    topology         bodies, cavities, genus, the same for grid and mesh
    errors           (n,) distances found between mesh and surface, both ways, in voxels
    """

    mesh: TriangleMesh
    surface: GridSurface
    topology: Topology
    errors: Floats
    n_feature_voxels: int | None
    n_features_kept: int | None

    @property
    def reduction(self) -> float:
        """Share of the faces that went."""
        return 1.0 - self.mesh.n_faces / len(self.surface.face_vertices)

    def figures(self) -> dict[str, Any]:
        """Figures of the command line's JSON."""
        return {
            "faces_marching_cubes": len(self.surface.face_vertices),
            "faces": self.mesh.n_faces,
            "reduction": self.reduction,
            "max_error_voxels": float(self.errors.max()),
            "rms_error_voxels": float(np.sqrt((self.errors**2).mean())),
            "feature_voxels": self.n_feature_voxels,
            "features_kept": self.n_features_kept,
            **self.topology._asdict(),
        }


def voxel_boundary(
    grid: VoxelGrid, options: VoxelOptions = VoxelOptions(), *, doing: Callable[[str], None] = lambda text: None
) -> VoxelBoundary:
    """Boundary of the solid voxels as a closed triangle mesh with few faces.

    Promises  bodies, cavities and genus are those of the grid; no face cuts another; the error is within the tolerance.
    Raises    Refusal when that cannot be had; BadOption.
    """
    doing("marching cubes")
    surface = marching_cubes(grid)
    before = grid_topology(grid.solid)
    feature, n_features = None, None
    if options.features:
        doing("looking for feature voxels")
        found = feature_voxels(grid, opening=options.opening, closing=options.closing)
        mask = found.convex | found.concave
        feature, n_features = mask[tuple(surface.solid_voxels().T)], int(mask.sum())
    doing("collapsing edges")
    less = simplified(surface, grid.proportions, options.goal(len(surface.face_vertices)), feature=feature, doing=doing)
    after = mesh_topology(less.vertices, less.face_vertices)
    if after != before:
        raise NotManifold(grid.name, f"the mesh has {after}, the voxels {before}")
    kept = None if feature is None else less.features_kept
    mesh = grid.placed(less.vertices, less.face_vertices)
    return VoxelBoundary(mesh, surface, before, less.errors, n_features, kept)
