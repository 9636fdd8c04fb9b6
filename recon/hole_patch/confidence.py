"""What is invented is marked: by how much each point of the piece may stand off from what was lost.

Along its edge the piece was measured. Away from it three things are not known, and each is estimated from the vessel at
hand: what the edge no longer tells of relief and of sherds out of place, whether the fits would agree if one sherd had
not been found, and, off the neighbours' fracture, how the crack ran.

     σ ^         .------------.         level inside: scatter r of the wall about the fit, edge's own stand-off e,
       |       .'              '.       disagreement J of the fits
       |     .'                  '.
       |____'                      '____ at the edge: s, by which the face misses what was measured, and what was
       +----+---- hole -------------+--> along the wall      measured is itself out of place

    σ²(p) = s² + J²(p) + (1 - ρ²) (r² + e²)         root of the mean square error that is to be expected
    ρ(d)  = exp(-(d / ℓ)²)                          correlation with the edge, d away from p: what is left is the
                                                    variance of simple kriging
    J²(p) = (n - 1) / n Σ_k (f_k(p) - f̄(p))²        jackknife; f_k the fit without sherd k of the n around the hole

Errors of a wall are heavier in the middle and in the tails than a normal law: `SHARE` of the points lie within `BOUND`
times σ, as measured on vessels that the package makes.

Of the volume σ is the root of the sum of three squares, ∫ σ dA over the outer wall, the inner one and the fracture:
each is off as a whole, as a crack leans that was not scanned, and knows nothing of the others.

Paper  [quenouille1956], the jackknife; [matheron1963], the variance of kriging.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from threadpoolctl import threadpool_limits

from recon.errors import NoSurface
from recon.geometry.bspline import BSplineSurface
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import TrimmedSurface
from recon.hole_patch.fitting import SAMPLE_RADIUS, edge_samples, fit_surface
from recon.hole_patch.pipeline import MissingPiece
from recon.hole_patch.relief import ReliefSheet, ReliefSource
from recon.hole_patch.settling import Settling
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.surroundings import Axis, ShownThickness, Wall
from recon.hole_patch.wheel_sheet import WallFit, fit_any_wall, fit_wall
from recon.numerics.distance import TriangleTree
from recon.numerics.foot_points import foot_points
from recon.numerics.polygons import within

__all__ = ["ASSUMED", "BOUND", "SHARE", "Confidence", "PieceErrors", "WallConfidence", "confidence"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

ASSUMED = (
    "nothing stood on the lost sherd alone: of a handle, a spout or a stamp that left no trace on its neighbours no"
    " expected error knows"
)
SHARE, BOUND = 0.9, 1.645  # of points, within so many σ: of a normal law, and kept on the vessels of the tests
MOST_FACES = 6000  # of a wall that is fitted again without each sherd; the fits differ by far more than this loses
GRID = 24  # points a direction where the fits are compared
BESIDE = 12  # points of the edge over which its own stand-off is averaged
FEW, CHUNK = 200, 4000  # points of the edge that stand for all of it, and points that are asked for at once
ON_WALL = 0.02  # mm: of triangles' corners, which lie on the faces but for rounding
CRUMBLED = 0.5  # mm by which a fracture that was not scanned may stand off, a millimetre away from what was


@dataclass(frozen=True, eq=False)
class WallConfidence:
    """How far one wall of the piece may be trusted.

    surface    of the wall's sheet
    missed     s in millimetres: how far the face misses the edge, and how far single sherds and all are out of place
    scatter    r in millimetres, less the share of relief that was continued
    fading     ℓ in millimetres
    n_left_out number of sherds without which the wall was fitted again
    places     (k, 2) parameters spread evenly over the hole
    """

    surface: BSplineSurface
    missed: float
    scatter: float
    fading: float
    n_left_out: int
    places: Floats
    _disagreement: RegularGridInterpolator = field(repr=False)
    _edge: "_Edge" = field(repr=False)

    def at_parameters(self, uv: Floats) -> Floats:
        """(m,) σ in millimetres at parameters (m, 2) of the surface."""
        away, stand_off = self._edge.beside(uv)
        rho = np.exp(-((away / self.fading) ** 2))
        unknown = (1.0 - rho**2) * (self.scatter**2 + stand_off**2)
        return np.asarray(np.sqrt(self.missed**2 + self._disagreement(uv) ** 2 + unknown))


@dataclass(frozen=True, eq=False)
class PieceErrors:
    """What is to be expected of a piece as triangles, as roots of mean squares.

    at_vertices  (V,) in millimetres
    volume       of its volume, in mm³; means nothing for an open piece
    """

    at_vertices: Floats
    volume: float


@dataclass(frozen=True, eq=False)
class Confidence:
    """How far each point of a piece may be trusted.

    outer, inner  its walls; inner is None for a face, and at the lip, which outer runs over
    """

    outer: WallConfidence
    inner: WallConfidence | None
    _measured: TriangleTree | cKDTree = field(repr=False)

    def over_walls(self) -> Floats:
        """(k,) σ at points spread evenly over both walls."""
        walls = [wall for wall in (self.outer, self.inner) if wall is not None]
        return np.concatenate([wall.at_parameters(wall.places) for wall in walls])

    def at(self, points: Floats) -> Floats:
        """(m,) root of the mean square error in millimetres that is to be expected at points (m, 3) of the piece.

        A point on a wall is off along the wall's normal; one on the fracture by what was scanned of the neighbours'.
        """
        return self._by_parts(points)[0]

    def of(self, mesh: TriangleMesh) -> PieceErrors:
        """What is to be expected of the piece as triangles."""
        expected, parts = self._by_parts(mesh.vertices)
        corners = parts[mesh.face_vertices]
        part = np.where((corners == corners[:, :1]).all(axis=1), corners[:, 0], 0)  # fracture goes from wall to wall
        of_faces = expected[mesh.face_vertices].mean(axis=1)
        of_faces[part == 0] = self._on_fracture(mesh.corners()[part == 0].mean(axis=1))
        area = np.linalg.norm(mesh.area_vectors(), axis=1)
        off = np.bincount(part, weights=of_faces * area, minlength=3)
        return PieceErrors(expected, float(np.linalg.norm(off)))

    @property
    def fracture_scanned(self) -> bool:
        """Whether something shows how the cracks run through the wall, beside where they begin."""
        return isinstance(self._measured, TriangleTree)

    def _by_parts(self, points: Floats) -> tuple[Floats, Ints]:
        """(m,) σ, and of which part: 0 the fracture, 1 the outer wall, 2 the inner one."""
        expected, parts = self._on_fracture(points), np.zeros(len(points), np.int64)
        for part, wall in enumerate((self.outer, self.inner), 1):
            if wall is not None:
                uv = foot_points(wall.surface, points, accuracy=1e-6)
                on = np.linalg.norm(wall.surface.point(uv) - points, axis=1) < ON_WALL
                if on.any():
                    expected[on], parts[on] = wall.at_parameters(uv[on]), part
        return expected, parts

    def _on_fracture(self, points: Floats) -> Floats:
        if isinstance(self._measured, TriangleTree):
            away = self._measured.closest(points).distances
        else:
            away = self._measured.query(points)[0]
        return np.hypot(self.outer.missed, CRUMBLED * away)


def confidence(piece: MissingPiece) -> Confidence:
    """Fit the walls of a piece again without each sherd around the hole, and say how far each point may be trusted.

    Promises  never fails: where the walls cannot do without a sherd, the error with which sectors around the hole
              foretell each other stands for the disagreement of the fits.
    """
    # small matrices: threads of the linear algebra library would wait for each other
    with threadpool_limits(limits=1, user_api="blas"):
        return _confidence(piece)


def _confidence(piece: MissingPiece) -> Confidence:
    explained = _explained(piece.relief)
    around = piece.around
    outer = _wall(piece.outer, around.outer, around.axis, explained)
    astray = _all_out_of_place(piece.settling)
    outer = replace(outer, missed=float(np.hypot(outer.missed, astray)))
    inner = None
    if piece.inner is not None and around.inner is not None:
        inner = _wall(piece.inner, around.inner, around.axis, 0.0)
        inner = replace(inner, missed=float(np.hypot(inner.missed, astray)))
    elif piece.inner is not None:
        inner = _offset_wall(piece.inner, outer, around.shown)
    edges = [wall.edge.points[wall.edge.sherds >= 0] for wall in (around.outer, around.inner) if wall is not None]
    fracture = around.fracture
    if fracture is not None and fracture.n_faces:
        return Confidence(outer, inner, TriangleTree(fracture.vertices, fracture.face_vertices))
    return Confidence(outer, inner, cKDTree(np.concatenate(edges)))


def _explained(relief: ReliefSheet | None) -> float:
    """Share of the relief's variance that was foretold; -1 where it was drawn: two patterns that know nothing of each
    other differ by twice their variance.
    """
    if relief is None:
        return 0.0
    return -1.0 if relief.source is ReliefSource.DRAWN else float(np.clip(relief.explained, 0.0, 1.0))


def _all_out_of_place(settling: Settling | None) -> float:
    """Millimetres: n sherds that came out of place each on its own are, once they fit each other, so by a √n-th."""
    if settling is None or not settling.settled:
        return 0.0
    return _root_mean_square(np.array([move.shift_mm for move in settling.moves])) / float(np.sqrt(len(settling.moves)))


class _Edge:
    """Measured points of the edge in a space where distances are those along the wall, and how far each stands off."""

    def __init__(self, place: Callable[[Floats], Floats], uv: Floats, stand_off: Floats, fading: float) -> None:
        self._place, self._fading = place, fading
        self._tree = cKDTree(place(uv))
        few = np.linspace(0, len(uv) - 1, min(FEW, len(uv))).astype(np.int64)
        nearest = self._tree.query(place(uv[few]), k=min(BESIDE, len(uv)))[1].reshape(len(few), -1)
        self._few, self._square = place(uv[few]), (stand_off[nearest] ** 2).mean(axis=1)

    def beside(self, uv: Floats) -> tuple[Floats, Floats]:
        """(m,) distance of the nearest point of the edge, and how far the edge stands off, the nearer the more so."""
        place = self._place(uv)
        square = np.empty(len(uv))
        for rows in np.array_split(np.arange(len(uv)), 1 + len(uv) // CHUNK):
            weight = (cdist(place[rows], self._few, "sqeuclidean") + self._fading**2) ** -2.0
            square[rows] = weight @ self._square / weight.sum(axis=1)
        return np.asarray(self._tree.query(place)[0]), np.sqrt(square)


def _wall(sheet: Sheet, wall: Wall, axis: Axis | None, explained: float) -> WallConfidence:
    if sheet.box_angle_deg is not None or axis is None:
        return _boxed(sheet, wall)
    fit = fit_any_wall(wall, axis)
    # a bridged wall was drawn to points far off, too, and is known no better inside than they are near
    sound = fit.sound if sheet.sound is None else sheet.sound
    left = fit.ring.distance - fit.residual.at(fit.ring.chart)
    fits = [_stand_off(other, sheet) for other in _fits_without(wall, axis, fit)]
    return WallConfidence(
        sheet.trimmed.surface,
        float(np.hypot(_root_mean_square(sheet.edge_distance), fit.unit * _out_of_place(fit))),
        fit.unit * _scatter(left, fit.ring.weight) * float(np.sqrt(1.0 - explained)),
        fit.unit * fit.fading(),
        len(fits),
        _within(sheet.trimmed),
        _disagreement(sheet.trimmed.surface, fits, fit.unit * fit.residual.foretold),
        _Edge(
            lambda uv: fit.unit * fit.chart.unfolded(uv / fit.unit),
            fit.unit * fit.edge[sound, :2],
            fit.unit * fit.left()[sound],
            fit.unit * fit.fading(),
        ),
    )


def _fits_without(wall: Wall, axis: Axis, whole: WallFit) -> Iterator[WallFit]:
    for less in _leaving_out(_thinned(wall)):
        try:
            yield fit_wall(less, axis, like=whole)
        except NoSurface:
            continue


def _out_of_place(fit: WallFit) -> float:
    """Root mean square over the sherds, in units, of how far each stands off along its part of the edge: there the face
    follows the sherd, right or wrong.
    """
    left, sherds = fit.left()[fit.sound], fit.wall.edge.sherds[fit.sound]
    return _root_mean_square(np.array([np.median(left[sherds == sherd]) for sherd in np.unique(sherds)]))


def _stand_off(fit: WallFit, sheet: Sheet) -> Floats:
    """(GRID, GRID) by how much another fit stands off from the sheet's face, before that gave way to the edge."""
    face = sheet.base if sheet.base is not None else sheet.trimmed.surface
    uv = _grid(face)
    flat = fit.chart.flat(face.point(uv) / fit.unit, face.normal(uv) if fit.wall.over_lip else None)
    return np.asarray(fit.unit * (fit.residual.at(flat[:, :2]) - flat[:, 2])).reshape(GRID, GRID)


