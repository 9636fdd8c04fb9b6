"""A vessel that the package makes itself: thrown on a wheel, pressed with cords, broken, one sherd lost.

Demo, tests and notebooks need a broken vessel whose whole is known. The wall is turned about the z axis from two
profile curves; rows of slanted cord marks are pressed on its outside; cracks, each a bent sheet, split it.

       lip _             profile, millimetres           cracks
          | |
          | |  neck      outer and inner curve      ====~~~====  two around the vessel: base | belly | neck
         /  /   shoulder run from the axis to           | |      then each band is split across, the larger part
        |  |    belly    the lip, where they meet       | |      first; the sherd that is lost comes from the belly
         \\  \\
          '---- base
"""

from collections.abc import Iterator
from dataclasses import dataclass

import manifold3d
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.spatial import cKDTree

from recon.errors import BadOption
from recon.geometry.mesh import TriangleMesh

__all__ = ["BrokenVessel", "VesselOptions", "broken_vessel", "whole_vessel"]

Floats = NDArray[np.float64]

# radius and height of the outside at the corners of the wheel's profile, in units of the vessel's height; base to lip
_PROFILE = np.array([(0.30, 0.0), (0.40, 0.18), (0.46, 0.38), (0.45, 0.56), (0.36, 0.76), (0.32, 0.88), (0.37, 1.0)])
_BANDS = ((0.30, 2), (0.66, 5), (1.01, 4))  # upper bound of each band as a share of the height, and its sherds
_BELLY, _NECK = 1, 2
_RING, _ROOT = 0.21, 0.4  # radius of a foot ring's middle in heights of the vessel, of its roots in thicknesses


@dataclass(frozen=True)
class VesselOptions:
    """How the vessel is made and broken; lengths in millimetres.

    height, thickness  of the vessel and its wall
    relief, pitch      depth of the cord marks on the outside, and their distance
    edge               length of the mesh's edges
    noise              of the scanner, standard deviation a coordinate
    misplacement       of every sherd after reassembly: a shift of this size and a turn of 0.1° for each 0.1 mm
    bead               radius of the lip in thicknesses: 0.5 rounds the wall off, more makes a bead on it
    foot               height of the ring that it stands on, as wide as the wall is thick, below the base; 0 for none
    lost_at_rim        whether the lost sherd comes from the neck, lip and all, and not from the belly
    seed               of everything that is drawn by chance
    Raises  BadOption when the wall does not fit into the vessel, the bead is no bead, or the foot no ring.
    """

    height: float = 70.0
    thickness: float = 3.5
    relief: float = 0.5
    pitch: float = 5.0
    edge: float = 1.1
    noise: float = 0.02
    misplacement: float = 0.1
    bead: float = 0.5
    foot: float = 0.0
    lost_at_rim: bool = False
    seed: int = 1

    def __post_init__(self) -> None:
        if not 0 < self.thickness < 0.15 * self.height:
            raise BadOption("thickness", f"must lie between 0 and 0.15 of the height, not at {self.thickness} mm")
        if not 0 <= self.relief < 0.4 * self.thickness:
            raise BadOption("relief", f"must be less than 0.4 of the wall's thickness, not {self.relief} mm")
        if not 0.5 <= self.bead <= 1.5:
            raise BadOption("bead", f"must be from 0.5 to 1.5 thicknesses, not {self.bead}")
        if self.foot and not 1.5 * self.thickness <= self.foot < 0.2 * self.height:
            raise BadOption("foot", f"must be 1.5 thicknesses high, and below 0.2 of the height, not {self.foot} mm")


@dataclass(frozen=True, eq=False)
class BrokenVessel:
    """The sherds as a scanner delivers them, and what only the maker knows.

    sherds       closed meshes with both walls and their fracture faces, noise and misplacement included
    outer_walls  the same sherds as seen from outside: open, outer wall only
    lost         the sherd left out, closed, in its true place, without noise
    plain        the whole vessel before the cords were pressed
    """

    sherds: tuple[TriangleMesh, ...]
    outer_walls: tuple[TriangleMesh, ...]
    lost: TriangleMesh
    plain: TriangleMesh


