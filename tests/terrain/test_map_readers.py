"""Contour lines and height grids from files, and what is refused."""

import json

import numpy as np
import pytest
from generated_mountains import mountain_contours, mountain_grid

from recon.errors import BadGeometry, BadOption, UnreadableFile, UnsupportedFormat
from recon.geometry.contour_map import HeightGrid
from recon.readers import height_grids
from recon.readers.contours import read_contours
from recon.readers.height_grids import open_height_grid, read_height_grid
from recon.terrain.contouring import contour_grid, largest_piece

UTM = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::26910"}}


def feature(line, height=10.0, name="ELEV"):
    return {
        "type": "Feature",
        "properties": {} if height is None else {name: height},
        "geometry": {"type": "LineString", "coordinates": line},
    }


def written(tmp_path, features, crs=UTM):
    path = tmp_path / "map.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": features}))
    return path


def test_geojson_gives_back_every_line_with_its_height(tmp_path):
    contours = mountain_contours(3)
    path = written(tmp_path, [feature(c.tolist(), z) for c, z in zip(contours.lines, contours.heights.tolist())])
    again = read_contours(path)
    assert again.crs.endswith("26910")
    np.testing.assert_array_equal(again.heights, contours.heights)
    for a, b in zip(again.lines, contours.lines):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_csv_gives_back_every_line_with_its_height(tmp_path):
    contours = mountain_contours(3)
    rows = ["x,y,z,line"] + [
        f"{x!r},{y!r},{z!r},{k}"
        for k, (line, z) in enumerate(zip(contours.lines, contours.heights.tolist()))
        for x, y in line.tolist()
    ]
    path = tmp_path / "map.csv"
    path.write_text("\n".join(rows))
    again = read_contours(path)
    np.testing.assert_array_equal(again.heights, contours.heights)
    np.testing.assert_array_equal(np.concatenate(again.lines), np.concatenate(contours.lines))


@pytest.mark.parametrize(
    ("features", "error", "words"),
    [
        ([feature([[0, 0], [100, 50]], None)], BadGeometry, "contour 0: has no height"),
        ([feature([[0, 0], [99, 9]]), feature([[5, 5]])], BadGeometry, "contour 1: has one vertex only"),
        ([feature([[0, 0, 1], [100, 50, 2]], None)], BadGeometry, "changes its height"),
        ([], UnreadableFile, "no contour lines"),
        ([{"geometry": {"type": "Point", "coordinates": [0, 0]}}], BadGeometry, "spot 0: has no height"),
        ([{"geometry": {"type": "Polygon", "coordinates": []}}], UnreadableFile, "feature 0 is a Polygon"),
    ],
)
def test_a_faulty_contour_is_named_by_number(tmp_path, features, error, words):
    with pytest.raises(error, match=words):
        read_contours(written(tmp_path, features))


def test_degrees_are_refused(tmp_path):
    with pytest.raises(UnreadableFile, match="degrees"):
        read_contours(written(tmp_path, [feature([[8.5, 47.1], [8.6, 47.2]])], crs=None))


def test_a_named_attribute_has_to_be_there(tmp_path):
    path = written(tmp_path, [feature([[0, 0], [100, 50]], 7.0, "HOEHE_M")])
    assert read_contours(path, attribute="HOEHE_M").heights.tolist() == [7.0]
    with pytest.raises(BadOption, match="--attribute"):
        read_contours(path, attribute="LEVEL")


def test_ascii_and_json_grids_give_back_the_heights(tmp_path):
    grid = mountain_grid(1)
    north_first = grid.heights[::-1]
    table = "\n".join(" ".join(repr(float(z)) for z in row) for row in north_first)
    asc = tmp_path / "grid.asc"
    asc.write_text(f"ncols 61\nnrows 45\nxllcorner -5\nyllcorner -5\ncellsize 10\nnodata_value -9999\n{table}\n")
    rows = tmp_path / "grid.json"
    rows.write_text(json.dumps({"width": 61, "height": 45, "values": north_first.ravel().tolist()}))
    for path in (asc, rows):
        again = read_height_grid(path)
        np.testing.assert_allclose(again.heights, grid.heights)
        np.testing.assert_allclose(again.x, grid.x)
        np.testing.assert_allclose(again.y, grid.y)


