"""Maps drawn by chance, written by other programs, come back as their formats promise."""

import json
import struct
from itertools import pairwise

import ezdxf
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from recon.readers.contours import read_contours
from recon.readers.height_grids import open_height_grid, read_height_grid
from recon.readers.map_polygons import read_polygon

few = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
PLACES = st.floats(1e3, 1e6)  # no degrees
HEIGHTS = st.floats(-1e3, 9e3)
METRES = {2: 0.3048, 6: 1.0, 21: 1200 / 3937}


@st.composite
def lines(draw, least=2):
    """Lines (n, 2) of places that differ, and a height each."""
    sizes = draw(st.lists(st.integers(least, 6), min_size=1, max_size=4))
    made = [draw(arrays(np.float64, (n, 2), elements=PLACES, unique=True)) for n in sizes]
    assume((np.ptp(np.concatenate(made), axis=0) > 1.0).all())
    return made, draw(arrays(np.float64, len(made), elements=HEIGHTS))


SPOTS = arrays(np.float64, st.tuples(st.integers(0, 3), st.just(2)), elements=PLACES, unique=True)


def add_contour(space, kind, line, height):
    """The line as an entity of a kind; the places that it then has."""
    if kind == "row of lines":
        for a, b in pairwise(line):
            space.add_line((*a, height), (*b, height))
        return [line[k : k + 2] for k in range(len(line) - 1)]
    if kind == "turned over":  # drawn seen from below: x runs to the left, and the height downward
        space.add_lwpolyline(line * [-1, 1], dxfattribs={"elevation": -height, "extrusion": (0, 0, -1)})
    elif kind in ("light", "closed"):
        space.add_lwpolyline(line, close=kind == "closed", dxfattribs={"elevation": height})
    elif kind == "heavy":
        space.add_polyline2d(line, dxfattribs={"elevation": (0, 0, height)})
    else:
        space.add_polyline3d([(*place, height) for place in line])
    return [np.vstack([line, line[:1]]) if kind == "closed" else line]


def wkb_of(parts, *, is_multi):
    """Well-known binary by hand, in the numbering of ISO."""
    code = 1000 if parts[0].shape[1] == 3 else 0
    made = [struct.pack("<BII", 1, 2 + code, len(rows)) + rows.astype("<f8").tobytes() for rows in parts]
    return struct.pack("<BII", 1, 5 + code, len(parts)) + b"".join(made) if is_multi else made[0]


KINDS = ("light", "closed", "heavy", "in space", "turned over", "row of lines")


@few
@given(
    map_of=lines(), kinds=st.lists(st.sampled_from(KINDS), min_size=4, max_size=4), spots=SPOTS,
    unit=st.sampled_from(list(METRES)), version=st.sampled_from(["R12", "R2000", "R2018"]),
)  # fmt: skip
def test_contours_and_spots_come_back_from_dxf(tmp_path, map_of, kinds, spots, unit, version):
    document = ezdxf.new("R2000" if version == "R12" else version)
    document.header["$INSUNITS"] = unit
    space, drawn, levels = document.modelspace(), [], []
    for line, height, kind in zip(*map_of, kinds):
        parts = add_contour(space, kind, line, height)
        drawn, levels = drawn + parts, levels + [height] * len(parts)
    for spot in spots:
        space.add_point((*spot, 7.0))
    document.saveas(tmp_path / "map.dxf")
    found = read_contours(tmp_path / "map.dxf")
    assert len(found.lines) == len(drawn)
    np.testing.assert_allclose(found.heights, METRES[unit] * np.array(levels), rtol=1e-12)
    for line, kept in zip(drawn, found.lines):
        np.testing.assert_allclose(kept, METRES[unit] * line, rtol=1e-12)
    np.testing.assert_allclose(found.spots, METRES[unit] * np.column_stack([spots, np.full(len(spots), 7.0)]))


