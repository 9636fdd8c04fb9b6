"""Small sound files of every format that is read, and ways to damage them."""

import base64
import gzip
import io
import json
import re
import struct
import tempfile
import zlib
from collections.abc import Callable
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from recon.readers.contours import read_contours
from recon.readers.control_meshes import read_control_mesh
from recon.readers.height_grids import read_height_grid
from recon.readers.meshes import read_mesh
from recon.readers.picks import read_picks
from recon.readers.point_rows import read_point_row
from recon.readers.views import read_views
from recon.readers.volumes import read_volume

Rng = np.random.Generator
Damage = Callable[[bytes, Rng], bytes]

POINTS = np.array([[x, y, z] for x in (0.0, 20.0) for y in (0.0, 30.0) for z in (0.0, 40.0)])
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TRIANGLES = np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))])
GRID = np.pad(np.ones((4, 3, 5), np.uint8), 1)
SQUARE = [[0, 0, 40, 0], [40, 0, 40, 40], [40, 40, 0, 40], [0, 40, 0, 0]]
SHEET = [(u + du, v + dv, s + du, t + dv) for du, dv in ((0, 0), (60, 0), (0, 60)) for u, v, s, t in SQUARE]


def _rows(rows) -> str:
    return "".join(" ".join(map(str, row)) + "\n" for row in rows)


def _ply(encoding: str) -> bytes:
    head = (
        f"ply\nformat {encoding} 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 6\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()
    if encoding == "ascii":
        return head + (_rows(POINTS) + _rows((4, *quad) for quad in QUADS)).encode()
    order = "<" if "little" in encoding else ">"
    faces = b"".join(struct.pack(order + "B4i", 4, *quad) for quad in QUADS)
    return head + POINTS.astype(order + "f4").tobytes() + faces


def _strips() -> bytes:
    head = (
        b"ply\nformat binary_little_endian 1.0\nelement vertex 8\nproperty float x\nproperty float y\n"
        b"property float z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    )
    strip = [0, 1, 2, 3, -1, 4, 6, 5, 7]
    return head + POINTS.astype("<f4").tobytes() + struct.pack("<10i", len(strip), *strip)


def _stl() -> bytes:
    rows = np.zeros(12, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]))
    rows["corners"] = POINTS[TRIANGLES]
    return bytes(80) + struct.pack("<I", 12) + rows.tobytes()


def _stl_text() -> bytes:
    facets = (
        "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {_rows([p])}" for p in corners) + "endloop\nendfacet\n"
        for corners in POINTS[TRIANGLES]
    )
    return f"solid box\n{''.join(facets)}endsolid box\n".encode()


def _obj() -> bytes:
    faces = "".join("f " + " ".join(str(i + 1) for i in quad) + "\n" for quad in QUADS)
    return ("".join(f"v {_rows([p])}" for p in POINTS) + faces + "l 1 2\n").encode()


def _off() -> bytes:
    return f"OFF\n8 6 0\n{_rows(POINTS)}{_rows((4, *quad) for quad in QUADS)}".encode()


def _scene(kind: str) -> bytes:
    import trimesh

    made = trimesh.Trimesh(POINTS, TRIANGLES, process=False).export(file_type=kind)
    if not isinstance(made, dict):
        return made
    tree = json.loads(made["model.gltf"])
    for buffer in tree["buffers"]:
        data = base64.b64encode(made[buffer["uri"]]).decode()
        buffer["uri"] = f"data:application/octet-stream;base64,{data}"
    return json.dumps(tree).encode()


def _numpy(packed: bool) -> bytes:
    stream = io.BytesIO()
    if packed:
        np.savez_compressed(stream, voxels=GRID, spacing=np.array([1.0, 2.0, 3.0]))
    else:
        np.save(stream, GRID)
    return stream.getvalue()


def _nrrd(encoding: str) -> bytes:
    size = " ".join(map(str, GRID.shape))
    head = f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: {size}\nspacings: 1 2 3\nencoding: {encoding}\n\n".encode()
    raw = GRID.tobytes(order="F")
    if encoding == "ascii":
        return head + " ".join(map(str, raw)).encode()
    return head + (gzip.compress(raw, mtime=0) if encoding == "gzip" else raw)


