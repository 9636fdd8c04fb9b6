"""Volumes: each format written here by hand, or by an independent writer, and read back with its place in space."""

import base64
import gzip
import pickle
import struct
import zlib

import numpy as np
import pytest

from recon.errors import BadGeometry, BadOption, UnreadableFile, UnsupportedFormat
from recon.geometry.voxel_grid import Volume, binary_grid, volume_labels
from recon.readers.volume_windows import open_volume, volume_shape
from recon.readers.volumes import read_volume

RNG = np.random.default_rng(7)
VALUES = RNG.integers(0, 200, (5, 4, 3)).astype(np.uint8)
SPACING, ORIGIN = np.array([0.5, 0.75, 2.0]), np.array([-3.0, 10.0, 0.25])
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
RAW = VALUES.tobytes(order="F")


def nrrd(path, encoding):
    axes = " ".join("(" + ",".join(map(str, v)) + ")" for v in (TURN * SPACING).T.tolist())
    head = (
        "NRRD0004\n# written by hand\ntype: unsigned char\ndimension: 3\nsizes: 5 4 3\n"
        f"space: left-posterior-superior\nspace directions: {axes}\nspace origin: (-3.0,10.0,0.25)\n"
        f"encoding: {encoding}\n"
    )
    body = {"raw": RAW, "gzip": gzip.compress(RAW), "ascii": " ".join(map(str, RAW)).encode()}[encoding]
    path.write_bytes(head.encode() + b"\n" + body)


def metaimage(path, compressed):
    turn = " ".join(map(str, TURN.T.ravel()))
    head = (
        f"ObjectType = Image\nNDims = 3\nBinaryDataByteOrderMSB = False\nCompressedData = {compressed}\n"
        f"TransformMatrix = {turn}\nOffset = -3.0 10.0 0.25\nElementSpacing = 0.5 0.75 2.0\nDimSize = 5 4 3\n"
        "ElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
    )
    path.write_bytes(head.encode() + (zlib.compress(RAW) if compressed else RAW))


def nifti(path, form):
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, 5, 4, 3, 1, 1, 1, 1)
    struct.pack_into("<2h", head, 70, 2, 8)
    struct.pack_into("<8f", head, 76, 1, 0.5, 0.75, 2.0, 0, 0, 0, 0)
    struct.pack_into("<f", head, 108, 352)
    if form == "s":
        struct.pack_into("<2h", head, 252, 0, 1)
        rows = np.column_stack([TURN * SPACING, ORIGIN])
        struct.pack_into("<12f", head, 280, *rows.ravel())
    else:
        struct.pack_into("<2h", head, 252, 1, 0)
        struct.pack_into("<6f", head, 256, 0, 0, np.sqrt(0.5), *ORIGIN)
    head[344:348] = b"n+1\0"
    path.write_bytes(gzip.compress(bytes(head) + RAW) if path.name.endswith(".gz") else bytes(head) + RAW)


def vti(path, form):
    head = 'type="UInt8" Name="v" NumberOfComponents="1"'
    sized = struct.pack("<I", len(RAW)) + RAW
    packed = zlib.compress(RAW)
    appended, compressor = b"", ""
    if form == "ascii":
        array = f'<DataArray {head} format="ascii">{" ".join(map(str, RAW))}</DataArray>'
    elif form == "base64":
        array = f'<DataArray {head} format="binary">{base64.b64encode(sized).decode()}</DataArray>'
    else:
        array = f'<DataArray {head} format="appended" offset="0"/>'
        compressor = ' compressor="vtkZLibDataCompressor"'
        block = struct.pack("<4I", 1, len(RAW), len(RAW), len(packed)) + packed
        appended = b'<AppendedData encoding="raw">_' + block + b"</AppendedData>"
    turn = " ".join(map(str, TURN.ravel()))
    text = (
        f'<VTKFile type="ImageData" byte_order="LittleEndian"{compressor}>'
        f'<ImageData WholeExtent="0 4 0 3 0 2" Origin="-3 10 0.25" Spacing="0.5 0.75 2" Direction="{turn}">'
        f'<Piece Extent="0 4 0 3 0 2"><PointData>{array}</PointData></Piece></ImageData>'
    )
    path.write_bytes(text.encode() + appended + b"</VTKFile>")