@pytest.mark.parametrize(
    "kind", ["arc of a light polyline", "arc of a heavy polyline", "circle", "arc", "ellipse", "spline"]
)
def test_curves_among_the_contours_of_a_dxf_are_read_as_chords(kind, tmp_path):
    document = ezdxf.new()
    document.header["$INSUNITS"] = 6
    space, level = document.modelspace(), {"elevation": 20.0}
    ring = [(5100, 2000, 1.0), (4900, 2000, 1.0)]  # two half circles of 100 m
    if kind == "arc of a light polyline":
        space.add_lwpolyline(ring, format="xyb", close=True, dxfattribs=level)
    elif kind == "arc of a heavy polyline":
        space.add_polyline2d(ring, format="xyb", close=True, dxfattribs={"elevation": (0, 0, 20)})
    elif kind == "circle":
        space.add_circle((5000, 2000, 20), 100)
    elif kind == "arc":
        space.add_arc((5000, 2000, 20), 100, 30, 200)
    elif kind == "ellipse":
        space.add_ellipse((5000, 2000, 20), (0, 100, 0), 1.0)
    else:
        angle = np.linspace(0, np.pi, 60)
        space.add_spline([(5000 + 100 * np.cos(a), 2000 + 100 * np.sin(a), 20) for a in angle])
    document.saveas(tmp_path / "map.dxf")
    (line,), (height,) = (found := read_contours(tmp_path / "map.dxf")).lines, found.heights
    off = np.linalg.norm(line - [5000, 2000], axis=1) - 100
    middle = np.linalg.norm((line[1:] + line[:-1]) / 2 - [5000, 2000], axis=1) - 100
    assert height == 20 and len(line) > 20
    slack = 0.02 if kind == "spline" else 1e-3  # its ends lie off the circle through its points
    assert np.abs(off).max() < slack and np.abs(middle).max() < slack + 0.01
    is_ring = kind not in ("arc", "spline")
    assert (line[0] == line[-1]).all() == is_ring
    length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    share = {"arc": 170 / 360, "spline": 0.5}.get(kind, 1.0)
    assert length == pytest.approx(share * 2 * np.pi * 100, rel=1e-3)


def test_the_frame_of_a_smoothed_polyline_is_no_part_of_the_contour(tmp_path):
    document = ezdxf.new()
    document.header["$INSUNITS"] = 6
    smooth = [(1000 + 10 * k, 500 + k * k, 40) for k in range(6)]
    drawn = document.modelspace().add_polyline3d(smooth)
    drawn.dxf.flags |= drawn.SPLINE_FIT_VERTICES_ADDED
    for vertex in drawn.vertices:
        vertex.dxf.flags |= vertex.SPLINE_VERTEX_CREATED
    drawn.append_vertices([(1000, 500, 40), (1030, 480, 40), (1050, 525, 40)])
    for vertex in drawn.vertices[6:]:
        vertex.dxf.flags |= vertex.SPLINE_FRAME_CONTROL_POINT
    document.saveas(tmp_path / "map.dxf")
    np.testing.assert_array_equal(read_contours(tmp_path / "map.dxf").lines[0], np.array(smooth)[:, :2])


NAMES = st.sampled_from(["ELEV", "Elevation", "hoehe", "CONTOUR", "z"])


@pytest.mark.parametrize("ending", [".shp", ".gpkg"])
@few
@given(map_of=lines(), name=NAMES, whole=st.booleans(), in_space=st.booleans(), is_multi=st.booleans())
def test_lines_in_one_piece_and_in_several_come_back_from_geographic_files(
    ending, tmp_path, map_of, name, whole, in_space, is_multi
):
    pyogrio = pytest.importorskip("pyogrio")
    drawn, levels = map_of
    levels = np.round(levels) if whole else levels
    if is_multi:  # all lines are one feature
        levels = np.full(len(drawn), levels[0])
    rows = [np.column_stack([line, np.full(len(line), -5.0)]) if in_space else line for line in drawn]
    parts = [rows] if is_multi else [[row] for row in rows]
    wkb = np.array([wkb_of(of, is_multi=is_multi) for of in parts], dtype=object)
    column = levels[: len(parts)].astype(np.int32 if whole else np.float64)
    kind = "Multi" * is_multi + "LineString" + " Z" * in_space
    path = tmp_path / f"map{ending}"
    path.unlink(missing_ok=True)
    pyogrio.raw.write(path, wkb, [column], [name], geometry_type=kind, crs="EPSG:26910", layer="map")
    found = read_contours(path)
    assert "26910" in found.crs
    np.testing.assert_allclose(found.heights, levels, rtol=1e-12, atol=1e-12)  # tables are of decimals
    for line, kept in zip(drawn, found.lines, strict=True):
        np.testing.assert_array_equal(kept, line)