def _metaimage(packed: bool) -> bytes:
    raw = GRID.tobytes(order="F")
    body = zlib.compress(raw) if packed else raw
    size = " ".join(map(str, GRID.shape))
    head = (
        f"ObjectType = Image\nNDims = 3\nDimSize = {size}\nElementSpacing = 1 2 3\nCompressedData = {packed}\n"
        "ElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
    )
    return head.encode() + body


def _nifti() -> bytes:
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, *GRID.shape, 1, 1, 1, 1)
    struct.pack_into("<2h", head, 70, 2, 8)
    struct.pack_into("<8f", head, 76, 1, 1, 2, 3, 0, 0, 0, 0)
    struct.pack_into("<3f", head, 108, 352, 1, 0)
    head[344:348] = b"n+1\0"
    return bytes(head) + GRID.tobytes(order="F")


def _vti(form: str) -> bytes:
    extent = " ".join(f"0 {n - 1}" for n in GRID.shape)
    raw = GRID.tobytes(order="F")
    content = " ".join(map(str, raw)) if form == "ascii" else ""
    if form == "binary":
        content = base64.b64encode(struct.pack("<I", len(raw)) + raw).decode()
    place = ' offset="0"' if form == "appended" else ""
    text = (
        f'<VTKFile type="ImageData" version="0.1" byte_order="LittleEndian"><ImageData WholeExtent="{extent}" '
        f'Origin="0 0 0" Spacing="1 2 3"><Piece Extent="{extent}"><PointData><DataArray type="UInt8" Name="v" '
        f'format="{form}"{place}>{content}</DataArray></PointData></Piece></ImageData>'
    )
    if form != "appended":
        return (text + "</VTKFile>").encode()
    block = zlib.compress(raw)
    packed = struct.pack("<4I", 1, len(raw), 0, len(block)) + block
    text = text.replace('version="0.1"', 'version="0.1" compressor="vtkZLibDataCompressor"')
    return text.encode() + b'<AppendedData encoding="raw">_' + packed + b"</AppendedData></VTKFile>"


def _tiff() -> bytes:
    from PIL import Image

    stream = io.BytesIO()
    first, *rest = (Image.fromarray(page) for page in GRID.transpose(2, 1, 0))
    first.save(stream, "TIFF", save_all=True, append_images=rest)
    return stream.getvalue()


def _binvox() -> bytes:
    cube = np.pad(np.ones((4, 4, 4), np.uint8), 1).ravel()
    runs = [(value, 1) for value in cube.tolist()]
    head = b"#binvox 1\ndim 6 6 6\ntranslate 0 0 0\nscale 6\ndata\n"
    return head + bytes(number for run in runs for number in run)


def _geojson() -> bytes:
    rings = [
        {
            "type": "Feature",
            "properties": {"ELEV": 100.0 + 20 * k},
            "geometry": {
                "type": "LineString",
                "coordinates": [[500.0 + r * np.cos(a), 700.0 + r * np.sin(a)] for a in np.linspace(0, 6.2831853, 12)],
            },
        }
        for k, r in enumerate((300.0, 200.0, 100.0))
    ]
    return json.dumps({"type": "FeatureCollection", "features": rings}).encode()


def _contour_table() -> bytes:
    rows = [f"{x},{y},{z},{z}\n" for z, r in ((10, 300), (20, 100)) for x, y in ((r, 0), (0, r), (-r, 0), (0, -r))]
    return ("line,x,y,z\n" + "".join(rows).replace("\r", "")).encode().replace(b"line,x,y,z", b"x,y,z,line")