WRITERS = {
    "raw.nrrd": lambda p: nrrd(p, "raw"),
    "gzip.nrrd": lambda p: nrrd(p, "gzip"),
    "ascii.nrrd": lambda p: nrrd(p, "ascii"),
    "plain.mha": lambda p: metaimage(p, False),
    "packed.mha": lambda p: metaimage(p, True),
    "s.nii": lambda p: nifti(p, "s"),
    "q.nii.gz": lambda p: nifti(p, "q"),
    "ascii.vti": lambda p: vti(p, "ascii"),
    "base64.vti": lambda p: vti(p, "base64"),
    "appended.vti": lambda p: vti(p, "appended"),
    "all.npz": lambda p: np.savez(p, voxels=VALUES, spacing=SPACING, origin=ORIGIN, direction=TURN),
}


@pytest.mark.parametrize("name", WRITERS)
def test_values_and_place_come_back(tmp_path, name):
    path = tmp_path / name
    WRITERS[name](path)
    found = read_volume(path)
    assert (found.values == VALUES).all()
    assert found.spacing == pytest.approx(SPACING)
    assert found.origin == pytest.approx(ORIGIN)
    assert found.direction == pytest.approx(TURN, abs=1e-6)


def tiff(path):
    from PIL import Image

    pages = [Image.fromarray(VALUES[:, :, k].T.copy()) for k in range(VALUES.shape[2])]
    pages[0].save(path, save_all=True, append_images=pages[1:])


WINDOWED = {
    **WRITERS,
    "rows.npy": lambda p: np.save(p, VALUES),
    "columns.npy": lambda p: np.save(p, np.asfortranarray(VALUES)),
    "stack.tif": tiff,
}


@pytest.mark.parametrize("name", WINDOWED)
def test_a_window_holds_what_the_whole_has_there(tmp_path, name):
    path = tmp_path / name
    WINDOWED[name](path)
    source, whole = open_volume(path), read_volume(path)
    window = (slice(1, 4), slice(0, 3), slice(1, 3))
    assert (source.read(window) == whole.values[window]).all()
    assert source.shape == whole.values.shape
    assert source.origin == pytest.approx(whole.origin) and source.spacing == pytest.approx(whole.spacing)
    alone = {"raw.nrrd", "plain.mha", "s.nii", "rows.npy", "columns.npy", "stack.tif"}
    assert source.is_windowed == (name in alone)
    assert volume_shape(path) in (whole.values.shape, None)
    if source.is_windowed:  # it may travel to another process
        assert (pickle.loads(pickle.dumps(source)).read(window) == whole.values[window]).all()
        assert (open_volume(path, spacing=np.full(3, 2.0)).spacing == 2.0).all()


@pytest.mark.parametrize("name", ["raw.nrrd", "plain.mha", "s.nii", "rows.npy"])
def test_a_file_that_ends_early_is_refused_before_a_window_is_read(tmp_path, name):
    path = tmp_path / name
    WINDOWED[name](path)
    for data, says in ((path.read_bytes()[:-7], name), (b"", "is empty")):
        path.write_bytes(data)
        with pytest.raises(UnreadableFile, match=says):
            open_volume(path)


@pytest.mark.parametrize("ending", [".nrrd", ".mha", ".nii.gz", ".vti"])
def test_files_of_an_independent_writer_are_read_the_same(tmp_path, ending):
    if ending == ".vti":
        pyvista = pytest.importorskip("pyvista")
        image = pyvista.ImageData(dimensions=VALUES.shape, spacing=SPACING, origin=ORIGIN)
        image.point_data["v"] = VALUES.ravel(order="F")
        image.save(tmp_path / "one.vti")
        turn = np.eye(3)
    else:
        sitk = pytest.importorskip("SimpleITK")
        image = sitk.GetImageFromArray(VALUES.transpose(2, 1, 0))
        image.SetSpacing(SPACING.tolist())
        image.SetOrigin(ORIGIN.tolist())
        image.SetDirection(TURN.ravel().tolist())
        sitk.WriteImage(image, str(tmp_path / f"one{ending}"), True)
        turn = TURN
    found = read_volume(tmp_path / f"one{ending}")
    # NIfTI counts towards right and front where the others count towards left and back
    flip = np.diag([-1.0, -1.0, 1.0]) if ending == ".nii.gz" else np.eye(3)
    assert (found.values == VALUES).all()
    assert found.spacing == pytest.approx(SPACING)
    assert found.origin == pytest.approx(flip @ ORIGIN)
    assert found.direction == pytest.approx(flip @ turn, abs=1e-6)


