import os
import sys

import pytest

from recon.errors import UnreadableFile
from recon.readers.content import file_text
from recon.readers.contours import read_contours
from recon.readers.height_grids import read_height_grid
from recon.readers.meshes import read_mesh
from recon.readers.picks import read_picks
from recon.readers.views import read_views

READERS = [
    (read_mesh, ".ply"),
    (read_picks, ".json"),
    (read_contours, ".geojson"),
    (read_contours, ".csv"),
    (read_height_grid, ".asc"),
    (read_height_grid, ".json"),
    (read_views, ".dxf"),
    (read_views, ".json"),
]


@pytest.mark.parametrize(("read", "ending"), READERS)
def test_every_reader_tells_of_a_missing_file_in_the_same_words(tmp_path, read, ending):
    with pytest.raises(UnreadableFile, match="there is no such file"):
        read(tmp_path / f"nothing{ending}")


@pytest.mark.parametrize(("read", "ending"), READERS)
def test_no_reader_takes_a_folder(tmp_path, read, ending):
    (tmp_path / f"folder{ending}").mkdir()
    with pytest.raises(UnreadableFile, match="is a folder"):
        read(tmp_path / f"folder{ending}")


@pytest.mark.skipif(sys.platform == "win32", reason="there are no named pipes in the file system")
@pytest.mark.parametrize(("read", "ending"), READERS)
def test_no_reader_waits_for_a_pipe(tmp_path, read, ending):
    os.mkfifo(tmp_path / f"pipe{ending}")
    with pytest.raises(UnreadableFile, match="a device or a pipe"):
        read(tmp_path / f"pipe{ending}")


def test_bytes_that_are_no_text_are_refused(tmp_path):
    (tmp_path / "file.csv").write_bytes(b"\xff\xfe\x80 no text")
    with pytest.raises(UnreadableFile, match="is no text"):
        file_text(tmp_path / "file.csv")


def test_a_mark_of_byte_order_is_no_part_of_the_text(tmp_path):
    (tmp_path / "file.csv").write_bytes(b"\xef\xbb\xbfx,y,z")
    assert file_text(tmp_path / "file.csv") == "x,y,z"