def _dxf(contours: bool) -> bytes:
    import ezdxf

    drawing = ezdxf.new("R2010", units=6 if contours else 4)
    space = drawing.modelspace()
    if contours:
        for z, r in ((10, 300), (20, 100)):
            ring = [(r, 0), (0, r), (-r, 0), (0, -r)]
            space.add_lwpolyline(ring, close=True, dxfattribs={"elevation": z})
    else:
        for u, v, s, t in SHEET:
            space.add_line((u, v), (s, t), dxfattribs={"layer": "VISIBLE"})
    stream = io.StringIO()
    drawing.write(stream)
    return stream.getvalue().encode()


def _svg() -> bytes:
    lines = "".join(f'<line x1="{u}" y1="{-v}" x2="{s}" y2="{-t}" stroke="black"/>' for u, v, s, t in SHEET)
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="110mm" viewBox="0 0 110 110">'
    return f"{head}<g>{lines}</g></svg>".encode()


def _views_json() -> bytes:
    views = {name: {"visible": SQUARE, "hidden": []} for name in ("front", "top", "side")}
    return json.dumps({"views": views}).encode()


def _ascii_grid() -> bytes:
    heights = 100 + np.add.outer(np.arange(6), np.arange(5))
    head = "ncols 5\nnrows 6\nxllcorner 1000\nyllcorner 2000\ncellsize 10\nNODATA_value -9999\n"
    return (head + _rows(heights)).encode()


def _json_grid() -> bytes:
    return json.dumps({"width": 5, "height": 6, "values": [100.0 + k for k in range(30)]}).encode()


def _point_row() -> bytes:
    return b"x,y\n" + b"".join(b"%d.5,%d\n" % (k, k * k) for k in range(20))


@cache
def _map_files() -> dict[str, bytes]:
    """The files of a Shapefile and a GeoPackage by their endings."""
    import pyogrio
    import shapely

    angles = np.linspace(0.0, 2.0 * np.pi, 12)
    rings = [np.stack([500.0 + r * np.cos(angles), 700.0 + r * np.sin(angles)], axis=1) for r in (300.0, 200.0, 100.0)]
    lines = shapely.to_wkb([shapely.LineString(ring) for ring in rings])
    with tempfile.TemporaryDirectory() as folder:
        for name, driver in (("map.shp", "ESRI Shapefile"), ("map.gpkg", "GPKG")):
            kind, heights = "LineString", np.array([100.0, 120.0, 140.0])
            pyogrio.raw.write(
                Path(folder) / name, lines, [heights], ["ELEV"], geometry_type=kind, crs="EPSG:32755", driver=driver
            )
        return {file.suffix: file.read_bytes() for file in Path(folder).iterdir()}


def _read_shapefile(part: Path) -> object:
    """Contours of a Shapefile of which one part is given, the others being sound."""
    with tempfile.TemporaryDirectory() as folder:
        for ending, data in _map_files().items():
            if ending != ".gpkg":
                (Path(folder) / f"map{ending}").write_bytes(part.read_bytes() if ending == part.suffix else data)
        return read_contours(Path(folder) / "map.shp")


def _geotiff(packed: bool) -> bytes:
    import rasterio
    from rasterio.transform import from_origin

    heights = (100.0 + np.add.outer(np.arange(12), np.arange(10))).astype(np.float32)
    facts = {"height": 12, "width": 10, "count": 1, "dtype": "float32", "crs": "EPSG:32755"}
    if packed:
        facts["compress"] = "deflate"
    with rasterio.MemoryFile() as memory:
        with memory.open(driver="GTiff", transform=from_origin(5e5, 6e6, 10, 10), **facts) as file:
            file.write(heights, 1)
        return bytes(memory.read())


@cache
def dicom_slices(packed: bool = False) -> tuple[bytes, ...]:
    """The files of a DICOM series; packed ones tell the types of their elements, plain ones do not."""
    import SimpleITK as sitk

    writer, made = sitk.ImageFileWriter(), []
    writer.KeepOriginalImageUIDOn()
    writer.SetUseCompression(packed)
    writer.SetCompressor("JPEG")
    with tempfile.TemporaryDirectory() as folder:
        for k in range(4):
            image = sitk.GetImageFromArray(np.pad(np.full((3, 4), 100, np.int16), 1))
            image.SetSpacing((0.5, 0.5))
            place = {"0020|0032": f"0\\0\\{k}", "0020|0037": "1\\0\\0\\0\\1\\0", "0020|0013": str(k)}
            for key, value in {"0020|000e": "1.2.3.4", "0008|0018": f"1.2.3.4.{k + 1}", **place}.items():
                image.SetMetaData(key, value)
            writer.SetFileName(f"{folder}/{k}.dcm")
            writer.Execute(image)
            made.append((Path(folder) / f"{k}.dcm").read_bytes())
    return tuple(made)