def test_a_dicom_series_is_read_as_a_folder(tmp_path):
    sitk = pytest.importorskip("SimpleITK")
    image = sitk.GetImageFromArray(VALUES.astype(np.int16).transpose(2, 1, 0))
    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    for k in range(3):
        page = image[:, :, k]
        page.SetSpacing([0.5, 0.75])
        for key, value in (
            ("0020|000e", "1.2.3.4"),
            ("0020|0032", f"-3\\10\\{0.25 + 2.0 * k}"),
            ("0020|0037", "1\\0\\0\\0\\1\\0"),
            ("0020|0013", str(k)),
            ("0008|0018", f"1.2.3.4.{k + 1}"),
        ):
            page.SetMetaData(key, value)
        writer.SetFileName(str(tmp_path / f"{k}.dcm"))
        writer.Execute(page)
    found = read_volume(tmp_path)
    assert (found.values == VALUES).all()
    assert found.spacing == pytest.approx(SPACING)
    assert found.origin == pytest.approx(ORIGIN)


def test_a_tiff_stack_and_a_binvox_file_are_read(tmp_path):
    from PIL import Image

    pages = [Image.fromarray(VALUES[:, :, k].T) for k in range(3)]
    pages[0].save(tmp_path / "stack.tif", save_all=True, append_images=pages[1:])
    assert (read_volume(tmp_path / "stack.tif").values == VALUES).all()
    solid = RNG.random((4, 4, 4)) < 0.5
    flat = solid.transpose(0, 2, 1).ravel()
    runs = b"".join(bytes([int(v), 1]) for v in flat)
    head = b"#binvox 1\ndim 4 4 4\ntranslate -1 2 3\nscale 8\ndata\n"
    (tmp_path / "one.binvox").write_bytes(head + runs)
    found = read_volume(tmp_path / "one.binvox")
    assert (found.values.astype(bool) == solid).all()
    assert found.spacing.tolist() == [2.0, 2.0, 2.0]
    assert found.origin.tolist() == [0.0, 3.0, 4.0]


@pytest.mark.parametrize("name", [n for n in WRITERS if not n.startswith("ascii")])
def test_a_truncated_file_is_told_of_in_a_sentence(tmp_path, name):
    path = tmp_path / name
    WRITERS[name](path)
    path.write_bytes(path.read_bytes()[: -len(path.read_bytes()) // 4])
    with pytest.raises(UnreadableFile):
        read_volume(path)


def test_wrong_inputs_are_refused(tmp_path):
    np.save(tmp_path / "flat.npy", np.zeros((3, 3)))
    with pytest.raises(BadGeometry, match="three axes"):
        read_volume(tmp_path / "flat.npy")
    with pytest.raises(UnsupportedFormat):
        read_volume(tmp_path / "part.step")
    np.save(tmp_path / "grid.npy", VALUES)
    with pytest.raises(BadOption, match="positive"):
        read_volume(tmp_path / "grid.npy", spacing=np.array([1.0, 0.0, 1.0]))
    assert read_volume(tmp_path / "grid.npy", spacing=np.array([1.0, 2.0, 3.0])).spacing.tolist() == [1, 2, 3]


def test_which_voxels_are_solid():
    volume = Volume(values=VALUES)
    assert (binary_grid(volume, threshold=100).solid == (VALUES >= 100)).all()
    label = int(volume_labels(volume)[0])
    assert (binary_grid(volume, label=label).solid == (label == VALUES)).all()
    assert (binary_grid(Volume(values=np.where(VALUES > 90, 255, 0))).solid == (VALUES > 90)).all()
    with pytest.raises(BadOption, match="not binary"):
        binary_grid(volume)
    with pytest.raises(BadOption, match="label"):
        binary_grid(volume, label=250)
    with pytest.raises(BadOption, match="not both"):
        binary_grid(volume, label=1, threshold=1)
    with pytest.raises(BadGeometry, match="no voxel is solid"):
        binary_grid(volume, threshold=1000)


@pytest.mark.parametrize("ending", [".npz", ".npy"])
def test_other_content_under_numpys_names_is_refused_without_its_advice(ending, tmp_path):
    file = tmp_path / f"grid{ending}"
    file.write_text("not an array\n", encoding="utf-8")
    with pytest.raises(UnreadableFile, match=rf"is no {ending} a") as refused:
        read_volume(file)
    assert "unsafe" not in str(refused.value)
