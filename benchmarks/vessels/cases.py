"""Broken vessels whose lost piece is known, and how far a surface in the hole lies from the wall that was there."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from brep_export.app.patch_job import TOLERANCE
from brep_export.faces import trimmed_face
from brep_export.triangulation import triangulate
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.pipeline import MissingPiece
from recon.hole_patch.sample_vessel import BrokenVessel, VesselOptions, broken_vessel
from recon.numerics.distance import Deviation, one_sided_deviation
from recon.readers.meshes import read_mesh

__all__ = ["DEFLECTION", "SCANNED", "Case", "deviation", "made_case", "made_cases", "outer_face", "scanned_cases"]

SCANNED = Path(__file__).parents[3] / "shared" / "data" / "vessels"
DEFLECTION = 0.02  # millimetres by which the triangles that are measured may leave the surface


@dataclass(frozen=True, eq=False)
class Case:
    """A vessel with one sherd lost.

    closed  sherds with both walls and their fracture faces; outer the same sherds as open outer walls
    plain   the whole vessel without relief
    lost    the lost sherd, closed
    """

    name: str
    closed: tuple[TriangleMesh, ...]
    outer: tuple[TriangleMesh, ...]
    plain: TriangleMesh
    lost: TriangleMesh


def made_case(name: str, vessel: BrokenVessel) -> Case:
    return Case(name, vessel.sherds, vessel.outer_walls, vessel.plain, vessel.lost)


def made_cases() -> Iterator[Case]:
    """The vessel of the demo, one that is larger, noisier and worse assembled, and two that lost a sherd of the rim."""
    yield made_case("made", broken_vessel())
    large = VesselOptions(height=160, thickness=6, relief=0.8, pitch=9, edge=2.2, noise=0.05, misplacement=0.2, seed=5)
    yield made_case("made, 160 mm", broken_vessel(large))
    yield made_case("made, rim", broken_vessel(VesselOptions(lost_at_rim=True)))
    yield made_case("made, beaded rim", broken_vessel(VesselOptions(lost_at_rim=True, bead=0.9)))


def scanned_cases(folder: Path = SCANNED) -> Iterator[Case]:
    """The scanned vessels, where they lie beside the checkout."""
    for vessel in sorted(folder.glob("*")):
        closed, outer = (
            tuple(read_mesh(path).mesh for path in sorted((vessel / kind).glob("*.ply"))) for kind in ("solid", "outer")
        )
        plain, lost = (read_mesh(vessel / "truth" / name).mesh for name in ("plain.ply", "piece.ply"))
        yield Case(vessel.name, closed, outer, plain, lost)


def outer_face(piece: MissingPiece) -> TriangleMesh:
    """The outer wall of a piece as triangles."""
    return triangulate(trimmed_face(piece.outer.trimmed, TOLERANCE), DEFLECTION).mesh


def deviation(surface: TriangleMesh, plain: TriangleMesh) -> Deviation:
    """How far a surface in the hole, at points spread evenly over it, lies from the vessel without relief."""
    return one_sided_deviation(
        (surface.vertices, surface.face_vertices), (plain.vertices, plain.face_vertices), n_samples=5000
    )
