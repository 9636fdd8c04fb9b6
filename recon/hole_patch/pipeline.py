"""From sherds to the missing piece, step by step as in [kinoshita].

    0. settling       the sherds moved the last tenths of a millimetre, until the cracks between them close
    1. surroundings   walls told from fractures, relief removed, the hole's edge found      (3.1, 3.4 step 1)
    2. sheet          a surface over the hole on each wall, fitted and trimmed              (3.2, 3.4 steps 2 to 5)
    3. thick piece    the two sheets and the wall between them                              (the paper's future work)

Two roads lead to a sheet. `BOX` is the published one: a box around the hole, cubic sections, a bicubic patch. It meets
the hole's edge, but says little about the inside of the hole. `WHEEL`, the default, uses what the paper takes for
granted about its vessels: that they were thrown on a wheel, so that axis and profile are known all around.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from recon.errors import BadGeometry, BadOption, NoHole, NoSurface, NoWall, ReconError
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import LipPiece, ThickPiece, TrimmedSurface
from recon.hole_patch.box_route import box_sheet
from recon.hole_patch.bridged_wall import bridged_sheet
from recon.hole_patch.fitting import distances_from, edge_samples
from recon.hole_patch.hole import Hole
from recon.hole_patch.lip_piece import lip_piece
from recon.hole_patch.options import PatchMethod, PatchOptions, Relief, WallThickness
from recon.hole_patch.relief import ReliefSheet, continue_relief
from recon.hole_patch.rim_check import check_rim_piece
from recon.hole_patch.road import road
from recon.hole_patch.second_look import LEASTS, look_again
from recon.hole_patch.settling import Settling, settle
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.sherd_reading import Reading, read_sherds, separate, what_was_found
from recon.hole_patch.sherds import surroundings_in
from recon.hole_patch.surroundings import HoleEdge, Surroundings, Wall
from recon.hole_patch.thick_piece import thick_piece
from recon.hole_patch.thickness import offset_sheet
from recon.hole_patch.trim_loop import withdrawn
from recon.hole_patch.wall_check import (
    MOST_OFF,
    WallsStandOff,
    check_fracture_met,
    check_fracture_unfolded,
    check_walls_go_on,
)
from recon.hole_patch.walls import FRACTURE
from recon.hole_patch.wheel_edge import clean_wall
from recon.hole_patch.wheel_sheet import wheel_sheet

__all__ = [
    "Attempt",
    "HolesFound",
    "MissingPiece",
    "PatchMethod",
    "PatchOptions",
    "Relief",
    "WallThickness",
    "list_holes",
    "patch_hole",
    "patch_holes",
    "patch_readings",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

GOING_ON = 0.02  # of a wall's edge stands off from the piece's at most, where they go on in each other


@dataclass(frozen=True, eq=False)
class MissingPiece:
    """What was found and made.

    method          the road that was taken: BOX also where WHEEL was asked for and the vessel is not round
    shape           ThickPiece where both walls are known, LipPiece where the hole runs over the lip, else the
                    TrimmedSurface of the outer wall
    outer, inner    the sheets it was made from; inner is None for a face, and at the lip, which outer runs over
    around          walls, edges and axis
    sherds          the sherds one by one, where the piece fits between them: as settled, if they were
    settling        how far each of them was moved; None where they were left as they came
    sample_distance (m,) distances of the measured points near the hole's edge from the outer sheet, in mm
    relief          where the relief came from and how well it agrees with the wall around; None where not asked for
    notes           what a user should know about how it was made
    """

    method: PatchMethod
    shape: ThickPiece | LipPiece | TrimmedSurface
    outer: Sheet
    inner: Sheet | None
    around: Surroundings
    sherds: tuple[TriangleMesh, ...]
    sample_distance: Floats
    settling: Settling | None = None
    relief: ReliefSheet | None = None
    notes: tuple[str, ...] = field(default=())


@dataclass(frozen=True, eq=False)
class HolesFound:
    """The holes between sherds.

    sherds    one by one, as settled, if they were
    reading   what was understood of them
    settling  how far each of them was moved; None where they were left as they came
    """

    sherds: tuple[TriangleMesh, ...]
    reading: Reading
    settling: Settling | None = None

    @property
    def holes(self) -> tuple[Hole, ...]:
        """The longest edge first; a hole's place here is its number."""
        return self.reading.holes