def long_text(tmp_path, monkeypatch, rows):
    """A text file that counts as a long one."""
    monkeypatch.setattr(height_grids, "LONG", 0)
    path = tmp_path / "grid.asc"
    head = f"NCOLS {len(rows[0].split())}\nNROWS 150\nXLLCENTER 5\nYLLCENTER 7\nCELLSIZE 10\nNODATA_VALUE -9999\n"
    path.write_text(head + "\n".join(rows) + "\n")
    return path


def test_windows_of_a_long_text_grid_hold_the_heights_of_the_whole(tmp_path, monkeypatch):
    values = np.random.default_rng(1).uniform(-50.0, 900.0, (150, 40)).round(3)
    values[3, 7] = -9999
    path = long_text(tmp_path, monkeypatch, [" ".join(map(str, row)) for row in values.tolist()])
    whole, source = read_height_grid(path), open_height_grid(path)
    assert np.isnan(whole.heights).sum() == 1
    np.testing.assert_array_equal(source.x, whole.x)
    np.testing.assert_array_equal(source.y, whole.y)
    for rows, columns in (
        (slice(0, 150), slice(0, 40)),
        (slice(61, 66), slice(5, 6)),
        (slice(140, 400), slice(30, 99)),
    ):
        np.testing.assert_array_equal(source.read(rows, columns), whole.heights[rows, columns])


@pytest.mark.parametrize(
    ("spoilt", "told"),
    [("1 2 3", "row 150 has 3 heights"), ("1 2 x 4", "row 150: could not convert.* b'x'"), ("", "one a line")],
)
def test_a_faulty_row_of_a_long_text_grid_is_named(tmp_path, monkeypatch, spoilt, told):
    path = long_text(tmp_path, monkeypatch, ["1 2 3 4"] * 149 + [spoilt])
    with pytest.raises(UnreadableFile, match=told):
        open_height_grid(path).read(slice(0, 2), slice(0, 4))


def test_rows_beyond_a_part_of_a_long_text_grid_are_not_looked_at(tmp_path, monkeypatch):
    words = " ".join(map(str, range(60)))
    source = open_height_grid(long_text(tmp_path, monkeypatch, [words] * 149 + ["1 2 x 4"]))
    part = source.part(slice(70, 120), slice(5, 40))
    np.testing.assert_array_equal(part.read(slice(None), slice(30, 99)), np.tile(np.arange(35.0, 40.0), (50, 1)))


def raster(path, heights, *, crs="EPSG:32610", scale=1.0, unit="metre", **layout):
    rasterio = pytest.importorskip("rasterio")
    ny, nx = heights.shape
    way = rasterio.transform.from_origin(500_000.0, 4_000_000.0 + 10.0 * ny, 10.0, 10.0)
    layout = {
        "driver": "GTiff",
        "count": 1,
        "dtype": heights.dtype,
        "nodata": -9999,
        "transform": way,
        "crs": crs,
    } | layout
    with rasterio.open(path, "w", width=nx, height=ny, **layout) as file:
        file.write(heights[::-1], 1)
        file.scales, file.units = (scale,), (unit,)
    return path


@pytest.mark.parametrize(
    "layout",
    [
        {"tiled": True, "blockxsize": 64, "blockysize": 32, "compress": "deflate", "predictor": 3},
        {"compress": "lzw"},
        {},
    ],
    ids=["tiles packed", "strips packed", "strips"],
)
def test_windows_of_a_geotiff_hold_the_heights_of_the_whole(tmp_path, layout):
    values = np.random.default_rng(1).uniform(-50.0, 900.0, (150, 140)).astype(np.float32)
    values[3, 7] = -9999
    path = raster(tmp_path / "grid.tif", values, **layout)
    whole, source = read_height_grid(path), open_height_grid(path)
    assert np.isnan(whole.heights).sum() == 1
    np.testing.assert_array_equal(whole.heights[4:], values[4:])
    assert (whole.x[0], whole.y[0]) == (source.x[0], source.y[0]) == (500_005.0, 4_000_005.0)
    for rows, columns in (
        (slice(0, 150), slice(0, 140)),
        (slice(61, 66), slice(5, 6)),
        (slice(140, 400), slice(90, 299)),
    ):
        np.testing.assert_array_equal(source.read(rows, columns), whole.heights[rows, columns])


