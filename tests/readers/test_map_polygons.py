"""Polygons on a map, and what is none."""

import json

import pytest

from recon.errors import UnreadableFile
from recon.readers.map_polygons import read_polygon

RING = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 0.0]]
POLYGON = {"type": "Polygon", "coordinates": [RING]}
FEATURE = {"type": "Feature", "properties": {}, "geometry": POLYGON}


@pytest.mark.parametrize("content", [POLYGON, FEATURE, {"type": "FeatureCollection", "features": [FEATURE]}])
def test_a_polygon_is_read_alone_or_in_a_feature(tmp_path, content):
    path = tmp_path / "part.geojson"
    path.write_text(json.dumps(content))
    assert read_polygon(path).tolist() == RING


@pytest.mark.parametrize(
    "content",
    [
        {"type": "FeatureCollection", "features": []},
        {"type": "LineString", "coordinates": RING},
        {"type": "Polygon", "coordinates": [RING, RING]},
        {"type": "Polygon", "coordinates": [RING[:-1]]},
        {"type": "Polygon", "coordinates": []},
        {"type": "Polygon", "coordinates": [[["a", 1], [2, 3], [4, 5], ["a", 1]]]},
        [],
        7,
    ],
)
def test_other_content_is_refused(tmp_path, content):
    path = tmp_path / "part.geojson"
    path.write_text(json.dumps(content))
    with pytest.raises(UnreadableFile):
        read_polygon(path)
