"""Volumes drawn by chance, written by other programs, come back as their formats promise."""

import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from recon.errors import UnreadableFile
from recon.readers.volume_windows import open_volume
from recon.readers.volumes import read_volume

few = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
LENGTHS = st.floats(-1e3, 1e3)
STEPS = st.floats(0.01, 100)
TYPES = ["uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64"]


@st.composite
def values(draw, types, least=1):
    shape = draw(st.tuples(st.integers(least, 5), st.integers(least, 5), st.integers(1, 4)))
    kind = np.dtype(draw(st.sampled_from(types)))
    return draw(arrays(kind, shape, elements={"allow_nan": False} if kind.kind == "f" else None))


@st.composite
def places(draw):
    """Spacing, origin, and right-handed axes at right angles."""
    axes = np.linalg.qr(draw(arrays(np.float64, (3, 3), elements=st.floats(-1, 1))) + 2 * np.eye(3))[0]
    return (
        np.array(draw(st.tuples(STEPS, STEPS, STEPS))),
        np.array(draw(st.tuples(LENGTHS, LENGTHS, LENGTHS))),
        axes * np.linalg.det(axes),
    )


def assert_at(found, place, flip=(1, 1, 1)):
    spacing, origin, axes = place
    np.testing.assert_allclose(found.spacing, spacing, rtol=1e-6)
    np.testing.assert_allclose(found.origin, origin * flip, rtol=1e-6, atol=1e-4)
    np.testing.assert_allclose(found.direction, axes * np.array(flip)[:, None], atol=1e-5)


@pytest.mark.parametrize("ending", [".nrrd", ".mha", ".nii", ".nii.gz"])
@few
@given(content=values(TYPES), place=places(), packed=st.booleans())
def test_values_and_place_come_back_from_files_of_an_image_library(ending, tmp_path, content, place, packed):
    sitk = pytest.importorskip("SimpleITK")
    image = sitk.GetImageFromArray(content.transpose(2, 1, 0).copy())
    image.SetSpacing(place[0].tolist())
    image.SetOrigin(place[1].tolist())
    image.SetDirection(place[2].ravel().tolist())
    sitk.WriteImage(image, str(tmp_path / f"volume{ending}"), packed)
    found = read_volume(tmp_path / f"volume{ending}")
    np.testing.assert_array_equal(found.values, content)
    # NIfTI counts towards right and front where the others count towards left and back
    assert_at(found, place, (-1, -1, 1) if ending.startswith(".nii") else (1, 1, 1))


@few
@given(content=values(TYPES, least=2), place=places(), at_points=st.booleans(), binary=st.booleans())
def test_values_and_place_come_back_from_vti(tmp_path, content, place, at_points, binary):
    import pyvista

    spacing, origin, axes = place
    size = np.array(content.shape) + (0 if at_points else 1)
    image = pyvista.ImageData(dimensions=size, spacing=spacing, origin=origin)
    image.direction_matrix = axes
    (image.point_data if at_points else image.cell_data)["v"] = content.ravel(order="F")
    image.save(tmp_path / "volume.vti", binary=binary)
    found = read_volume(tmp_path / "volume.vti")
    np.testing.assert_array_equal(found.values, content)
    assert_at(found, (spacing, origin if at_points else origin + axes @ spacing / 2, axes))


@few
@given(content=values([*TYPES, "bool", "int64"]), place=places(), told=st.booleans())
def test_values_and_place_come_back_from_npz(tmp_path, content, place, told):
    more = dict(zip(("spacing", "origin", "direction"), place)) if told else {}
    np.savez_compressed(tmp_path / "volume.npz", voxels=content, note=np.zeros(3), **more)
    found = read_volume(tmp_path / "volume.npz")
    np.testing.assert_array_equal(found.values, content)
    assert_at(found, place if told else (np.ones(3), np.zeros(3), np.eye(3)))


@few
@given(
    content=arrays(bool, st.tuples(*[st.integers(1, 6)] * 3)),
    size=st.floats(0.1, 1e3),
    corner=st.tuples(*[LENGTHS] * 3),
)
def test_voxels_come_back_from_binvox(tmp_path, content, size, corner):
    flat, flat_shape = content.transpose(0, 2, 1).ravel(), content.transpose(0, 2, 1).shape
    starts = np.flatnonzero(np.r_[True, flat[1:] != flat[:-1]])
    runs = b"".join(bytes([int(flat[a]), b - a]) for a, b in zip(starts, [*starts[1:], len(flat)]))
    head = "#binvox 1\ndim {} {} {}\ntranslate {!r} {!r} {!r}\nscale {!r}\ndata\n".format(*flat_shape, *corner, size)
    (tmp_path / "volume.binvox").write_bytes(head.encode() + runs)
    found = read_volume(tmp_path / "volume.binvox")
    np.testing.assert_array_equal(found.values.astype(bool), content)
    step = size / max(content.shape)
    assert_at(found, (np.full(3, step), np.array(corner) + step / 2, np.eye(3)))


