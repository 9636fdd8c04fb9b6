"""Whether a piece of a rim can be the lost one: what its neighbours say, beside the kernel's gate.

A piece may be a valid solid and still be wrong: where the hole's edge was put together wrongly, the piece is a part of
the lost one, or lies partly within its neighbours. They know better:

     measured edge        all along the piece's own edge, and nowhere else
     measured fracture    of the neighbours: the piece lies against nearly all of it
     wall beside          its normals go on at the piece's edge, it is as thick as the piece, and does not reach under
                          the piece's face

Each figure is a share or a ratio, so that it holds for vessels of any size.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import NoSurface
from recon.geometry.trimmed import LipPiece
from recon.hole_patch.surroundings import Surroundings
from recon.numerics.foot_points import foot_points
from recon.numerics.halfedges import vertex_normals
from recon.numerics.polygons import within

__all__ = ["RimFigures", "check_rim_piece", "fracture_met", "rim_figures"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

NEAR = 0.3  # of the wall's thickness: what lies nearer is met; chips and relief are smaller
MOST_BRIDGED = 0.15  # of the piece's edge in one stretch; gaps between sherds take a few hundredths
LEAST_EDGE = 0.8  # of the measured edge; hairs and spikes take a tenth
TALL = 2.0  # thicknesses from the outer edge of the hole: fracture beyond is that of a lump, or of a thick floor
LEAST_FRACTURE = 0.9  # of its area; right pieces meet 0.98 and more
MOST_TURNED = 0.1  # of the edge; relief turns normals by 30 degrees at most
TURNED = 0.5  # cosine beyond which the wall does not go on
MOST_COVERED = 0.1  # of the piece's face
THICKNESS = (0.7, 1.4)  # of the wall's
FEWEST = 30  # of them that see the other side
PROBES = 300  # vertices at which the wall's thickness is measured


@dataclass(frozen=True)
class RimFigures:
    """What was measured on a piece of a rim.

    bridged    longest stretch of its edge with no measured edge beside it, as a share of the whole
    edge       share of the measured edge that it meets
    fracture   share of the neighbours' fracture, by area, that it meets; 1 where none was scanned
    turned     share of the measured edge where the wall's normal and the piece's differ by more than 60 degrees
    covered    share of its face that lies on wall that is there
    thickness  its own over that of the wall around it; 1 where the wall does not show it
    """

    bridged: float
    edge: float
    fracture: float
    turned: float
    covered: float
    thickness: float

    def problem(self) -> str:
        """What is wrong with the piece, or nothing."""
        if self.edge < LEAST_EDGE:
            return f"its edge follows {self.edge:.0%} of the scanned edge of the hole only ({LEAST_EDGE:.0%} needed)"
        if self.bridged > MOST_BRIDGED:
            return f"{self.bridged:.0%} of its edge in one stretch were not scanned ({MOST_BRIDGED:.0%} allowed)"
        if self.fracture < LEAST_FRACTURE:
            return f"it meets {self.fracture:.0%} of its neighbours' fracture only ({LEAST_FRACTURE:.0%} needed)"
        if self.turned > MOST_TURNED:
            return f"the walls around do not go on in it over {self.turned:.0%} of its edge ({MOST_TURNED:.0%} allowed)"
        if self.covered > MOST_COVERED:
            return f"{self.covered:.0%} of its face lie on wall that is there ({MOST_COVERED:.0%} allowed)"
        if not THICKNESS[0] <= self.thickness <= THICKNESS[1]:
            return f"it is {self.thickness:.2f} times as thick as the wall around it"
        return ""


def check_rim_piece(piece: LipPiece, around: Surroundings, *, clearance: float = 0.0) -> None:
    """Raises  NoSurface, with the reason, when the piece cannot be the lost one; clearance as of `rim_figures`."""
    problem = rim_figures(piece, around, clearance=clearance).problem()
    if problem:
        raise NoSurface(
            f"The piece of the rim cannot be right: {problem}. The hole's edge, or what is wall and what is fracture,"
            " was misread there: look at the sherds around the hole for chips, gaps and scanning holes at their edges."
        )


def rim_figures(piece: LipPiece, around: Surroundings, *, clearance: float = 0.0) -> RimFigures:
    """Measure a piece of a rim against its neighbours.

    clearance  in millimetres, that the piece keeps from them
    """
    surface, wall = piece.face.surface, around.outer
    uv = piece.face.loops[0].polygon(256)
    loop = surface.point(uv)
    fracture = np.concatenate([_grid_of(piece, k) for k in range(len(piece.wall))])
    rungs = np.linalg.norm(fracture[:, 0] - fracture[:, -1], axis=1)
    thick = float(np.median(rungs))
    near = NEAR * thick + clearance
    measured = wall.edge.sherds >= 0
    edge = wall.edge.points[measured]
    met = cKDTree(loop).query(edge)[0] < near
    inside = _inside(uv)
    normals = vertex_normals(wall.measured.vertices, wall.measured.face_vertices)
    return RimFigures(
        bridged=_longest(loop, cKDTree(edge).query(loop)[0] >= near),
        edge=float(met.mean()),
        fracture=fracture_met(fracture.reshape(-1, 3), around, near, thick),
        turned=_turned(piece, edge[met], None if wall.edge.normals is None else wall.edge.normals[measured][met]),
        covered=_covered(surface.point(inside), surface.normal(inside), (wall.measured.vertices, normals), loop, near),
        thickness=_thickness_ratio(loop, rungs, (wall.measured.vertices, normals), thick),
    )


def _grid_of(piece: LipPiece, k: int) -> Floats:
    wall = piece.wall[k]
    return wall.grid(np.linspace(*wall.domain[0], 200), np.linspace(*wall.domain[1], 9))


def _longest(loop: Floats, alone: Bools) -> float:
    """Length of the longest run of points that are alone, as a share of the loop."""
    steps = np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1)
    if alone.all() or not alone.any():
        return float(alone.all())
    start = int(np.argmin(alone))
    alone, steps = np.roll(alone, -start), np.roll(steps, -start)
    run = np.cumsum(np.diff(np.concatenate([[False], alone]).astype(int)) == 1)
    return float(np.bincount(run[alone], steps[alone]).max() / steps.sum())


def fracture_met(points: Floats, around: Surroundings, near: float, thick: float) -> float:
    """Share of the neighbours' fracture, by area, nearer than a length to points (m, 3) of the piece's; 1 for none.

    near, thick  lengths in millimetres: what is met, and the thickness of the piece's wall; of fracture farther than
                 `TALL` of it from the hole's outer edge none is asked
    """
    if around.fracture is None or around.fracture.n_faces == 0:
        return 1.0
    centres = around.fracture.corners().mean(axis=1)
    area = np.linalg.norm(around.fracture.area_vectors(), axis=1)
    area[cKDTree(around.outer.edge.points).query(centres)[0] > TALL * thick] = 0.0
    away = cKDTree(points).query(centres)[0]
    return float(area[away < near].sum() / area.sum()) if area.any() else 1.0


def _turned(piece: LipPiece, edge: Floats, normals: Floats | None) -> float:
    if normals is None or len(edge) == 0:
        return 0.0
    uv = piece.face.loops[0].polygon(256)
    surface = piece.face.surface
    start = uv[cKDTree(surface.point(uv)).query(edge)[1]]
    along = np.einsum("ij,ij->i", surface.normal(foot_points(surface, edge, start)), normals)
    return float((along < TURNED).mean())


def _inside(polygon: Floats, n: int = 60) -> Floats:
    """(m, 2) points of an n x n grid within a closed polygon."""
    steps = np.linspace(polygon.min(axis=0), polygon.max(axis=0), n)
    grid = np.stack(np.meshgrid(*steps.T, indexing="ij"), axis=-1).reshape(-1, 2)
    return grid[within(polygon, grid)]


def _covered(points: Floats, normals: Floats, wall: tuple[Floats, Floats], loop: Floats, near: float) -> float:
    """Share of the points, away from the edge, beside a vertex of the wall that faces the same way."""
    clear = cKDTree(loop).query(points)[0] > 2.0 * near
    if not clear.any():
        return 0.0
    away, index = cKDTree(wall[0]).query(points[clear])
    same = np.einsum("ij,ij->i", normals[clear], wall[1][index]) > TURNED
    return float(((away < near) & same).mean())


def _thickness_ratio(loop: Floats, rungs: Floats, wall: tuple[Floats, Floats], thick: float) -> float:
    """Median rung over the median distance, square through the wall beside the piece, from one side to the other."""
    beside = np.flatnonzero(cKDTree(loop).query(wall[0])[0] < 2.0 * thick)
    points, normals = wall[0][beside], wall[1][beside]
    if len(points) < FEWEST:
        return 1.0
    probes = np.arange(0, len(points), max(1, len(points) // PROBES))
    pairs = cKDTree(points[probes]).sparse_distance_matrix(cKDTree(points), 2.5 * thick, output_type="coo_matrix")
    i, j = probes[pairs.row], pairs.col
    way = points[j] - points[i]
    through = -np.einsum("ij,ij->i", way, normals[i])
    facing = np.einsum("ij,ij->i", normals[i], normals[j]) < -0.9
    square = facing & (through > 0.9 * np.linalg.norm(way, axis=1))
    if len(np.unique(i[square])) < FEWEST:
        return 1.0
    least = np.full(len(points), np.inf)
    np.minimum.at(least, i[square], through[square])
    return thick / float(np.median(least[np.isfinite(least)]))