def test_heights_of_a_geotiff_are_what_its_scale_tells(tmp_path):
    path = raster(tmp_path / "grid.tif", np.arange(1500, 1600, dtype=np.int16).reshape(10, 10), scale=0.5)
    for heights in (read_height_grid(path).heights, open_height_grid(path).read(slice(0, 10), slice(0, 10))):
        np.testing.assert_array_equal(heights.ravel(), 0.5 * np.arange(1500, 1600))


@pytest.mark.parametrize(
    ("told", "words"),
    [({"crs": "EPSG:2225"}, "in units of 0.304801 m"), ({"unit": "ft"}, "has heights in ft")],
)
def test_a_geotiff_in_feet_is_refused(tmp_path, told, words):
    path = raster(tmp_path / "grid.tif", np.ones((10, 10), dtype=np.float32), **told)
    for read in (read_height_grid, open_height_grid):
        with pytest.raises(UnreadableFile, match=words):
            read(path)


@pytest.mark.parametrize("content", ["", "{}", "[1, 2]", "words"])
def test_a_file_that_holds_no_grid_is_refused(tmp_path, content):
    for ending in (".asc", ".json"):
        path = tmp_path / f"grid{ending}"
        path.write_text(content)
        with pytest.raises(UnreadableFile):
            read_height_grid(path)


def test_unknown_endings_are_refused():
    with pytest.raises(UnsupportedFormat):
        read_contours("map.xyz")
    with pytest.raises(UnsupportedFormat):
        read_height_grid("map.xyz")


def test_contours_of_whole_heights_do_not_touch():
    grid = mountain_grid(2)
    contours = contour_grid(HeightGrid(grid.x, grid.y, np.round(grid.heights)), 10.0)
    points = np.concatenate(contours.lines)
    assert len(np.unique(points.round(6), axis=0)) == contours.n_points


def test_a_void_is_the_four_cells_around_a_height_that_is_not_known():
    grid = mountain_grid(2)
    heights = grid.heights.copy()
    heights[3, 4] = np.nan
    contours = contour_grid(HeightGrid(grid.x, grid.y, heights), 10.0)
    (ring,) = contours.voids
    assert ring.min(axis=0).tolist() == [30.0, 20.0]
    assert ring.max(axis=0).tolist() == [50.0, 40.0]
    assert len(ring) == 5


def test_what_voids_cut_off_is_counted_and_left_out():
    grid = mountain_grid(2)
    heights = grid.heights.copy()
    heights[:, 40] = np.nan
    cut = HeightGrid(grid.x, grid.y, heights)
    with pytest.raises(BadGeometry, match="cut it in 2 pieces"):
        contour_grid(cut, 10.0)
    piece, lost = largest_piece(cut)
    assert lost == 45 * 20
    contours = contour_grid(piece, 10.0)
    assert contours.extent[1, 0] == 390.0
    assert not contours.voids


def test_cells_that_meet_in_a_corner_are_parted():
    heights = np.add.outer(np.arange(12.0), np.arange(12.0))
    heights[4, 4] = heights[6, 6] = np.nan  # the voids around them share the corner (5, 5)
    contours = contour_grid(HeightGrid(np.arange(12.0), np.arange(12.0), heights), 3.0)
    (ring,) = contours.voids
    assert len(np.unique(ring[:-1], axis=0)) == len(ring) - 1


def test_points_are_spot_heights_and_sloping_lines_break_lines_where_asked(tmp_path):
    point = {"properties": {"ELEV": 17.5}, "geometry": {"type": "Point", "coordinates": [40, 30]}}
    points = {"properties": {}, "geometry": {"type": "MultiPoint", "coordinates": [[50, 30, 12], [60, 30, 13]]}}
    ridge = feature([[0, 5, 11], [80, 60, 19]], None)
    path = written(tmp_path, [feature([[0, 0], [100, 0]]), feature([[0, 90], [100, 90]], 20.0), point, points])
    assert read_contours(path).spots.tolist() == [[40, 30, 17.5], [50, 30, 12], [60, 30, 13]]
    path = written(tmp_path, [feature([[0, 0], [100, 0]]), ridge])
    with pytest.raises(BadGeometry, match="--break-lines"):
        read_contours(path)
    assert read_contours(path, break_lines=True).spots.tolist() == [[0, 5, 11], [80, 60, 19]]