def tiff(content, *, order, tiled_by):
    """A TIFF of one page a slice by hand, its rows in strips of so many."""
    nx, ny, nz = content.shape
    data, pages = b"", []
    kind = {"u": 1, "b": 1, "i": 2, "f": 3}[content.dtype.kind]
    for k in range(nz):
        rows = content[:, :, k].T.astype(content.dtype.newbyteorder(order))
        starts, counts = [], []
        for first in range(0, ny, tiled_by):
            strip = rows[first : first + tiled_by].tobytes()
            starts.append(8 + len(data))
            counts.append(len(strip))
            data += strip + bytes(len(strip) % 2)
        pages.append((starts, counts))
    made = bytearray(struct.pack(order + "2sHI", b"II" if order == "<" else b"MM", 42, 8 + len(data)) + data)
    for k, (starts, counts) in enumerate(pages):
        tags = {256: nx, 257: ny, 258: 8 * content.dtype.itemsize, 259: 1, 262: 1, 273: starts, 277: 1, 278: tiled_by}
        tags |= {279: counts, 339: kind}
        more, at = b"", len(made) + 2 + 12 * len(tags) + 4
        entries = b""
        for tag, value in tags.items():
            numbers = value if isinstance(value, list) else [value]
            packed = struct.pack(f"{order}{len(numbers)}I", *numbers)
            if len(packed) > 4:
                packed, more = struct.pack(order + "I", at + len(more)), more + packed
            entries += struct.pack(order + "HHI", tag, 4, len(numbers)) + packed
        follows = 0 if k == nz - 1 else at + len(more)
        made += struct.pack(order + "H", len(tags)) + entries + struct.pack(order + "I", follows) + more
    return bytes(made)


@pytest.mark.parametrize("order", "<>")
@few
@given(content=values(TYPES), tiled_by=st.integers(1, 6))
def test_slices_of_every_type_come_back_from_a_tiff_stack_or_are_refused(order, tmp_path, content, tiled_by):
    (path := tmp_path / "stack.tif").write_bytes(tiff(content, order=order, tiled_by=tiled_by))
    try:
        found = read_volume(path).values
    except UnreadableFile:
        assert content.dtype.name in ("float64", "uint32")
        return
    np.testing.assert_array_equal(found, content)
    source = open_volume(path)
    np.testing.assert_array_equal(source.read(tuple(slice(0, n) for n in content.shape)), content)


@few
@given(
    content=values(["uint8", "uint16", "int32", "float32"]),
    packing=st.sampled_from(["raw", "tiff_lzw", "tiff_deflate"]),
)
def test_slices_come_back_from_a_packed_tiff_stack(tmp_path, content, packing):
    from PIL import Image

    first, *rest = (Image.fromarray(content[:, :, k].T.copy()) for k in range(content.shape[2]))
    first.save(tmp_path / "stack.tif", save_all=True, append_images=rest, compression=packing)
    np.testing.assert_array_equal(read_volume(tmp_path / "stack.tif").values, content)


def write_series(folder, content, place, order, *, shift=(0.0, 0.0, 0.0), rescale=None):
    """A file a slice, named in an order of its own; every slice `shift` further than its place."""
    sitk = pytest.importorskip("SimpleITK")
    (spacing, origin, axes), writer = place, sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    for file in folder.glob("*.dcm"):
        file.unlink()
    for name, k in enumerate(order):
        image = sitk.GetImageFromArray(content[:, :, k].T.copy())
        image.SetSpacing(spacing[:2].tolist())
        at = origin + k * (spacing[2] * axes[:, 2] + shift)
        told = {
            "0008|0018": f"1.2.3.4.{k + 1}",
            "0020|000e": "1.2.3.4",
            "0020|0013": str(name),
            "0020|0032": "\\".join(f"{x:.10f}" for x in at),
            "0020|0037": "\\".join(f"{x:.12f}" for x in axes.T[:2].ravel()),
        }
        if rescale:
            told |= {"0028|1053": str(rescale[0]), "0028|1052": str(rescale[1])}
        for key, value in told.items():
            image.SetMetaData(key, value)
        writer.SetFileName(str(folder / f"{name}.dcm"))
        writer.Execute(image)


@st.composite
def series(draw):
    content = draw(values(["uint8", "int16", "uint16"], least=2))
    return content, draw(places()), draw(st.permutations(range(content.shape[2])))


@few
@given(of=series())
def test_a_series_of_slices_in_any_order_comes_back(tmp_path, of):
    content, place, _ = of
    write_series(tmp_path, *of)
    found = read_volume(tmp_path)
    np.testing.assert_array_equal(found.values, content)
    if content.shape[2] == 1:
        place = (np.r_[place[0][:2], found.spacing[2]], *place[1:])  # one slice tells no distance
    assert_at(found, place)


def test_slices_that_are_shifted_sideways_are_no_volume_with_axes_at_right_angles(tmp_path):
    place = np.array([0.5, 0.75, 2.0]), np.zeros(3), np.eye(3)
    write_series(tmp_path, np.ones((4, 3, 3), np.int16), place, [0, 1, 2], shift=(0.0, 0.4, 0.0))
    with pytest.raises(UnreadableFile, match=r"0.dcm and 1.dcm are shifted sideways by 0.4 mm"):
        read_volume(tmp_path)


def test_slices_of_one_row_are_refused_since_the_library_takes_them_for_rows_of_one_slice(tmp_path):
    place = np.ones(3), np.zeros(3), np.eye(3)
    write_series(tmp_path, np.ones((3, 1, 2), np.int16), place, [0, 1])
    with pytest.raises(UnreadableFile, match="one row"):
        read_volume(tmp_path)


@pytest.mark.parametrize("kind", ["int8", "uint32"])
def test_whole_numbers_of_a_tiff_stack_keep_their_sign(kind, tmp_path):
    content = np.array([np.iinfo(kind).min, np.iinfo(kind).max, 3, 4], dtype=kind).reshape(2, 2, 1)
    (tmp_path / "stack.tif").write_bytes(tiff(content, order="<", tiled_by=2))
    np.testing.assert_array_equal(read_volume(tmp_path / "stack.tif").values, content)