def whole_vessel(options: VesselOptions, *, relief: bool = True) -> TriangleMesh:
    """The unbroken vessel as a closed mesh about the z axis, its base on z = 0, its foot ring below."""
    around = round(2 * np.pi * _PROFILE[:, 0].max() * options.height / options.edge)
    outside, inside = _profile(options)
    rows = np.concatenate([outside, inside[::-1]])
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    radius = np.broadcast_to(rows[:, :1], (len(rows), around)).copy()
    if relief:
        radius[: len(outside)] += _cords(options, outside, angle)
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.broadcast_to(rows[:, 1:], radius.shape)], -1)
    poles = np.array([[0.0, 0.0, outside[0, 1]], [0.0, 0.0, inside[0, 1]]])
    return TriangleMesh(np.concatenate([ring.reshape(-1, 3), poles]), _lathe_faces(len(rows), around), "vessel")


def broken_vessel(options: VesselOptions | None = None) -> BrokenVessel:
    """Make a vessel, crack it into eleven sherds, and leave out the largest one of its belly, or of its neck."""
    options = options or VesselOptions()
    chance = np.random.default_rng(options.seed)
    whole = whole_vessel(options)
    solid = _as_solid(whole.vertices, whole.face_vertices).as_original()
    bands = list(_bands(solid, options, chance))
    pieces = [_split(band, count, options, chance) for band, (_, count) in zip(bands, _BANDS)]
    lost = pieces[_NECK if options.lost_at_rim else _BELLY].pop(0)
    scanned = [_scanned(piece, solid, options, chance) for band in pieces for piece in band]
    return BrokenVessel(
        sherds=tuple(closed for closed, _ in scanned),
        outer_walls=tuple(wall for _, wall in scanned),
        lost=_as_mesh(lost, "lost sherd"),
        plain=whole_vessel(options, relief=False),
    )


def _profile(options: VesselOptions) -> tuple[Floats, Floats]:
    """Radius and height along the outside and along the inside, base to lip, evenly spaced, without the pole."""
    corners = np.concatenate([[(0.0, 0.0), (0.15, 0.0)], _PROFILE]) * options.height
    run = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    curve = PchipInterpolator(run, corners)
    fine = curve(np.linspace(0, run[-1], 2000))
    slope = np.gradient(fine, axis=0)
    normal = np.stack([-slope[:, 1], slope[:, 0]], axis=1) / np.linalg.norm(slope, axis=1, keepdims=True)
    inner = fine + options.thickness * normal
    inner = inner[inner[:, 0] > 0]
    lip = _lip(fine[-1], inner[-1], options.bead)
    if options.foot:
        fine = _on_ring(fine, options)
    return _even(np.concatenate([fine, lip]), options.edge)[1:], _even(inner, options.edge)[1:]


def _on_ring(outside: Floats, options: VesselOptions) -> Floats:
    """The outside with a ring under its flat base: down its inner side, round below, up the outer side, all rounded."""
    half = 0.5 * options.thickness
    quarter, turn = np.linspace(0.0, np.pi / 2, 20), np.linspace(np.pi, 2 * np.pi, 40)
    middle, root = _RING * options.height, _ROOT * options.thickness
    round_ = half * np.column_stack([np.cos(turn), np.sin(turn)]) + [middle, half - options.foot]
    up = root * np.column_stack([1.0 - np.cos(quarter), np.sin(quarter) - 1.0]) + [middle + half, 0.0]
    side = np.concatenate([round_[20:], up])
    ring = np.concatenate([(side * [-1, 1] + [2 * middle, 0])[::-1], side])
    within = (outside[:, 0] < ring[0, 0]) & (outside[:, 1] < root), outside[:, 0] > ring[-1, 0]
    first, last = np.flatnonzero(within[0])[-1], np.flatnonzero(within[1])[0]
    return np.concatenate([outside[: first + 1], ring, outside[last:]])