def _read_series(slice_: Path, packed: bool = False) -> object:
    """The volume of a DICOM series of which one slice is given, the others being sound."""
    with tempfile.TemporaryDirectory() as folder:
        for k, data in enumerate(dicom_slices(packed)):
            (Path(folder) / f"{k}.dcm").write_bytes(slice_.read_bytes() if k == 1 else data)
        return read_volume(folder)


# What reads a format, the ending of its files, and a sound one.
SPECIMENS: dict[str, tuple[Callable[[Path], object], str, Callable[[], bytes]]] = {
    "mesh PLY text": (read_mesh, ".ply", lambda: _ply("ascii")),
    "mesh PLY little": (read_mesh, ".ply", lambda: _ply("binary_little_endian")),
    "mesh PLY big": (read_mesh, ".ply", lambda: _ply("binary_big_endian")),
    "mesh PLY strips": (read_mesh, ".ply", _strips),
    "mesh STL": (read_mesh, ".stl", _stl),
    "mesh STL text": (read_mesh, ".stl", _stl_text),
    "mesh OBJ": (read_mesh, ".obj", _obj),
    "mesh OFF": (read_mesh, ".off", _off),
    "mesh 3MF": (read_mesh, ".3mf", lambda: _scene("3mf")),
    "mesh GLB": (read_mesh, ".glb", lambda: _scene("glb")),
    "mesh glTF": (read_mesh, ".gltf", lambda: _scene("gltf")),
    "control mesh OBJ": (read_control_mesh, ".obj", _obj),
    "volume NPY": (read_volume, ".npy", lambda: _numpy(False)),
    "volume NPZ": (read_volume, ".npz", lambda: _numpy(True)),
    "volume NRRD": (read_volume, ".nrrd", lambda: _nrrd("raw")),
    "volume NRRD gzip": (read_volume, ".nrrd", lambda: _nrrd("gzip")),
    "volume NRRD text": (read_volume, ".nrrd", lambda: _nrrd("ascii")),
    "volume MHA": (read_volume, ".mha", lambda: _metaimage(False)),
    "volume MHA zlib": (read_volume, ".mha", lambda: _metaimage(True)),
    "volume NIfTI": (read_volume, ".nii", _nifti),
    "volume NIfTI gzip": (read_volume, ".nii.gz", lambda: gzip.compress(_nifti(), mtime=0)),
    "volume VTI text": (read_volume, ".vti", lambda: _vti("ascii")),
    "volume VTI base64": (read_volume, ".vti", lambda: _vti("binary")),
    "volume VTI packed": (read_volume, ".vti", lambda: _vti("appended")),
    "volume TIFF": (read_volume, ".tif", _tiff),
    "volume binvox": (read_volume, ".binvox", _binvox),
    "contours GeoJSON": (read_contours, ".geojson", _geojson),
    "contours CSV": (read_contours, ".csv", _contour_table),
    "contours DXF": (read_contours, ".dxf", lambda: _dxf(True)),
    "grid ASC": (read_height_grid, ".asc", _ascii_grid),
    "grid JSON": (read_height_grid, ".json", _json_grid),
    "views DXF": (read_views, ".dxf", lambda: _dxf(False)),
    "views SVG": (read_views, ".svg", _svg),
    "views JSON": (read_views, ".json", _views_json),
    "point row": (read_point_row, ".csv", _point_row),
    "picks": (read_picks, ".json", lambda: b'{"picks": [[0, 0, 1], [2, 0.5, 1], [3, 4, 1]]}'),
}