def _boxed(sheet: Sheet, wall: Wall) -> WallConfidence:
    """Of the paper's road: the fit to the samples again without each sherd, and by how much the base patch missed them.

    Nothing inside the hole corrects the base patch, which is what the samples show to be wrong at its edge.
    """
    surface, edge = sheet.trimmed.surface, wall.edge.points[wall.edge.sherds >= 0]
    samples, base = edge_samples(wall), sheet.base or surface
    missed_by_base = np.linalg.norm(base.point(foot_points(base, samples)) - samples, axis=1)
    uv = _grid(surface)
    fits = []
    for less in _leaving_out(wall):
        try:
            other = fit_surface(base, edge_samples(less), acceptance=np.inf).surface
        except NoSurface:
            continue
        off = other.point(foot_points(other, surface.point(uv))) - surface.point(uv)
        fits.append(np.einsum("ij,ij->i", off, surface.normal(uv)).reshape(GRID, GRID))
    scatter = _root_mean_square(missed_by_base)
    return WallConfidence(
        surface,
        _root_mean_square(sheet.edge_distance),
        scatter,
        SAMPLE_RADIUS,
        len(fits),
        _within(sheet.trimmed),
        _disagreement(surface, fits, scatter),
        _Edge(surface.point, foot_points(surface, edge), np.zeros(len(edge)), SAMPLE_RADIUS),
    )