def test_csv_rows_without_a_line_are_spot_heights(tmp_path):
    path = tmp_path / "map.csv"
    path.write_text("x,y,z,line\n0,0,10,1\n100,0,10,1\n50,40,13,\n0,90,20,2\n100,90,20,2\n")
    contours = read_contours(path)
    assert contours.spots.tolist() == [[50, 40, 13]]
    assert contours.heights.tolist() == [10, 20]


@pytest.mark.parametrize("interval", [0.0, -5.0, float("nan"), 1e6])
def test_an_interval_has_to_give_contours(interval):
    with pytest.raises(BadOption, match="--interval"):
        contour_grid(mountain_grid(1), interval)


def drawing(path, unit, closed=False):
    import ezdxf

    document = ezdxf.new()
    document.header["$INSUNITS"] = unit
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (1000, 500), (2000, 0)], dxfattribs={"elevation": 40}, close=closed)
    space.add_polyline3d([(0, 900, 50), (900, 1000, 50), (2000, 900, 50)])
    document.saveas(path)
    return path


def test_dxf_gives_polylines_at_their_elevation(tmp_path):
    contours = read_contours(drawing(tmp_path / "map.dxf", 6, closed=True))
    assert contours.heights.tolist() == [40.0, 50.0]
    assert (contours.lines[0][0] == contours.lines[0][-1]).all()


def test_dxf_in_inches_is_asked_about_and_feet_become_metres(tmp_path):
    with pytest.raises(UnreadableFile, match=r"inches.*--unit m"):
        read_contours(drawing(tmp_path / "map.dxf", 1))
    assert read_contours(tmp_path / "map.dxf", unit="m").heights.tolist() == [40.0, 50.0]
    assert read_contours(tmp_path / "map.dxf", unit="ft").heights.tolist() == [40 * 0.3048, 50 * 0.3048]


@pytest.mark.parametrize("ending", ["gpkg", "shp"])
def test_geopackage_and_shapefile_give_back_lines_and_heights(tmp_path, ending):
    pyogrio, shapely = pytest.importorskip("pyogrio"), pytest.importorskip("shapely")
    contours = mountain_contours(3)
    path = tmp_path / f"map.{ending}"
    wkb = np.array([shapely.to_wkb(shapely.LineString(line)) for line in contours.lines], dtype=object)
    pyogrio.raw.write(
        path, wkb, [contours.heights], ["ELEV"], geometry_type="LineString", crs="EPSG:26910", layer="map"
    )  # fmt: skip
    again = read_contours(path)
    assert "26910" in again.crs
    np.testing.assert_array_equal(again.heights, contours.heights)
    np.testing.assert_allclose(np.concatenate(again.lines), np.concatenate(contours.lines), atol=1e-9)


def test_maps_in_degrees_are_projected_on_request(tmp_path):
    pytest.importorskip("rasterio")
    ring = [[-122.19, 46.20], [-122.18, 46.20], [-122.18, 46.21], [-122.19, 46.20]]
    spot = {"properties": {"ELEV": 30.0}, "geometry": {"type": "Point", "coordinates": [-122.184, 46.203]}}
    path = written(tmp_path, [feature(ring, 20.0), spot], crs=None)
    contours = read_contours(path, project=True)
    assert contours.crs == "EPSG:32610"
    # a hundredth of a degree: 1112 m along a meridian, and so much times the cosine of the latitude along a parallel
    steps = np.linalg.norm(np.diff(contours.lines[0], axis=0), axis=1)
    assert steps[0] == pytest.approx(1113.2 * np.cos(np.radians(46.2)), rel=3e-3)
    assert steps[1] == pytest.approx(1111.5, rel=3e-3)
    assert contours.spots[0, 2] == 30.0
    assert (contours.spots[:, :2] > contours.extent[0]).all()


def in_file(path, crs, ring):
    """A Shapefile or GeoPackage of two contours around each other."""
    pyogrio, shapely = pytest.importorskip("pyogrio"), pytest.importorskip("shapely")
    lines = [np.array(ring), np.mean(ring[:-1], axis=0) + 0.5 * (np.array(ring) - np.mean(ring[:-1], axis=0))]
    wkb = np.array([shapely.to_wkb(shapely.LineString(line)) for line in lines], dtype=object)
    pyogrio.raw.write(path, wkb, [np.array([10.0, 20.0])], ["ELEV"], geometry_type="LineString", crs=crs, layer="map")
    return path