@few
@given(map_of=lines(), spots=SPOTS)
def test_spots_and_heights_of_vertices_come_back_from_a_geopackage(tmp_path, map_of, spots):
    pyogrio = pytest.importorskip("pyogrio")
    drawn, levels = map_of
    wkb = [wkb_of([np.column_stack([line, np.full(len(line), z)])], is_multi=False) for line, z in zip(*map_of)]
    wkb += [struct.pack("<BI3d", 1, 1001, *spot, 7.0) for spot in spots]
    (path := tmp_path / "map.gpkg").unlink(missing_ok=True)
    pyogrio.raw.write(path, np.array(wkb, dtype=object), [], [], geometry_type="Unknown", crs="EPSG:26910", layer="map")
    found = read_contours(path)
    np.testing.assert_array_equal(found.heights, levels)
    np.testing.assert_array_equal(found.spots, np.column_stack([spots, np.full(len(spots), 7.0)]))
    for line, kept in zip(drawn, found.lines, strict=True):
        np.testing.assert_array_equal(kept, line)


GRID_TYPES = ["uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64"]


@st.composite
def rasters(draw):
    """Heights row by row from the north in a type of number, and which of them are not known."""
    shape = draw(st.tuples(st.integers(2, 9), st.integers(2, 9)))
    kind = np.dtype(draw(st.sampled_from(GRID_TYPES)))
    low, high = (-1000, 9000) if kind.kind == "f" else (max(np.iinfo(kind).min, -999), min(np.iinfo(kind).max, 9000))
    whole = st.integers(low, high - 1).map(float)
    values = draw(
        arrays(kind, shape, elements=st.floats(low, high, width=8 * kind.itemsize) if kind.kind == "f" else whole)
    )
    unknown = draw(arrays(bool, shape))
    assume(not unknown.all() and (values[~unknown] != high).all())
    return np.where(unknown, np.array(high, kind), values), unknown


@few
@given(
    raster=rasters(), cell=st.tuples(st.floats(0.1, 1e3), st.floats(0.1, 1e3)), corner=st.tuples(PLACES, PLACES),
    options=st.sampled_from([{}, {"compress": "deflate"}, {"compress": "lzw", "predictor": 2}, {"interleave": "band"}]),
    scale=st.sampled_from([(1.0, 0.0), (0.1, -50.0), (0.3048, 0.0)]), point=st.booleans(),
)  # fmt: skip
def test_heights_and_their_places_come_back_from_a_geotiff(tmp_path, raster, cell, corner, options, scale, point):
    rasterio = pytest.importorskip("rasterio")
    values, unknown = raster
    (ny, nx), (west, north) = values.shape, corner
    way = rasterio.Affine(cell[0], 0.0, west, 0.0, -cell[1], north)
    options = {} if values.dtype.kind == "f" and "predictor" in options else options
    facts = {"width": nx, "height": ny, "count": 1, "dtype": values.dtype, "crs": "EPSG:32755", "transform": way}
    nodata = float(values[unknown][0]) if unknown.any() else None
    with rasterio.open(tmp_path / "map.tif", "w", driver="GTiff", nodata=nodata, **facts, **options) as file:
        file.write(values, 1)
        file.scales, file.offsets = (scale[0],), (scale[1],)
        if point:
            file.update_tags(AREA_OR_POINT="Point")
    found, source = read_height_grid(tmp_path / "map.tif"), open_height_grid(tmp_path / "map.tif")
    expected = np.where(unknown, np.nan, values.astype(float) * scale[0] + scale[1])[::-1]
    np.testing.assert_allclose(found.heights, expected, rtol=1e-12)
    np.testing.assert_allclose(source.read(slice(0, ny), slice(0, nx)), expected, rtol=1e-12)
    for grid in (found, source):
        np.testing.assert_allclose(grid.x, west + cell[0] * (np.arange(nx) + 0.5), rtol=1e-12)
        np.testing.assert_allclose(grid.y, north - cell[1] * (np.arange(ny)[::-1] + 0.5), rtol=1e-12)
        assert "32755" in grid.crs