def _offset_wall(inner: Sheet, outer: WallConfidence, shown: ShownThickness | None) -> WallConfidence:
    """As wrong as the outer wall, on whose parameters it lies, and as the thickness is where the scans show it."""
    spread = 0.0 if shown is None else (shown.high - shown.low) / 1.349  # of a normal law, the middle half is as wide
    return replace(outer, surface=inner.trimmed.surface, missed=float(np.hypot(outer.missed, spread)))


def _disagreement(surface: BSplineSurface, fits: Sequence[Floats], otherwise: float) -> RegularGridInterpolator:
    """J over the surface's parameters; `otherwise` where there are not two fits to compare."""
    n = len(fits)
    spread = np.full((GRID, GRID), otherwise)
    if n > 1:
        spread = np.sqrt((n - 1) / n * np.square(np.array(fits) - np.mean(fits, axis=0)).sum(axis=0))
    return RegularGridInterpolator(_steps(surface), spread, bounds_error=False, fill_value=None)


def _steps(surface: BSplineSurface) -> tuple[Floats, Floats]:
    u, v = (np.linspace(low, high, GRID) for low, high in surface.domain)
    return u, v


def _grid(surface: BSplineSurface) -> Floats:
    return np.stack(np.meshgrid(*_steps(surface), indexing="ij"), axis=-1).reshape(-1, 2)