@dataclass(frozen=True, eq=False)
class Attempt:
    """What came of one hole: its piece, or the reason why there is none."""

    number: int
    hole: Hole
    piece: MissingPiece | None
    reason: str = ""


def patch_hole(
    sherds: Sequence[TriangleMesh],
    options: PatchOptions | None = None,
    *,
    doing: Callable[[str], None] = lambda step: None,
) -> MissingPiece:
    """The piece that is missing between the sherds.

    sherds   in pose, in millimetres: closed with fracture faces, or open outer walls, or one mesh with a hole
    options  see PatchOptions
    doing    called with the name of each step
    Raises   NoHole, NoSurface, NoWall, BadOption, BadGeometry.
    Paper    [kinoshita], sections 3.1, 3.2 and 3.4.
    """
    return next(patch_readings(sherds, options, doing=doing))


def patch_readings(
    sherds: Sequence[TriangleMesh],
    options: PatchOptions | None = None,
    *,
    doing: Callable[[str], None] = lambda step: None,
) -> Iterator[MissingPiece]:
    """The piece, then the same from other readings of where wall ends and fracture begins, each made when asked for.

    Slanted fracture looks like wall, and no one limit between them is right for all breaks: where the first piece is no
    sound shape, the next may be. Parameters and errors as of `patch_hole`, these where no reading gives a piece.
    """
    # the matrices are small: threads of the linear algebra library wait for each other ten times as long as they work
    with threadpool_limits(limits=1, user_api="blas"):
        options = options or PatchOptions()
        yield from _pieces(_found(sherds, options, doing), options, doing)


def patch_holes(
    sherds: Sequence[TriangleMesh],
    options: PatchOptions | None = None,
    *,
    doing: Callable[[str], None] = lambda step: None,
) -> tuple[Attempt, ...]:
    """The pieces that are missing from every hole between the sherds, in the order and numbers of `HolesFound`.

    Parameters as of `patch_hole`; a hole that cannot be patched comes with the reason in place of a piece.
    Raises  NoHole when the sherds surround none; BadOption, also when the options choose a hole; BadGeometry.
    """
    options = options or PatchOptions()
    if options.hole is not None or options.picks is not None:
        raise BadOption("--hole", "all holes are patched: leave out the number, and the picks")
    with threadpool_limits(limits=1, user_api="blas"):
        found = _found(sherds, options, doing)
        if not found.holes:
            raise NoHole(what_was_found(found.reading))
        if found.reading.axis is None:
            raise NoHole(
                "the sherds fit no wheel, so holes cannot be told from the mouth: choose one by its number (--hole)."
            )
        return tuple(_attempt(number, found, options, doing) for number in range(len(found.holes)))


