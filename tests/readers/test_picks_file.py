"""Picked points are read as written, and nothing else passes for three points."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.errors import UnreadableFile
from recon.readers.picks import read_picks

AROUND = np.array([[15.0, 0.0, 0.0], [-9.0, 12.0, 0.0], [-9.0, -12.0, 0.0]])


def test_picks_are_read_as_written(tmp_path):
    path = tmp_path / "picks.json"
    path.write_text(json.dumps({"picks": AROUND.tolist(), "comment": "by hand"}))
    assert_allclose(read_picks(path), AROUND)


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[1, 2",
        "[]",
        "3",
        "{}",
        '{"picks": null}',
        '{"picks": [[0, 0, 0], [1, 0, 0]]}',
        '{"picks": [[0, 0, 0], [1, 0, 0], [0, 1]]}',
        '{"picks": [[0, 0, 0], [1, 0, 0], [0, 1, "2"]]}',
        '{"picks": [[0, 0, 0], [1, 0, 0], [0, 1, NaN]]}',
        '{"picks": [[0, 0, 0], [1, 0, 0], [0, 1, true]]}',
        '{"picks": [[0, 0, 0], [1, 0, 0], [0, 1, 1' + "0" * 400 + "]]}",
    ],
)
def test_anything_but_three_points_is_refused_with_the_shape_expected(tmp_path, content):
    path = tmp_path / "picks.json"
    path.write_text(content)
    with pytest.raises(UnreadableFile, match="picks"):
        read_picks(path)


def test_a_missing_or_binary_file_is_refused(tmp_path):
    with pytest.raises(UnreadableFile):
        read_picks(tmp_path / "none.json")
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(UnreadableFile, match="no JSON"):
        read_picks(tmp_path / "binary.json")
