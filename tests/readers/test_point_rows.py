"""Point rows from text: any separator, a header, comments; what is no row of points is named."""

import numpy as np
import pytest

from recon.errors import BadGeometry, UnreadableFile, UnsupportedFormat
from recon.readers.point_rows import read_point_row


@pytest.mark.parametrize(
    "text",
    [
        "0 0\n1 2\n",
        "x,y\n0,0\n1,2\n",
        "# a comment\n0;0\n1;2 # the end\n",
        "0,\t0,\n1,\t2,\n",
        "\ufeffx y\r\n0 0\r\n1 2",
    ],
)
def test_separators_headers_and_comments(text, tmp_path):
    file = tmp_path / "row.csv"
    file.write_bytes(text.encode())
    assert read_point_row(file).tolist() == [[0.0, 0.0], [1.0, 2.0]]


@pytest.mark.parametrize(
    ("text", "error", "says"),
    [
        ("", UnreadableFile, "empty"),
        ("x y\n", UnreadableFile, "no points"),
        ("1 2 3 4\n", UnreadableFile, "4 columns"),
        ("1 2\n1 2 3\n", UnreadableFile, "point 2"),
        ("1 2\n1 apple\n", UnreadableFile, "'apple'"),
        ("1 2\n1 nan\n", BadGeometry, "point 2"),
    ],
)
def test_what_is_no_row_is_named(text, error, says, tmp_path):
    file = tmp_path / "row.xyz"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(error, match=says):
        read_point_row(file)


def test_three_coordinates_lie_in_space(tmp_path):
    file = tmp_path / "row.txt"
    np.savetxt(file, np.arange(12.0).reshape(4, 3))
    assert read_point_row(file).shape == (4, 3)
    with pytest.raises(UnsupportedFormat):
        read_point_row(tmp_path / "row.ply")