def _lip(outer: Floats, inner: Floats, bead: float) -> Floats:
    """Part of a circle, half of it or more, from the outer curve's end over the lip to just before the inner one's."""
    across, up = outer - inner, np.array([inner[1] - outer[1], outer[0] - inner[0]])
    below = np.arccos(0.5 / bead)
    middle = (outer + inner) / 2 + bead * np.sin(below) * up
    turn = np.linspace(-below, np.pi + below, 40)[1:-1, None]
    return np.asarray(middle + bead * (np.cos(turn) * across + np.sin(turn) * up))


def _even(curve: Floats, step: float) -> Floats:
    run = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    at = np.linspace(0, run[-1], round(run[-1] / step) + 1)
    return np.stack([np.interp(at, run, curve[:, i]) for i in range(2)], axis=1)


def _cords(options: VesselOptions, outside: Floats, angle: Floats) -> Floats:
    """(rows, around) depth of slanted cord marks in rows of changing direction, fading toward base and lip."""
    height = outside[:, 1:] / options.height
    fade = np.clip(height / 0.15, 0, 1) * np.clip((0.93 - height) / 0.10, 0, 1)
    row = np.floor(outside[:, 1:] / (2.5 * options.pitch))
    marks = round(2 * np.pi * _PROFILE[:, 0].mean() * options.height / options.pitch)
    slant = np.where(row % 2, 1.0, -1.0) * 2 * np.pi * outside[:, 1:] / options.pitch
    cord = np.sin(marks * angle + slant) * np.abs(np.sin(np.pi * outside[:, 1:] / (2.5 * options.pitch)))
    return np.asarray(options.relief * fade * cord)


def _lathe_faces(rows: int, around: int) -> NDArray[np.int64]:
    """Two triangles a quad between neighbouring rows, a fan at each pole; the outside seen counter-clockwise."""
    at = np.arange(rows * around).reshape(rows, around)
    a, b = at[:-1], np.roll(at, -1, axis=1)[:-1]
    c, d = np.roll(at, -1, axis=1)[1:], at[1:]
    sides = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    first, last, pole = at[0], at[-1], rows * around
    bottom = np.stack([np.roll(first, -1), first, np.full(around, pole)], axis=-1)
    floor = np.stack([last, np.roll(last, -1), np.full(around, pole + 1)], axis=-1)
    return np.concatenate([bottom, sides, floor])


def _bands(
    solid: manifold3d.Manifold, options: VesselOptions, chance: np.random.Generator
) -> Iterator[manifold3d.Manifold]:
    """The vessel in bands from base to neck, parted by cracks that run around it."""
    rest = solid
    for top, _ in _BANDS[:-1]:
        tilt = np.array([*chance.normal(0, 0.12, 2), 1.0])
        above = _crack(np.array([0, 0, top * options.height]), tilt, options, chance)
        yield rest - above
        rest = rest ^ above
    yield rest


def _split(
    band: manifold3d.Manifold, count: int, options: VesselOptions, chance: np.random.Generator
) -> list[manifold3d.Manifold]:
    """Crack a band across, the largest part first, until it has `count` parts; largest first."""
    parts = list(band.decompose())
    smallest = 0.25 * band.volume() / count
    while len(parts) < count:
        parts.sort(key=lambda part: -part.volume())
        points = _as_mesh(parts[0], "part").vertices
        longest = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
        across = longest * [1, 1, 0] + chance.normal(0, 0.15, 3)
        sheet = _crack(points.mean(axis=0), across, options, chance)
        halves = [*(parts[0] - sheet).decompose(), *(parts[0] ^ sheet).decompose()]
        if min(half.volume() for half in halves) > smallest:
            parts = [*parts[1:], *halves]
    return sorted(parts, key=lambda part: -part.volume())


