"""Volumes from files: numpy arrays, NRRD, MetaImage, NIfTI, VTI, TIFF stacks, binvox, and DICOM series.

A file's coordinates are kept as it gives them: NIfTI counts towards the right, front and top of a patient, DICOM and
most NRRD files towards the left, back and top.  Formats without a spacing have voxels of one unit unless told.
"""

import math
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadOption, ReconError, UnreadableFile, UnsupportedFormat
from recon.geometry.voxel_grid import PlacedGrid, Volume
from recon.readers.content import file_bytes, require_plain_file
from recon.readers.dicom import read_dicom
from recon.readers.image_data import read_vti
from recon.readers.unpacking import require_plausible_size
from recon.readers.volume_headers import read_metaimage, read_nifti, read_nrrd

__all__ = ["VOLUME_ENDINGS", "page_numbers", "read_volume", "require_pages", "told_of", "volume_ending", "with_spacing"]

Floats = NDArray[np.float64]
BITS, SAMPLE_FORMAT = 258, 339  # tags of a TIFF file
Read = TypeVar("Read")
Placed = TypeVar("Placed", bound=PlacedGrid)


def read_volume(path: str | Path, *, spacing: Floats | None = None) -> Volume:
    """Volume of a file, or of a folder with one DICOM series.

    spacing  (3,) in model units, in place of what the file says
    Raises   UnreadableFile, UnsupportedFormat, BadGeometry, BadOption.
    """
    file = Path(path)
    if file.is_dir():
        return with_spacing(told_of(read_dicom, file), spacing)
    ending = volume_ending(file)
    require_plain_file(file)
    return with_spacing(told_of(_READERS[ending], file), spacing)


def with_spacing(volume: Placed, spacing: Floats | None) -> Placed:
    """The volume with another spacing (3,), where there is one; raises BadOption when it is none."""
    if spacing is None:
        return volume
    if len(spacing) != 3 or not (np.asarray(spacing) > 0).all():
        raise BadOption("--spacing", "needs one positive length, or three")
    return replace(volume, spacing=np.asarray(spacing, dtype=np.float64))


def volume_ending(file: Path) -> str:
    """The ending that names the format; raises UnsupportedFormat."""
    name = file.name.lower()
    ending = next((e for e in VOLUME_ENDINGS if name.endswith(e)), None)
    if ending is None:
        raise UnsupportedFormat(str(file), VOLUME_ENDINGS)
    return ending


def told_of(reader: Callable[[Path], Read], file: Path) -> Read:
    """What a reader makes of a file; what goes wrong is said of the file, as UnreadableFile."""
    try:
        return reader(file)
    except ReconError:
        raise
    except MemoryError:
        raise UnreadableFile(str(file), "claims to be larger than the memory") from None
    except Exception as problem:
        raise UnreadableFile(str(file), f"is damaged, or not what its name says ({problem})") from problem


def _npy(file: Path) -> Volume:
    # numpy takes a file of any other content for a pickle, and advises to load that unsafely
    if not file_bytes(file).startswith(b"\x93NUMPY"):
        raise UnreadableFile(str(file), "is no .npy array")
    return Volume(name=file.name, values=np.load(file, allow_pickle=False))


def _npz(file: Path) -> Volume:
    """Arrays `voxels` (or the only one of three axes), and `spacing`, `origin`, `direction` where they are there."""
    file_bytes(file)
    if not zipfile.is_zipfile(file):
        raise UnreadableFile(str(file), "is no .npz archive")
    with zipfile.ZipFile(file) as archive:
        require_plausible_size(str(file), file.stat().st_size, sum(part.file_size for part in archive.infolist()))
    content = np.load(file, allow_pickle=False)
    arrays = {key: content[key] for key in content.files}
    grids = [key for key, array in arrays.items() if array.ndim == 3]
    key = "voxels" if "voxels" in grids else grids[0] if len(grids) == 1 else None
    if key is None:
        names = ", ".join(arrays) or "nothing"
        raise UnreadableFile(str(file), f"holds {names}", "Name the grid's array `voxels`")
    places: dict[str, Any] = {
        k: np.broadcast_to(np.asarray(arrays[k], dtype=np.float64), shape)
        for k, shape in (("spacing", (3,)), ("origin", (3,)), ("direction", (3, 3)))
        if k in arrays
    }
    return Volume(**places, name=file.name, values=arrays[key])


def _tiff(file: Path) -> Volume:
    """Pages are slices along the third axis, columns run along the first."""
    from PIL import Image, ImageSequence

    file_bytes(file)
    with Image.open(file) as image:
        numbers = sum(math.prod(page.size) for page in ImageSequence.Iterator(image))
        require_plausible_size(str(file), file.stat().st_size, numbers)
        image.seek(0)
        pages = [page_numbers(page) for page in ImageSequence.Iterator(image)]
    require_pages(pages, file)
    return Volume(name=file.name, values=np.stack(pages, axis=2).transpose(1, 0, 2))


def page_numbers(page: Any) -> NDArray[Any]:
    """The numbers of a page of a TIFF file, whole ones with the sign that it says: the library knows one a length."""
    values = np.array(page)
    kind = {1: "u", 2: "i"}.get(page.tag_v2.get(SAMPLE_FORMAT, (1,))[0], "")
    is_whole = values.dtype.kind in "ui" and page.tag_v2.get(BITS, (1,))[0] == 8 * values.itemsize
    return values.view(values.dtype.str[0] + kind + values.dtype.str[2:]) if kind and is_whole else values


def require_pages(pages: Sequence[NDArray[Any]], file: Path) -> None:
    """Raises UnreadableFile for pages that are no slices of one volume."""
    if any(page.shape != pages[0].shape or page.ndim != 2 for page in pages):
        raise UnreadableFile(str(file), "its pages differ in size, or are in colour", "Save one grey image a slice")


def _binvox(file: Path) -> Volume:
    """Run lengths of zeros and ones, the second axis fastest, then the third; the longest side has length `scale`."""
    data = file_bytes(file)
    if not data.startswith(b"#binvox"):
        raise UnreadableFile(str(file), "is no binvox file")
    head, _, body = data.partition(b"data\n")
    words = {line.split()[0]: line.split()[1:] for line in head.decode("ascii").splitlines() if line.strip()}
    shape = [int(n) for n in words["dim"]]
    scale, shift = float(words.get("scale", ["1"])[0]), np.array(words.get("translate", [0, 0, 0]), dtype=np.float64)
    runs = np.frombuffer(body, dtype=np.uint8)
    runs = runs[: len(runs) // 2 * 2].reshape(-1, 2)
    if min(shape) < 1 or int(runs[:, 1].sum(dtype=np.int64)) != math.prod(shape):
        raise UnreadableFile(str(file), "its runs do not fill the grid", "Copy or export the file again")
    values = np.repeat(runs[:, 0], runs[:, 1]).reshape(shape).transpose(0, 2, 1)
    spacing = np.full(3, scale / max(shape))
    return Volume(spacing, shift + spacing / 2, np.eye(3), file.name, values)


_READERS: dict[str, Callable[[Path], Volume]] = {
    ".npz": _npz,
    ".npy": _npy,
    ".nrrd": read_nrrd,
    ".nhdr": read_nrrd,
    ".nii": read_nifti,
    ".nii.gz": read_nifti,
    ".mha": read_metaimage,
    ".mhd": read_metaimage,
    ".tif": _tiff,
    ".tiff": _tiff,
    ".binvox": _binvox,
    ".vti": read_vti,
}
VOLUME_ENDINGS = tuple(sorted(_READERS, key=len, reverse=True))
