"""Damaged files of every format: our own errors come out, each one sentence, and nothing asks for much memory."""

import bz2
import gzip
import io
import json
import re
import resource
import struct
import zlib

import numpy as np
import pytest
from specimens import DAMAGES, SPECIMENS, dicom_slices

from recon.errors import ReconError, UnreadableFile
from recon.readers.volumes import read_volume

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
HUGE = 353_535_235_358
MEBIBYTE = 2**20


def put(folder, name, data):
    path = folder / f"file{SPECIMENS[name][1]}"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("name", SPECIMENS)
def test_the_specimens_are_sound(name, tmp_path):
    read, _, make = SPECIMENS[name]
    assert read(put(tmp_path, name, make())) is not None


@pytest.mark.parametrize("name", SPECIMENS)
def test_every_damage_is_refused_in_a_sentence_or_does_not_matter(name, tmp_path):
    read, _, make = SPECIMENS[name]
    data = make()
    for number, damage in enumerate(DAMAGES):
        for seed in range(3):
            path = put(tmp_path, name, damage(data, np.random.default_rng([number, seed])))
            try:
                read(path)
            except ReconError as problem:
                assert str(problem) and "\n" not in str(problem), damage.__name__


@pytest.mark.parametrize("name", SPECIMENS)
def test_a_file_that_was_cut_off_anywhere_in_its_header_is_no_fault(name, tmp_path):
    read, _, make = SPECIMENS[name]
    data = make()
    for size in range(0, min(len(data), 120), 7):
        try:
            read(put(tmp_path, name, data[:size]))
        except ReconError as problem:
            assert "\n" not in str(problem)