def _crack(point: Floats, normal: Floats, options: VesselOptions, chance: np.random.Generator) -> manifold3d.Manifold:
    """A block that fills the space beyond a bent sheet through `point`, on the side of `normal`."""
    reach = 1.3 * options.height
    line = np.linspace(-reach, reach, round(2 * reach / options.edge) + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    sheet = np.stack([x, y, _bend(x, y, options, chance)], axis=-1).reshape(-1, 3)
    roof = np.stack([x, y, np.full_like(x, reach)], axis=-1).reshape(-1, 3)
    third = normal / np.linalg.norm(normal)
    first = np.cross(third, np.eye(3)[np.argmin(np.abs(third))])
    first /= np.linalg.norm(first)
    placed = np.concatenate([sheet, roof]) @ np.stack([first, np.cross(third, first), third]) + point
    return _as_solid(placed, _block_faces(len(line)))


def _bend(x: Floats, y: Floats, options: VesselOptions, chance: np.random.Generator) -> Floats:
    """A sum of waves from the vessel's size down to a few edges, their height falling with their length."""
    height = np.zeros_like(x)
    for length in np.geomspace(0.9 * options.height, 4 * options.edge, 12):
        heading, phase = chance.uniform(0, 2 * np.pi, 2)
        along = np.cos(heading) * x + np.sin(heading) * y
        height += 0.05 * length * chance.normal() * np.sin(2 * np.pi * along / length + phase)
    return height


def _block_faces(n: int) -> NDArray[np.int64]:
    """Faces of a block between two n x n sheets of vertices, the first below the second, seen from outside."""
    at = np.arange(n * n).reshape(n, n)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    roof = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3) + n * n
    floor = roof[:, ::-1] - n * n
    border = np.concatenate([at[:-1, 0], at[-1, :-1], at[:0:-1, -1], at[0, :0:-1]])
    ahead = np.roll(border, -1)
    sides = np.stack([border, ahead, ahead + n * n, border, ahead + n * n, border + n * n], axis=-1).reshape(-1, 3)
    return np.concatenate([roof, floor, sides])


def _scanned(
    piece: manifold3d.Manifold, solid: manifold3d.Manifold, options: VesselOptions, chance: np.random.Generator
) -> tuple[TriangleMesh, TriangleMesh]:
    """The sherd as scanned, and its outer wall alone, both moved a little out of place by the same motion."""
    closed = _as_mesh(piece, "sherd")
    noisy = closed.vertices + chance.normal(0, options.noise, closed.vertices.shape)
    turn = np.radians(options.misplacement) * chance.normal(size=3)
    shift = options.misplacement * chance.normal(size=3) / np.sqrt(3)
    centre = noisy.mean(axis=0)
    moved = TriangleMesh(noisy + np.cross(turn, noisy - centre) + shift, closed.face_vertices, "sherd")
    return moved, moved.part(_on_outside(piece, solid, closed, options))


def _on_outside(
    piece: manifold3d.Manifold, solid: manifold3d.Manifold, mesh: TriangleMesh, options: VesselOptions
) -> NDArray[np.bool_]:
    """(F,) faces that stem from the vessel, not from a crack, and lie nearer to its outside than to its inside."""
    raw = piece.to_mesh64()
    ends = np.asarray(raw.run_index) // 3
    origin = np.repeat(np.asarray(raw.run_original_id), np.diff(ends))
    outside, inside = _profile(options)
    middle = mesh.corners().mean(axis=1)
    place = np.stack([np.hypot(middle[:, 0], middle[:, 1]), middle[:, 2]], axis=1)
    nearer = cKDTree(outside).query(place)[0] < cKDTree(inside).query(place)[0]
    return np.asarray((origin == solid.original_id()) & nearer)


def _as_solid(vertices: Floats, faces: NDArray[np.int64]) -> manifold3d.Manifold:
    return manifold3d.Manifold(manifold3d.Mesh64(vertices.copy(), faces.astype(np.uint64)))


def _as_mesh(solid: manifold3d.Manifold, name: str) -> TriangleMesh:
    raw = solid.to_mesh64()
    return TriangleMesh(np.asarray(raw.vert_properties)[:, :3], np.asarray(raw.tri_verts).astype(np.int64), name)