RING = [[-122.19, 46.20], [-122.18, 46.20], [-122.18, 46.21], [-122.19, 46.20]]


@pytest.mark.parametrize(("crs", "moved"), [("EPSG:4269", 2.0), ("EPSG:4267", 100.0)])
@pytest.mark.parametrize("ending", ["gpkg", "shp"])
def test_degrees_of_other_systems_than_that_of_the_satellites_are_known(tmp_path, ending, crs, moved):
    pytest.importorskip("rasterio")
    path = in_file(tmp_path / f"map.{ending}", crs, RING)
    with pytest.raises(UnreadableFile, match="degrees"):
        read_contours(path)
    found = read_contours(path, project=True)
    satellite = read_contours(written(tmp_path, [feature(RING, 10.0)], crs=None), project=True)
    apart = np.linalg.norm(found.lines[0][0] - satellite.lines[0][0])
    assert found.crs == satellite.crs == "EPSG:32610"
    assert 0.9 * moved <= apart <= 1.5 * moved if moved > 10 else apart <= moved


@pytest.mark.parametrize(
    "crs", ["http://localhost:1/crs", "map.prj", "EPSG:none", "urn:ogc:def:crs:OGC:1.3:CRS84", "PROJCS["]
)
def test_the_name_of_a_coordinate_system_is_neither_opened_nor_fetched(tmp_path, crs):
    (tmp_path / "map.prj").write_text('GEOGCS["WGS 84"]')
    path = written(tmp_path, [feature(RING, 10.0)], crs={"type": "name", "properties": {"name": crs}})
    if crs.endswith("CRS84"):
        with pytest.raises(UnreadableFile, match="degrees"):
            read_contours(path)
    else:
        assert read_contours(path).crs == crs


def test_a_coordinate_system_in_feet_is_asked_about(tmp_path):
    pytest.importorskip("rasterio")
    ring = [[990000, 190000], [991000, 190000], [991000, 191000], [990000, 190000]]
    path = in_file(tmp_path / "map.gpkg", "EPSG:2263", ring)
    with pytest.raises(UnreadableFile, match=r"units of 0.304801 m.*--unit"):
        read_contours(path)
    found = read_contours(path, unit="us-ft")
    np.testing.assert_allclose(found.lines[0], np.array(ring) * 1200 / 3937)


def test_a_grid_in_feet_is_refused(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    facts = {"width": 3, "height": 4, "count": 1, "dtype": "float32", "crs": "EPSG:2263"}
    way = rasterio.Affine(10.0, 0.0, 990000.0, 0.0, -10.0, 190000.0)
    with rasterio.open(tmp_path / "map.tif", "w", driver="GTiff", transform=way, **facts) as file:
        file.write(np.ones((4, 3), np.float32), 1)
    for read in (read_height_grid, open_height_grid):
        with pytest.raises(UnreadableFile, match=r"units of 0.304801 m.*Project it"):
            read(tmp_path / "map.tif")


def test_an_srtm_tile_is_refused_in_degrees_and_read_in_metres_with_its_voids(tmp_path):
    pytest.importorskip("rasterio")
    n = 1201  # three seconds of arc
    rows, columns = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    heights = (500 + 0.2 * rows + 100 * np.sin(columns / 80)).astype(">i2")
    heights[600:620, 300:330] = -32768
    path = tmp_path / "N46W123.hgt"
    path.write_bytes(heights.tobytes())
    with pytest.raises(UnreadableFile, match=r"degrees.*--project"):
        read_height_grid(path)
    grid = read_height_grid(path, project=True)
    assert grid.crs == "EPSG:32610"
    known = np.isfinite(grid.heights)
    assert known.mean() > 0.9
    assert grid.heights[known].min() > 390
    middle = np.argwhere(~known[200:-200, 200:-200])
    assert 500 < len(middle) < 1000
    assert np.diff(grid.x).mean() == pytest.approx(np.diff(grid.y).mean(), rel=1e-9)