TILE = 1201  # places along a side: three seconds of arc from one to the next


@settings(few, max_examples=2)
@given(
    west=st.integers(-179, 178), south=st.integers(-55, 59), base=st.floats(-100, 5000),
    slopes=st.tuples(*[st.floats(-800, 800)] * 2), void=st.tuples(*[st.integers(100, 1000)] * 2),
)  # fmt: skip
def test_a_slope_comes_back_from_a_tile_of_srtm_but_for_its_voids(tmp_path, west, south, base, slopes, void):
    pytest.importorskip("rasterio")
    from rasterio.warp import transform

    down, right = np.meshgrid(np.linspace(0, 1, TILE), np.linspace(0, 1, TILE), indexing="ij")
    heights = np.round(base + slopes[0] * right + slopes[1] * (1 - down)).astype(">i2")
    heights[void[0] : void[0] + 30, void[1] : void[1] + 30] = -32768
    name = f"{'NS'[south < 0]}{abs(south):02d}{'EW'[west < 0]}{abs(west):03d}.hgt"
    (tmp_path / name).write_bytes(heights.tobytes())
    found = read_height_grid(tmp_path / name, project=True)
    places, known = found.places()
    east, north = (np.array(degrees) for degrees in transform(found.crs, "EPSG:4326", *places.T))
    expected = base + slopes[0] * (east - west) + slopes[1] * (north - south)
    # a whole number is written, and the tile's border is taken half a cell wide
    np.testing.assert_allclose(known, expected, atol=1.5 + 2 * np.abs(slopes).max() / TILE)
    assert np.ptp(east) == pytest.approx(1.0, abs=0.02) and np.ptp(north) == pytest.approx(1.0, abs=0.02)
    hole = transform("EPSG:4326", found.crs, [west + (void[1] + 15) / 1200], [south + 1 - (void[0] + 15) / 1200])
    row, column = np.abs(found.y - hole[1][0]).argmin(), np.abs(found.x - hole[0][0]).argmin()
    assert np.isnan(found.heights[row, column])


@few
@given(
    n=st.integers(3, 9), middle=st.tuples(PLACES, PLACES), size=st.floats(1.0, 1e3),
    form=st.sampled_from(["alone", "feature", "collection"]), in_space=st.booleans(),
)  # fmt: skip
def test_a_polygon_comes_back_from_geojson(tmp_path, n, middle, size, form, in_space):
    angle = np.arange(n + 1) % n * 2 * np.pi / n
    ring = np.array(middle) + size * np.column_stack([np.cos(angle), np.sin(angle)])
    rows = np.column_stack([ring, np.ones(n + 1)]) if in_space else ring
    content = {"type": "Polygon", "coordinates": [rows.tolist()]}
    if form != "alone":
        content = {"type": "Feature", "properties": {}, "geometry": content}
    if form == "collection":
        content = {"type": "FeatureCollection", "features": [content]}
    (tmp_path / "clip.geojson").write_text(json.dumps(content))
    np.testing.assert_array_equal(read_polygon(tmp_path / "clip.geojson"), ring)