def memory_asked_for(read, path):
    """Megabytes by which the largest memory of this process grows, and what was said."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ReconError) as refusal:
        read(path)
    return (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024, str(refusal.value)


def npy_header(shape):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return stream.getvalue()


def npz_of_zeros(size):
    stream = io.BytesIO()
    np.savez_compressed(stream, voxels=np.zeros((size // 2**16, 256, 256), np.uint8))
    return stream.getvalue()


PLY = (
    b"ply\nformat %s 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n"
)
NRRD = b"NRRD0004\ntype: double\ndimension: 3\nsizes: 70707 5000 1000\nencoding: %s\n\n"
MHA = b"NDims = 3\nDimSize = 70707 5000 1000\nCompressedData = True\nElementType = MET_FLOAT\nElementDataFile = LOCAL\n"
PROMISES = {
    "mesh PLY text": PLY % (b"ascii", HUGE),
    "mesh PLY little": PLY % (b"binary_little_endian", HUGE),
    "mesh OFF": b"OFF\n%d 1 0\n0 0 0\n" % HUGE,
    "mesh STL": bytes(80) + struct.pack("<I", 0xFFFFFFFF) + bytes(100),
    "volume NPY": npy_header((70707, 5000, 1000)),
    "volume NRRD": NRRD % b"raw",
    "volume NRRD gzip": NRRD % b"gzip" + gzip.compress(bytes(1000)),
    "volume MHA zlib": MHA + zlib.compress(bytes(1000)),
    "volume binvox": b"#binvox 1\ndim 70707 5000 1000\ndata\n" + bytes([1, 255]) * 20,
    "grid ASC": b"ncols 70707\nnrows 5000000\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3\n",
    "grid JSON": b'{"width": 70707, "height": 5000000, "values": [1, 2]}',
}


@pytest.mark.parametrize("name", PROMISES)
def test_a_header_that_promises_more_than_any_file_holds_is_refused_before_memory_is_asked_for(name, tmp_path):
    asked, said = memory_asked_for(SPECIMENS[name][0], put(tmp_path, name, PROMISES[name]))
    assert asked < 60
    assert "fault" not in said


MUCH = 32 * MEBIBYTE
EIGHTS = NRRD.replace(b"double", b"uint8").replace(b"70707 5000 1000", b"%d 1024 1024" % (MUCH // MEBIBYTE))


def nifti_of(shape):
    head = bytearray(SPECIMENS["volume NIfTI"][2]()[:352])
    struct.pack_into("<8h", head, 40, 3, *shape, 1, 1, 1, 1)
    return bytes(head)


BOMBS = {
    "volume NPZ": lambda: npz_of_zeros(MUCH),
    "volume NRRD gzip": lambda: EIGHTS % b"gzip" + gzip.compress(bytes(MUCH), 9),
    "volume NRRD": lambda: EIGHTS % b"bzip2" + bz2.compress(bytes(MUCH), 9),
    "volume NIfTI gzip": lambda: gzip.compress(nifti_of((MUCH // MEBIBYTE, 1024, 1024)) + bytes(MUCH), 9),
}


@pytest.mark.parametrize("name", BOMBS)
def test_an_archive_that_would_fill_the_memory_is_not_unpacked(name, tmp_path, monkeypatch):
    monkeypatch.setattr("recon.readers.unpacking.LARGE", MUCH // 2)  # to make no gigabytes here
    with pytest.raises(UnreadableFile, match="would unpack to"):
        SPECIMENS[name][0](put(tmp_path, name, BOMBS[name]()))


@pytest.mark.parametrize("name", BOMBS)
def test_a_small_volume_that_packs_well_is_read(name, tmp_path):
    assert SPECIMENS[name][0](put(tmp_path, name, BOMBS[name]())).values.size == MUCH


def test_more_behind_a_packed_block_than_the_header_needs_is_not_unpacked(tmp_path):
    size = b"sizes: 6 5 7"
    data = b"NRRD0004\ntype: uint8\ndimension: 3\n" + size + b"\nencoding: gzip\n\n"
    volume = SPECIMENS["volume NRRD gzip"][0](put(tmp_path, "volume NRRD gzip", data + gzip.compress(bytes(MUCH), 1)))
    assert volume.values.shape == (6, 5, 7)


@pytest.mark.parametrize("cut", [1, 4, 9])
def test_a_packed_block_that_lacks_its_checksum_is_refused(cut, tmp_path):
    read, _, make = SPECIMENS["volume NRRD gzip"]
    with pytest.raises(UnreadableFile, match="packed"):
        read(put(tmp_path, "volume NRRD gzip", make()[:-cut]))


def test_a_packed_block_with_a_wrong_checksum_is_refused(tmp_path):
    read, _, make = SPECIMENS["volume NRRD gzip"]
    data = make()
    with pytest.raises(UnreadableFile, match="packed data are damaged"):
        read(put(tmp_path, "volume NRRD gzip", data[:-8] + bytes(4) + data[-4:]))


def test_elements_that_use_each_other_do_not_unfold_for_ever(tmp_path, monkeypatch):
    monkeypatch.setattr("recon.readers.view_svg.MOST_ELEMENTS", 3000)
    levels = "".join(f'<g id="g{k}">' + f'<use href="#g{k - 1}"/>' * 10 + "</g>" for k in range(1, 30))
    line = '<line id="g0" x2="5" y2="5" stroke="black"/>'
    path = put(tmp_path, "views SVG", f'<svg xmlns="http://www.w3.org/2000/svg">{line}{levels}</svg>'.encode())
    with pytest.raises(UnreadableFile, match="unfolds to more than"):
        SPECIMENS["views SVG"][0](path)


def test_entities_of_an_svg_neither_unfold_nor_fetch(tmp_path):
    secret = tmp_path / "secret.txt"
    secret.write_text("0 0 40 40")
    text = (
        f'<!DOCTYPE svg [<!ENTITY a SYSTEM "{secret.as_uri()}">]><svg xmlns="http://www.w3.org/2000/svg">'
        '<polyline points="&a;" stroke="black"/></svg>'
    )
    with pytest.raises(ReconError) as refusal:
        SPECIMENS["views SVG"][0](put(tmp_path, "views SVG", text.encode()))
    assert "40" not in str(refusal.value).replace(str(tmp_path), "")


def test_a_header_line_that_is_doubled_ends_the_reading(tmp_path):
    data = SPECIMENS["grid ASC"][2]()
    SPECIMENS["grid ASC"][0](put(tmp_path, "grid ASC", b"ncols 5\n" + data))


def test_lists_within_lists_without_end_are_refused(tmp_path):
    deep = b"[" * 100_000
    for name in ("grid JSON", "views JSON", "contours GeoJSON", "picks", "mesh glTF"):
        with pytest.raises(ReconError):
            SPECIMENS[name][0](put(tmp_path, name, deep))
    row = json.dumps({"width": 1, "height": 2, "values": [10**400, 1]}).encode()
    with pytest.raises(ReconError):
        SPECIMENS["grid JSON"][0](put(tmp_path, "grid JSON", row))


@pytest.mark.parametrize("word", [b"nan", b"inf", b"-1", b"256", b"0.5", b"1e30"])
def test_numbers_that_a_volume_in_text_cannot_hold_are_not_cast_to_others(word, tmp_path):
    for name, before in (("volume NRRD text", b"\n\n"), ("volume VTI text", b'format="ascii">')):
        data = SPECIMENS[name][2]()
        with pytest.raises(UnreadableFile, match="where its type is uint8"):
            SPECIMENS[name][0](put(tmp_path, name, data.replace(before + b"0", before + word, 1)))


def test_blocks_within_blocks_do_not_unfold_for_ever(tmp_path, monkeypatch):
    import ezdxf

    monkeypatch.setattr("recon.readers.view_dxf.MOST_ENTITIES", 200)
    drawing = ezdxf.new()
    drawing.blocks.new("b0").add_line((0, 0), (1, 1))
    for k in range(1, 12):
        block = drawing.blocks.new(f"b{k}")
        for _ in range(10):
            block.add_blockref(f"b{k - 1}", (0, 0))
    drawing.modelspace().add_blockref("b11", (0, 0))
    stream = io.StringIO()
    drawing.write(stream)
    with pytest.raises(UnreadableFile, match="blocks unfold to more than 200"):
        SPECIMENS["views DXF"][0](put(tmp_path, "views DXF", stream.getvalue().encode()))


def test_a_height_that_is_no_number_is_not_taken_for_zero(tmp_path):
    pytest.importorskip("pyogrio")
    read, _, make = SPECIMENS["contours Shapefile .dbf"]
    data = make()
    assert data.count(b"120.") == 1
    with pytest.raises(UnreadableFile, match="no number"):
        read(put(tmp_path, "contours Shapefile .dbf", data.replace(b"120.", b"1x0.")))


@pytest.fixture
def series(tmp_path):
    """A folder of four slices, the second as bytes to change."""
    pytest.importorskip("SimpleITK")
    for k, data in enumerate(dicom_slices()):
        (tmp_path / f"{k}.dcm").write_bytes(data)
    return tmp_path


def changed(file, old, new):
    data = file.read_bytes()
    assert data.count(old) == 1 and len(old) == len(new)
    file.write_bytes(data.replace(old, new))


def test_a_series_without_one_of_its_slices_is_not_moved_together(series):
    (series / "1.dcm").unlink()
    with pytest.raises(UnreadableFile, match=r"0.dcm and 2.dcm are 2 mm apart, others 1"):
        read_volume(series)


def test_a_slice_that_the_library_would_leave_out_is_named(series):
    changed(series / "3.dcm", b"DICM", b"DICX")
    with pytest.raises(UnreadableFile, match=r"holds 3.dcm, which cannot be read as a slice"):
        read_volume(series)


def test_a_slice_whose_element_is_longer_than_its_file_is_refused_before_memory_is_asked_for(series):
    pixels = b"\xe0\x7f\x10\x00"
    data = (series / "2.dcm").read_bytes()
    at = data.index(pixels) + len(pixels)  # implicit: no type between the element and its length
    (series / "2.dcm").write_bytes(data[:at] + struct.pack("<I", 0x7FFFFFF0) + data[at + 4 :])
    megabytes, reason = memory_asked_for(read_volume, series)
    assert megabytes < 200 and "2.dcm: its element (7fe0,0010) is longer than the file" in reason


def test_the_same_of_a_slice_with_types(tmp_path):
    pytest.importorskip("SimpleITK")
    syntax = struct.pack("<HH2sH", 2, 0x10, b"UI", 20) + b"1.2.840.10008.1.2.1\0"
    pixels = struct.pack("<HH2sHI", 0x7FE0, 0x10, b"OW", 0, 0x7FFFFFF0)
    (tmp_path / "0.dcm").write_bytes(bytes(128) + b"DICM" + syntax + pixels + bytes(60))
    with pytest.raises(UnreadableFile, match=r"\(7fe0,0010\) is longer than the file"):
        read_volume(tmp_path)


def element(group, number, kind, value):
    return struct.pack("<HH2sH", group, number, kind, len(value)) + value


SYNTAX = element(2, 0x10, b"UI", b"1.2.840.10008.1.2.1\0")
TYPED = struct.pack("<HH2sHI", 0x7FE0, 0x10, b"OW", 0, 0x7FFFFFF0)
OPEN = 0xFFFFFFFF  # a length that is not told
HEADS = {
    "an element of an unknown type": (element(2, 0x13, b"kH", b"GDCM 3.2.5") + SYNTAX, r"\(0002,0013\) is of no type"),
    "no meta information": (element(0x98, 0, b"UL", bytes(4)) + SYNTAX, "does not begin as"),
    "more behind zeros": (SYNTAX + bytes(8) + b"\0\0\0\0\x07\x10\xff\xda" + bytes(80), r"\(0000,0000\) is of no type"),
    "a sequence without end": (
        SYNTAX + struct.pack("<HH2sHI", 8, 0x1140, b"SQ", 0, OPEN) + struct.pack("<HHI", 0xFFFE, 0xE000, OPEN) + TYPED,
        r"\(7fe0,0010\) is longer",
    ),
    "an item that tells its length": (
        SYNTAX + struct.pack("<HH2sHI", 8, 0x1140, b"SQ", 0, 28) + struct.pack("<HHI", 0xFFFE, 0xE000, 20) + TYPED,
        r"\(7fe0,0010\) is longer",
    ),
    "packed pixels": (
        SYNTAX + TYPED[:8] + struct.pack("<IHHI", OPEN, 0xFFFE, 0xE000, 0x7FFFFFF0),
        r"\(fffe,e000\) is longer",
    ),
    "bytes the other way round": (
        element(2, 0x10, b"UI", b"1.2.840.10008.1.2.2\0") + struct.pack(">HH2sHI", 0x7FE0, 0x10, b"OW", 0, 0x7FFFFFF0),
        r"\(7fe0,0010\) is longer",
    ),
}


@pytest.mark.parametrize("what", HEADS)
def test_a_slice_on_which_the_library_would_ask_for_much_memory_is_refused(what, series):
    head, told = HEADS[what]
    (series / "1.dcm").write_bytes(bytes(128) + b"DICM" + head + bytes(60))
    megabytes, reason = memory_asked_for(read_volume, series)
    assert megabytes < 200 and re.search(told, reason)


def test_slices_of_different_size_are_no_volume(series):
    rows = struct.pack("<HHIH", 0x28, 0x10, 2, 5)
    changed(series / "2.dcm", rows, rows[:-2] + struct.pack("<H", 4))
    with pytest.raises(UnreadableFile, match=r"2.dcm differ in size"):
        read_volume(series)
