"""From contour lines to a mountain of patches that meet G1, step by step as in [zhang2006].

1. resampling   every contour a cubic spline with continuous curvature                        (3, step 1)
2. tiling       constrained Delaunay triangles, free vertices where they would be flat        (3, step 2)
3. merging      triangles to quads                                                            (4.1)
4. slopes       tangents across the contours; heights of the free vertices                    (4.2)
5. curve mesh   height and gradient along every edge                                          (4.2)
6. patches      one polynomial surface a patch                                                (5)
7. limiter      no overshoot beyond the contours around
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from recon.errors import BadGeometry
from recon.geometry.contour_map import ContourMap
from recon.terrain.border import Border, BorderVertices
from recon.terrain.clean_lines import ended_on_border, without_specks
from recon.terrain.curve_tiling import Fitting, finer_tiling, tiled
from recon.terrain.faults import checked_contours
from recon.terrain.floor import Floor, Lifting
from recon.terrain.ground import PatchKind, Terrain, TerrainOptions
from recon.terrain.levels import Levels, levels
from recon.terrain.limiter import limited_jets
from recon.terrain.merging import PatchLayout, merged_layout
from recon.terrain.patch_group import PatchGroup
from recon.terrain.resampling import point_spacing
from recon.terrain.second_derivatives import VertexJets, contour_frames, vertex_jets
from recon.terrain.slopes import VertexSlopes, vertex_slopes
from recon.terrain.spot_heights import spots_beside_contours, spots_off_strips
from recon.terrain.tiling import Tiling

__all__ = ["PatchKind", "Terrain", "TerrainOptions", "terrain_surface"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SHARE_OF_SPACING = 0.28  # the tolerance, where none is given, as a share of the distance between the given points
REFINEMENTS = 8  # where patches leave the heights around them all the same


def terrain_surface(
    contours: ContourMap,
    options: TerrainOptions | None = None,
    *,
    floor: float | None = None,
    border: Border | None = None,
    doing: Callable[[str], None] = lambda step: None,
) -> Terrain:
    """A ground through the contours, of polynomial patches whose tangent planes agree along every common edge.

    floor     height of a contour below which no patch above it may dip, since a base lies there
    border    what the map shares with the maps beside it, whose vertices on its border are then all that it has there
    doing     called with the name of each step
    Promises  no patch folds; heights stay near those of their patch's corners, as the limiter says.
    Raises    BadGeometry naming height and place, where contours cross or a patch cannot be unfolded; BadOption.
    Paper     [zhang2006].
    """
    options = options or TerrainOptions()
    border = border or _no_neighbours(contours)
    tolerance, origin = options.tolerance or SHARE_OF_SPACING * border.spacing, border.origin
    sound, told = checked_contours(contours, tolerance, mend=options.mend)
    kept, notes = without_specks(sound, tolerance)
    kept, spots_told = spots_beside_contours(kept, tolerance, mend=options.mend)
    notes = told + notes + spots_told
    local = border.joined(ended_on_border(kept.moved(origin), tolerance))
    fitting = Fitting(tolerance, options, border, None if floor is None else Floor(floor))
    with threadpool_limits(limits=1, user_api="blas"):
        doing("following the contours")
        tiling, local, left_out = tiled(local, fitting)
        odd = spots_off_strips(tiling, levels(tiling, border.interval), origin, mend=options.mend)
        if odd.any():
            notes += (f"{int(odd.sum())} spot heights that the contours around contradict were left out",)
            tiling, local, left_out = tiled(local.with_spots(local.spots[~odd]), fitting)
        notes += left_out
        tiling, laid = _kept_within(tiling, local, fitting, doing)
    _refuse_folds(tiling, laid, origin)
    rest = local.extent, border.interval, tolerance, laid.strip, contours.crs, notes
    return Terrain(origin, tiling, laid.layout, laid.jets, laid.nets, *rest)


class _Laid(NamedTuple):
    """Patches over a tiling, the strips of its triangles, and the patches that leave the heights around them."""

    layout: PatchLayout
    jets: VertexJets
    nets: tuple[PatchGroup, ...]
    strip: Ints
    astray: Ints


def _laid(tiling: Tiling, fitting: Fitting, doing: Callable[[str], None]) -> _Laid:
    """Steps 3 to 7."""
    border, floor = fitting.border, fitting.floor
    layout = merged_layout(tiling, fitting.folds)
    doing("finding the slopes")
    held, told = border.rows(tiling), border.vertices.jets
    limits = levels(tiling, border.interval, border.bands(held))
    slopes, limits = _slopes(tiling, limits, (held, told.slopes()), floor)
    jets = vertex_jets(tiling, slopes).with_rows(held, told)
    doing("making the patches")
    made = fitting.patches(tiling, layout)
    jets, nets, astray = limited_jets(made, layout, jets, limits, border.interval, held)
    if floor is not None:
        lifting = Lifting(floor, tiling, layout, limits, border.interval)
        jets, nets = lifting.lifted(made, jets, nets)
        astray = np.union1d(astray, lifting.dipping(nets))
    return _Laid(layout, jets, nets, limits.strip, astray)


def _kept_within(
    tiling: Tiling, contours: ContourMap, fitting: Fitting, doing: Callable[[str], None]
) -> tuple[Tiling, _Laid]:
    """Patches over the tiling, or over a finer one where some go astray, as long as that leaves fewer of them."""
    laid = _laid(tiling, fitting, doing)
    for _ in range(REFINEMENTS):
        if not len(laid.astray):
            break
        finer = finer_tiling(tiling, contours, fitting, laid.layout.part(laid.astray))
        again = _laid(finer, fitting, doing)
        if len(again.astray) >= len(laid.astray):
            break
        tiling, laid = finer, again
    return tiling, laid


def _refuse_folds(tiling: Tiling, laid: _Laid, origin: Floats) -> None:
    folded = np.concatenate([part.rows[part.folded()] for part in laid.nets])
    if len(folded):
        x, y = tiling.points[laid.layout.corners[folded[0]]].mean(axis=0) + origin
        raise BadGeometry(
            "contours",
            f"{len(folded)} Gregory patches fold where the ground is too steep for their width, the first near"
            f" ({x:.1f}, {y:.1f}): leave --patches gregory away, or give a smaller --tolerance",
        )


def _slopes(
    tiling: Tiling, limits: Levels, told: tuple[Ints, VertexSlopes], floor: Floor | None
) -> tuple[VertexSlopes, Levels]:
    """Slopes at all vertices, and the limits of height, of which none spans a floor."""
    normals = contour_frames(tiling.curves)[1]
    if floor is None:
        return vertex_slopes(tiling, normals, limits, told), limits
    limits = floor.settled(limits, tiling)
    slopes = vertex_slopes(tiling, normals, floor.cleared(limits), told)
    if floor.cut_through(limits):
        limits = floor.settled(limits, tiling, slopes.height)
        slopes = vertex_slopes(tiling, normals, floor.cleared(limits), told)
    return slopes, limits


def _no_neighbours(contours: ContourMap) -> Border:
    """The border of a map that stands alone."""
    origin = np.round(contours.extent.mean(axis=0))
    return Border(origin, point_spacing(contours), contours.interval(), BorderVertices.none())
