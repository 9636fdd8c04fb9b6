"""Read-only arrays of a known type and shape: what the neutral types are made of."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from recon.errors import BadGeometry

__all__ = ["frozen_floats", "frozen_ints"]


def frozen_floats(values: ArrayLike, shape: tuple[int | None, ...], what: str) -> NDArray[np.float64]:
    """Copy `values` into a locked float64 array of the given shape (None: any length).

    Raises  BadGeometry when the shape differs or a value is not finite, naming the first such row.
    """
    array = _copy(values, np.float64, shape, what)
    if not np.isfinite(array).all():
        row = int(np.argwhere(~np.isfinite(array))[0][0])
        raise BadGeometry(what, f"row {row} holds a value that is not a finite number")
    return array


def frozen_ints(values: ArrayLike, shape: tuple[int | None, ...], what: str) -> NDArray[np.int64]:
    """Copy `values` into a locked int64 array of the given shape (None: any length); raises BadGeometry."""
    return _copy(values, np.int64, shape, what)


def _copy(values: ArrayLike, dtype: Any, shape: tuple[int | None, ...], what: str) -> NDArray[Any]:
    try:
        array = np.array(values, dtype=dtype, order="C")
    except (TypeError, ValueError) as problem:
        raise BadGeometry(what, f"cannot be read as numbers ({problem})") from problem
    if array.size == 0 and len(shape) == 2 and shape[1] is not None:
        array = array.reshape(-1, shape[1])
    if array.ndim != len(shape) or any(want is not None and want != got for want, got in zip(shape, array.shape)):
        wanted = " x ".join("n" if n is None else str(n) for n in shape)
        raise BadGeometry(what, f"has shape {array.shape} where {wanted} is needed")
    array.setflags(write=False)
    return array
