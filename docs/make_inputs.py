"""Write one input a command into a folder, all generated here, to try the commands on: `make inputs`.

    python docs/make_inputs.py [FOLDER]      default: inputs

sherds/*.ply      a vessel that was thrown and broken; one sherd is missing
pebble.ply        a scan of a pebble, closed
outline.csv       a row of points around an outline, the last point the first
contours.geojson  contour lines of a hill, in metres
bracket.npz       a bracket as voxels of half a millimetre
drawing.dxf       three views of a block with a step, a slot and a pocket
"""

import json
import sys
from pathlib import Path

import ezdxf
import manifold3d
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from recon.geometry.contour_map import HeightGrid
from recon.geometry.mesh import TriangleMesh
from recon.geometry.polyhedron import Polyhedron, merge_coplanar
from recon.hole_patch.sample_vessel import VesselOptions, broken_vessel
from recon.terrain.contouring import contour_grid
from recon.three_view.hidden_lines import draw

BETWEEN = 30.0  # mm from view to view on the sheet


def main() -> None:
    """Write all of them."""
    write_inputs(Path(sys.argv[1] if len(sys.argv) > 1 else "inputs"))


def write_inputs(folder: Path, vessel: VesselOptions | None = None) -> None:
    """One input a command."""
    (folder / "sherds").mkdir(parents=True, exist_ok=True)
    for number, sherd in enumerate(broken_vessel(vessel).sherds):
        write_scan(sherd, folder / "sherds" / f"{number:02}.ply")
    write_scan(pebble(), folder / "pebble.ply")
    rows = [f"{x:.4f}, {y:.4f}" for x, y in outline()]
    (folder / "outline.csv").write_text("\n".join(["x, y", *rows]) + "\n", encoding="utf-8")
    (folder / "contours.geojson").write_text(json.dumps(hill()), encoding="utf-8")
    np.savez_compressed(folder / "bracket.npz", voxels=bracket(), spacing=np.full(3, 0.5), origin=np.full(3, 0.25))
    write_drawing(stepped_block(), folder / "drawing.dxf")


def write_scan(mesh: TriangleMesh, path: Path) -> None:
    """A mesh as binary PLY."""
    trimesh.Trimesh(mesh.vertices, mesh.face_vertices, process=False).export(path)


def pebble() -> TriangleMesh:
    """3,000 points on a bumpy ellipsoid, 40 mm long."""
    unit = np.random.default_rng(1).normal(size=(3000, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    faces = ConvexHull(unit).simplices
    normals = np.cross(unit[faces[:, 1]] - unit[faces[:, 0]], unit[faces[:, 2]] - unit[faces[:, 0]])
    inward = np.einsum("ij,ij->i", normals, unit[faces[:, 0]]) < 0
    faces[inward] = faces[inward][:, ::-1]
    places = unit * [20.0, 15.0, 12.0] * (1.0 + 0.05 * np.sin(3.0 * unit[:, :1]))
    return TriangleMesh(places, faces.astype(np.int64), "pebble")


def outline() -> NDArray[np.float64]:
    """(241, 2) points around a rounded star, measured with a hundredth of a millimetre of noise."""
    turn = np.linspace(0.0, 2.0 * np.pi, 241)
    radius = 20.0 + 4.0 * np.cos(5.0 * turn) + np.random.default_rng(1).normal(scale=0.01, size=len(turn))
    radius[-1] = radius[0]
    return radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def hill() -> dict[str, object]:
    """Contour lines every 10 m of a hill beside a rise, as GeoJSON."""
    x, y = np.arange(0.0, 610.0, 10.0), np.arange(0.0, 410.0, 10.0)
    px, py = np.meshgrid(x, y)
    heights = 7.3 + 0.05 * px + 0.01 * py + 80 * np.exp(-(((px - 240) / 140) ** 2) - ((py - 190) / 100) ** 2)
    contours = contour_grid(HeightGrid(x, y, heights), 10.0)
    lines = [
        {
            "type": "Feature",
            "properties": {"elevation": height},
            "geometry": {"type": "LineString", "coordinates": np.round(line, 3).tolist()},
        }
        for line, height in zip(contours.lines, contours.heights.tolist())
    ]
    return {"type": "FeatureCollection", "features": lines}


def bracket() -> NDArray[np.uint8]:
    """(80, 80, 80) voxels of an angle bracket with a hole in its foot."""
    axis = np.arange(80) + 0.5
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    foot = (x > 10) & (x < 70) & (y > 15) & (y < 65) & (z > 10) & (z < 25)
    wall = (x > 10) & (x < 25) & (y > 15) & (y < 65) & (z > 10) & (z < 70)
    drilled = (x - 50) ** 2 + (y - 40) ** 2 < 8**2
    return ((foot | wall) & ~drilled).astype(np.uint8)


def stepped_block() -> Polyhedron:
    """A block of 60 x 40 x 30 mm with a step, a slanted end, a slot through it and a blind pocket."""
    cube = manifold3d.Manifold.cube
    body = cube([60.0, 40.0, 30.0]) - cube([25.0, 40.0, 15.0]).translate([35.0, 0.0, 15.0])
    body -= cube([10.0, 40.0, 10.0]).translate([10.0, 0.0, 20.0]) + cube([12.0, 16.0, 8.0]).translate([42.0, 12.0, 7.0])
    body = body.trim_by_plane([-1.0, 0.0, -1.0], -70.0 / np.sqrt(2.0))
    mesh = body.to_mesh64()
    triangles = TriangleMesh(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts), "block")
    return merge_coplanar(triangles, 1e-6)


def write_drawing(solid: Polyhedron, path: Path) -> None:
    """Front, top and side view on one sheet, third angle, hidden edges dashed."""
    views = draw(solid)
    width, _, height = np.ptp(solid.vertices, axis=0)
    places = {"front": (0.0, 0.0), "top": (0.0, height + BETWEEN), "side": (width + BETWEEN, 0.0)}
    document = ezdxf.new(setup=True, units=ezdxf.units.MM)
    document.layers.add("VISIBLE")
    document.layers.add("HIDDEN", linetype="DASHED")
    for projection, view in views:
        for (start, end), hidden in zip(view.segments + places[projection.name], view.hidden):
            document.modelspace().add_line(start, end, {"layer": "HIDDEN" if hidden else "VISIBLE"})
    document.saveas(path)


if __name__ == "__main__":
    main()