def list_holes(
    sherds: Sequence[TriangleMesh],
    options: PatchOptions | None = None,
    *,
    doing: Callable[[str], None] = lambda step: None,
) -> HolesFound:
    """The holes between the sherds, numbered as `patch_hole` numbers them; sherds are settled first if the options say.

    Raises  NoHole when closed sherds fit no wheel's axis; NotManifold, BadGeometry.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        return _found(sherds, options or PatchOptions(), doing)


def _found(sherds: Sequence[TriangleMesh], options: PatchOptions, doing: Callable[[str], None]) -> HolesFound:
    sherds = separate(sherds)
    settling = None
    if options.settle and len(sherds) > 1:
        doing("settling the sherds")
        settling = settle(sherds)
        sherds = settling.sherds
    doing("finding the holes")
    return HolesFound(tuple(sherds), read_sherds(sherds), settling)


def _attempt(number: int, found: HolesFound, options: PatchOptions, doing: Callable[[str], None]) -> Attempt:
    hole = found.holes[number]
    if hole.problem:
        return Attempt(number, hole, None, f"it cannot be patched: {hole.problem}.")
    try:
        piece = next(_pieces(found, replace(options, hole=number), lambda step: doing(f"hole {number}: {step}")))
    except (NoHole, NoSurface, NoWall) as refusal:
        return Attempt(number, hole, None, str(refusal))
    return Attempt(number, hole, piece)


def _pieces(found: HolesFound, options: PatchOptions, doing: Callable[[str], None]) -> Iterator[MissingPiece]:
    """A piece for each reading of the walls that differs from those before, the likeliest first. Those that gave none
    follow with their inner wall bridged, and then those whose walls stand off from more of their edges.
    """
    near = None if options.picks is None else options.picks.mean(axis=0)
    first = surroundings_in(found.reading, hole=options.hole, near=near, pass_band=options.pass_band)
    left: Iterable[tuple[Surroundings, str]] = _readings(found.reading, first, options)
    reason: dict[Surroundings, ReconError] = {}  # of each reading that gave nothing, but for its bridged wall
    any_made = False
    for bridging, most_off in ((False, GOING_ON), (True, MOST_OFF), (False, MOST_OFF)):
        refused = []
        for around, changed in left:
            if around in reason and not bridging and not isinstance(reason[around], WallsStandOff):
                continue  # it would be refused for the same again
            try:
                piece = _piece(around, changed, found, options, doing, bridging=bridging, most_off=most_off)
            except (NoHole, NoSurface, NoWall, BadGeometry) as error:
                refused.append((around, changed))
                if not bridging:
                    reason[around] = error
                continue
            any_made = True
            yield piece
        left = refused
    if reason and not any_made:
        raise next(iter(reason.values()))


def _readings(reading: Reading, first: Surroundings, options: PatchOptions) -> Iterator[tuple[Surroundings, str]]:
    """The surroundings of a hole as second looks show them, each differently; and what was read otherwise before."""
    seen: list[Ints] = []
    for least in LEASTS:
        around, labels = look_again(reading, first, pass_band=options.pass_band, least=least)
        if not any(np.array_equal(labels, before) for before in seen):
            seen.append(labels)
            yield _with_clean_foot(around), _what_changed(reading.labels, labels)


def _what_changed(before: Ints, after: Ints) -> str:
    deep, level = (int(((after != before) & (now == FRACTURE)).sum()) for now in (after, before))
    told = []
    if deep:
        told.append(
            f"{deep} faces beside the hole lie too deep under the wall to be wall: they were taken for fracture."
        )
    if level:
        told.append(f"{level} faces beside the hole lie on the wall and along it: they were taken for wall.")
    return " ".join(told)


def _piece(
    around: Surroundings,
    changed: str,
    found: HolesFound,
    options: PatchOptions,
    doing: Callable[[str], None],
    *,
    bridging: bool = False,
    most_off: float = MOST_OFF,
) -> MissingPiece:
    """What one reading of the walls gives.

    changed   what it reads otherwise than the first
    bridging  whether swellings at the edge of the inner wall are taken for wall, and bridged
    most_off  of a wall's edge, that the piece's may stand off from
    Raises    NoHole, NoSurface, NoWall, BadGeometry; NoSurface also where there is no inner wall to bridge.
    """
    method, notes = road(around, options)
    notes += (changed,) if changed else ()
    notes += () if found.settling is None else (found.settling.summary(),)
    doing("covering the hole")
    outer = _sheet(around.outer, around, method, picks=options.picks)
    inner, told = _bridged(around, outer, method) if bridging else _inner_sheet(around, outer, method, options)
    notes += told
    relief = None
    if options.relief is not Relief.NONE and around.axis is not None:
        doing("continuing the relief")
        relief = continue_relief(outer, around.outer, around.axis, draw=options.relief is Relief.DRAW)
        outer, notes = relief.sheet, (*notes, *relief.sheet.notes)
    doing("closing the wall")
    shape = _shape(outer, inner, around, options, most_off)
    distance = distances_from(outer.trimmed.surface, edge_samples(around.outer))
    if (around.inner is not None or around.outer.over_lip) and options.thickness is not None:
        notes += ("the inner wall was scanned and is followed; the thickness given was not used.",)
    notes += tuple(f"outer wall: {note}" for note in outer.notes)
    notes += () if inner is None else tuple(f"inner wall: {note}" for note in inner.notes)
    return MissingPiece(
        method, shape, outer, inner, around, found.sherds, distance, found.settling, relief, notes=notes
    )


def _with_clean_foot(around: Surroundings) -> Surroundings:
    """The surroundings with a hole's edge that runs over a foot ring as the sheet is drawn to it."""
    outer = around.outer
    if around.axis is None or outer.over_lip or outer.edge.normals is None:
        return around
    edge = clean_wall(outer, around.axis).edge
    return replace(around, outer=replace(outer, edge=HoleEdge(edge.points, edge.sherds)))