if find_spec("pyogrio"):
    SPECIMENS["contours GeoPackage"] = (read_contours, ".gpkg", lambda: _map_files()[".gpkg"])
    for ending in (".shp", ".shx", ".dbf", ".prj"):
        SPECIMENS[f"contours Shapefile {ending}"] = (
            _read_shapefile,
            ending,
            partial(lambda e: _map_files()[e], ending),
        )
if find_spec("rasterio"):
    SPECIMENS["grid GeoTIFF"] = (read_height_grid, ".tif", lambda: _geotiff(False))
    SPECIMENS["grid GeoTIFF deflate"] = (read_height_grid, ".tif", lambda: _geotiff(True))
if find_spec("SimpleITK"):
    SPECIMENS["volume DICOM"] = (_read_series, ".dcm", lambda: dicom_slices()[1])
    SPECIMENS["volume DICOM packed"] = (partial(_read_series, packed=True), ".dcm", lambda: dicom_slices(True)[1])

WORDS = (b"nan", b"inf", b"-inf", b"1e400", b"-1", b"0", b"353535235358", b"9" * 400, b"x", b"", b"1e-320", b"-0")
COUNTS = (0xFFFFFFFF, 0x7FFFFFFF, 0x80000000, 0, 0x10000000, 0x7F800000, 0x7FC00000)
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")


def truncated(data: bytes, rng: Rng) -> bytes:
    return data[: rng.integers(0, len(data))]


def flipped(data: bytes, rng: Rng) -> bytes:
    changed = bytearray(data)
    for place in rng.integers(0, len(data), rng.integers(1, 9)):
        changed[place] = rng.integers(0, 256)
    return bytes(changed)


def swapped(data: bytes, rng: Rng) -> bytes:
    a, b, c = sorted(rng.integers(0, len(data), 3))
    return data[:a] + data[b:c] + data[a:b] + data[c:]


def header_changed(data: bytes, rng: Rng) -> bytes:
    """A byte among the first, where counts and types stand."""
    place = rng.integers(0, min(len(data), 400))
    return data[:place] + bytes([rng.integers(0, 256)]) + data[place + 1 :]


def counted_wrongly(data: bytes, rng: Rng) -> bytes:
    """Four or eight bytes anywhere, as a count or a float that makes no sense."""
    place = int(rng.integers(0, max(1, len(data) - 8)))
    value = struct.pack("<I", COUNTS[rng.integers(len(COUNTS))]) * int(rng.integers(1, 3))
    return data[:place] + value + data[place + len(value) :]


def number_replaced(data: bytes, rng: Rng) -> bytes:
    """A number of the text by none, by one without end, by a huge, a negative or a tiny one."""
    found = list(NUMBER.finditer(data))
    if not found:
        return flipped(data, rng)
    match = found[rng.integers(len(found))]
    return data[: match.start()] + WORDS[rng.integers(len(WORDS))] + data[match.end() :]


def line_lost_or_doubled(data: bytes, rng: Rng) -> bytes:
    lines = data.splitlines(keepends=True)
    place = int(rng.integers(len(lines)))
    return b"".join(lines[:place] + lines[place : place + 1] * int(rng.choice([0, 2, 50])) + lines[place + 1 :])


def doubled(data: bytes, rng: Rng) -> bytes:
    return data + data[rng.integers(0, len(data)) :]


def other_content(data: bytes, rng: Rng) -> bytes:
    """A sound file of another format under this one's name."""
    del data
    return SPECIMENS[list(SPECIMENS)[rng.integers(len(SPECIMENS))]][2]()


def noise(data: bytes, rng: Rng) -> bytes:
    """A sound beginning, then noise."""
    place = int(rng.integers(0, min(200, len(data))))
    return data[:place] + rng.bytes(int(rng.integers(0, 300)))


DAMAGES: tuple[Damage, ...] = (
    truncated,
    flipped,
    swapped,
    header_changed,
    counted_wrongly,
    number_replaced,
    line_lost_or_doubled,
    doubled,
    other_content,
    noise,
)