def _within(trimmed: TrimmedSurface) -> Floats:
    """(k, 2) points of a grid within the trim loop."""
    loop = trimmed.loops[0].polygon()
    steps = np.linspace(loop.min(axis=0), loop.max(axis=0), 2 * GRID)
    grid = np.stack(np.meshgrid(*steps.T, indexing="ij"), axis=-1).reshape(-1, 2)
    return grid[within(loop, grid)]


def _thinned(wall: Wall) -> Wall:
    """Fewer faces, evenly chosen; a wall over the lip stays as it is, since its edges tell its sides apart."""
    n = wall.measured.n_faces
    if n <= MOST_FACES or wall.over_lip:
        return wall
    chosen = np.zeros(n, dtype=bool)
    chosen[np.linspace(0, n - 1, MOST_FACES).astype(np.int64)] = True
    return _of_faces(wall, chosen)


def _leaving_out(wall: Wall) -> Iterator[Wall]:
    """The wall without each sherd at the hole's edge, where something is left."""
    for sherd in np.unique(wall.edge.sherds[wall.edge.sherds >= 0]):
        kept = (wall.sherds[wall.measured.face_vertices] != sherd).all(axis=1)
        if kept.any():
            yield _of_faces(wall, kept)


def _of_faces(wall: Wall, kept: Bools) -> Wall:
    used = np.unique(wall.measured.face_vertices[kept])
    return replace(
        wall,
        measured=wall.measured.part(kept),
        plain=wall.plain.part(kept),
        sherds=wall.sherds[used],
        trust=wall.trust[used],
    )


def _scatter(left: Floats, weight: Floats) -> float:
    """Half-width that two thirds of the ring keep: a handle or a foot in it does not count."""
    order = np.argsort(np.abs(left))
    total = np.cumsum(weight[order])
    return float(np.abs(left[order[np.searchsorted(total, 0.68 * total[-1])]]))


def _root_mean_square(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0
