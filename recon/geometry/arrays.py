"""Read-only arrays of a known type and shape: what the neutral types are made of."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from recon.errors import BadGeometry

__all__ = ["frozen_bools", "frozen_floats", "frozen_ints", "plain_array", "whole_number"]

Shape = tuple[int | None, ...]

LARGEST = 1e100  # a length whose cube, a volume, is still a number


def frozen_floats(values: ArrayLike, shape: Shape, what: str, *, also: float | None = None) -> NDArray[np.float64]:
    """Copy `values` into a locked float64 array of the given shape (None: any length).

    also    a value that is not finite and may stand there all the same, as NaN where nothing is known
    Raises  BadGeometry for what are no numbers, when the shape differs, and naming the first row with a value that is
            not finite or larger than LARGEST.
    """
    array = _copy(values, np.float64, "iuf", shape, what)
    if array.size and not (array.min() >= -LARGEST and array.max() <= LARGEST):  # false where there is a NaN, too
        sound = np.abs(array) <= LARGEST
        if also is not None:
            sound |= np.isnan(array) if np.isnan(also) else array == also
        _require(sound, array, what)
    return array


def frozen_ints(values: ArrayLike, shape: Shape, what: str) -> NDArray[np.int64]:
    """Copy `values` into a locked int64 array of the given shape (None: any length).

    Raises  BadGeometry for what are no numbers, when the shape differs, and naming the first row with a value that is
            not a whole number, or one of more than 63 bits.
    """
    return _copy(values, np.int64, "biuf", shape, what)


def frozen_bools(values: ArrayLike, shape: Shape, what: str) -> NDArray[np.bool_]:
    """Copy `values`, which are truth values or ones and zeros, into a locked array of the given shape.

    Raises  BadGeometry as `frozen_ints`, and for a number that is neither 0 nor 1.
    """
    return _copy(values, np.bool_, "biuf", shape, what)


def whole_number(value: object, what: str, *, least: int) -> int:
    """A single whole number; raises BadGeometry when it is none, or below `least`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise BadGeometry(what, f"is a {type(value).__name__} where a whole number is needed")
    if value < least:
        raise BadGeometry(what, f"{value} is below {least}")
    return int(value)


def plain_array(values: ArrayLike, what: str) -> NDArray[Any]:
    """The values as an array, of whatever type they are; raises BadGeometry for rows of different length and masks."""
    if np.ma.is_masked(values):
        raise BadGeometry(what, "holds masked values, and every one is needed")
    try:
        return np.asarray(values)
    except (TypeError, ValueError) as problem:
        raise BadGeometry(what, f"cannot be read as numbers ({problem})") from problem


def _copy(values: ArrayLike, dtype: Any, kinds: str, shape: Shape, what: str) -> NDArray[Any]:
    """A locked copy; `kinds` are numpy's letters for the types that can be taken for this one."""
    given = plain_array(values, what)
    if given.shape == (0,) and len(shape) > 1 and shape[0] is None:  # an empty list says nothing of its rows
        given = np.empty([n or 0 for n in shape], dtype=dtype)
    if given.dtype.kind not in kinds:
        raise BadGeometry(what, f"holds values of type {given.dtype} where numbers are needed")
    if given.ndim != len(shape) or any(want is not None and want != got for want, got in zip(shape, given.shape)):
        wanted = " x ".join("n" if n is None else str(n) for n in shape)
        raise BadGeometry(what, f"has shape {given.shape} where {wanted} is needed")
    with np.errstate(invalid="ignore", over="ignore"):
        array = np.array(given, dtype=dtype, order="C")
    if given.dtype != array.dtype and array.dtype != np.float64:
        _require(array == given, given, what)
    array.setflags(write=False)
    return array


def _require(sound: NDArray[np.bool_], values: NDArray[Any], what: str) -> None:
    """Raise BadGeometry naming the first place that is not sound."""
    wrong = np.argwhere(~sound)
    if not len(wrong):
        return
    place = tuple(wrong[0].tolist())
    row, value = f"row {place[0]} " if place else "", values[place]
    if not np.isfinite(value):
        raise BadGeometry(what, f"{row}holds a value that is not a finite number")
    raise BadGeometry(what, f"{row}holds {value:g}, which cannot stand there")