def _sheet(wall: Wall, around: Surroundings, method: PatchMethod, *, picks: Floats | None = None) -> Sheet:
    if method is PatchMethod.BOX and wall.over_lip:
        raise NoSurface("The box covers one wall, and the hole runs over the lip: leave --method box away.")
    if method is PatchMethod.BOX or around.axis is None:
        return box_sheet(wall, picks=picks)
    return wheel_sheet(wall, around.axis)


def _shape(
    outer: Sheet, inner: Sheet | None, around: Surroundings, options: PatchOptions, most_off: float
) -> ThickPiece | LipPiece | TrimmedSurface:
    if outer.lip is not None:
        piece = lip_piece(outer, around.fracture, clearance=options.clearance)
        check_rim_piece(piece, around, clearance=options.clearance)
        return piece
    if inner is not None:
        check_walls_go_on(outer.trimmed, inner.trimmed, around, most_off)
        thick = thick_piece(outer, inner, around.fracture, clearance=options.clearance)
        check_fracture_met(thick, around, clearance=options.clearance)
        check_fracture_unfolded(thick)
        return thick
    return outer.trimmed if options.clearance == 0.0 else withdrawn(outer.trimmed, options.clearance)


def _bridged(around: Surroundings, outer: Sheet, method: PatchMethod) -> tuple[Sheet, tuple[str, ...]]:
    if around.inner is None or around.axis is None or method is PatchMethod.BOX:
        raise NoSurface("There is no inner wall to bridge.")
    told = (
        "the inner wall around the hole does not keep to the wheel: in the piece it is bridged from edge to edge, and"
        " nothing tells what stood there."
    )
    return bridged_sheet(around.inner, around.axis, outer), (told,)


def _inner_sheet(
    around: Surroundings, outer: Sheet, method: PatchMethod, options: PatchOptions
) -> tuple[Sheet | None, tuple[str, ...]]:
    if around.inner is not None:
        return _sheet(around.inner, around, method), ()
    if options.thickness is None or around.outer.over_lip:
        return None, ()
    if not isinstance(options.thickness, WallThickness):
        return offset_sheet(outer, options.thickness), ()
    shown = around.shown
    if shown is None:
        raise BadOption("--thickness", "nothing in the scans shows how thick the wall is; give a number in mm")
    seen = (
        f"the wall is {shown.median:.2f} mm thick, as {shown.n_places} places show ({shown.low:.2f} to"
        f" {shown.high:.2f} mm in the middle half of them)."
    )
    return offset_sheet(outer, shown.median), (seen,)
