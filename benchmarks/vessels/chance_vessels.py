"""Broken vessels drawn by chance, one a seed: other shapes and sizes, other sherds lost, scanned well or badly.

The vessel of the package is made at its size and broken; then every radius is stretched by a factor that depends on
the height alone, which keeps it round and makes dishes, beakers and jars of it.

     ___                ___
    /   \\      |   |    \\     /      the same cracks on every shape; lost is a sherd of the base (which has two),
   |     |     |   |     \\   /       of the belly (five) or of the rim (four)
    \\___/      |___|      \\_/
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.sample_vessel import BrokenVessel, VesselOptions, broken_vessel, whole_vessel
from recon.numerics.distance import closest_points

__all__ = ["ChanceVessel", "Lot", "chance_vessel", "draw"]

Floats = NDArray[np.float64]

PLACES = ("belly", "base", "rim")
EDGES_UP = 60  # edges of the mesh from base to lip


@dataclass(frozen=True)
class Lot:
    """What was drawn for a seed; lengths in millimetres.

    options        of the vessel before it is stretched
    flare, waist   the factor of the radius is 1 + flare (2 t - 1) + waist cos(2 π t), t the height from 0 to 1
    place          of the lost sherd: belly, base or rim
    outer_only     whether only the outer walls were scanned; the thickness is given then
    """

    options: VesselOptions
    flare: float
    waist: float
    place: str
    outer_only: bool

    def stretched(self, mesh: TriangleMesh) -> TriangleMesh:
        t = np.clip(mesh.vertices[:, 2] / self.options.height, 0.0, 1.0)
        factor = 1.0 + self.flare * (2.0 * t - 1.0) + self.waist * np.cos(2.0 * np.pi * t)
        points = mesh.vertices * np.stack([factor, factor, np.ones_like(factor)], axis=1)
        return TriangleMesh(points, mesh.face_vertices, mesh.name)


@dataclass(frozen=True, eq=False)
class ChanceVessel:
    """The sherds as they are given to the command, and what was lost.

    thickness  of the lost sherd's wall in the mean: stretched, it is no longer as thick as it was drawn
    """

    sherds: tuple[TriangleMesh, ...]
    lost: TriangleMesh
    plain: TriangleMesh
    thickness: float


def draw(seed: int) -> Lot:
    chance = np.random.default_rng([seed, 2011])
    height = float(np.exp(chance.uniform(np.log(30.0), np.log(400.0))))
    thickness = float(np.clip(chance.uniform(0.025, 0.08) * height, 1.0, 8.0))
    options = VesselOptions(
        height=height,
        thickness=thickness,
        relief=float(chance.choice([0.0, chance.uniform(0.05, 0.2)])) * thickness,
        pitch=float(chance.uniform(0.05, 0.09)) * height,
        edge=height / EDGES_UP,
        noise=float(chance.uniform(0.01, 0.05)),
        misplacement=float(chance.uniform(0.0, 0.3)),
        seed=seed,
    )
    flare, waist = chance.uniform(-0.25, 0.45), chance.uniform(-0.15, 0.15)
    return Lot(options, flare, waist, str(chance.choice(PLACES, p=[0.6, 0.2, 0.2])), bool(chance.random() < 0.3))


def chance_vessel(lot: Lot) -> ChanceVessel:
    """Make and break the vessel that was drawn."""
    vessel = broken_vessel(lot.options)
    sherds, lost = (vessel.outer_walls if lot.outer_only else vessel.sherds), vessel.lost
    if lot.place != "belly":
        number = _lost_number(vessel, lot)
        lost = vessel.sherds[number]
        found = _found_again(vessel, lot)
        sherds = (*sherds[:number], *sherds[number + 1 :], found)
    found = tuple(map(lot.stretched, sherds))
    return ChanceVessel(found, lot.stretched(lost), lot.stretched(vessel.plain), _mean_thickness(lost, lot))


def _mean_thickness(lost: TriangleMesh, lot: Lot) -> float:
    """Twice the volume of a sherd over the area of both its walls, stretched."""
    whole, stretched = whole_vessel(lot.options), lot.stretched(lost)
    away = closest_points(lost.corners().mean(axis=1), whole.vertices, whole.face_vertices).distances
    area = np.linalg.norm(stretched.area_vectors(), axis=1)
    on_wall = away < lot.options.misplacement + 0.1 * lot.options.thickness  # a scanned sherd lies out of place
    return 2.0 * stretched.volume() / float(area[on_wall].sum())


def _lost_number(vessel: BrokenVessel, lot: Lot) -> int:
    """The sherd that reaches lowest, or highest."""
    if lot.place == "base":
        return int(np.argmin([sherd.vertices[:, 2].mean() for sherd in vessel.sherds]))
    return int(np.argmax([sherd.vertices[:, 2].mean() for sherd in vessel.sherds]))


def _found_again(vessel: BrokenVessel, lot: Lot) -> TriangleMesh:
    """The sherd that the package leaves out, scanned as badly as the others, closed or its outer wall alone."""
    options = lot.options
    chance = np.random.default_rng([options.seed, 7])
    mesh = vessel.lost.part(_on_outside(vessel, options)) if lot.outer_only else vessel.lost
    points = mesh.vertices + chance.normal(0.0, options.noise, mesh.vertices.shape)
    turn = np.radians(options.misplacement) * chance.normal(size=3)
    shift = options.misplacement * chance.normal(size=3) / np.sqrt(3.0)
    return replace(mesh, vertices=points + np.cross(turn, points - points.mean(axis=0)) + shift)


def _on_outside(vessel: BrokenVessel, options: VesselOptions) -> NDArray[np.bool_]:
    """(F,) faces of the lost sherd that lie on the vessel, at a radius and height where others have their outside."""
    whole, middles = whole_vessel(options), vessel.lost.corners().mean(axis=1)
    away = closest_points(middles, whole.vertices, whole.face_vertices).distances
    outside = np.concatenate([wall.vertices for wall in vessel.outer_walls])
    beside = cKDTree(_radius_and_height(outside)).query(_radius_and_height(middles))[0]
    return np.asarray((away < 1e-3 * options.edge) & (beside < 0.4 * options.thickness))


def _radius_and_height(points: Floats) -> Floats:
    return np.stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]], axis=1)
