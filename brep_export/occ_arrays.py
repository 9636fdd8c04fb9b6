"""NumPy arrays to kernel arrays and back.

The kernel's array classes offer no buffer and change their names with its next major version: this module is the only
one that names them. Kernel arrays count from 1. About 1 microsecond a point, either way.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OCP.gp import gp_Pnt, gp_Pnt2d
from OCP.TColgp import TColgp_Array1OfPnt, TColgp_Array1OfPnt2d, TColgp_Array2OfPnt
from OCP.TColStd import (
    TColStd_Array1OfInteger,
    TColStd_Array1OfReal,
    TColStd_Array2OfReal,
    TColStd_SequenceOfAsciiString,
)

__all__ = [
    "points_to_kernel",
    "plane_points_to_kernel",
    "point_grid_to_kernel",
    "reals_to_kernel",
    "real_grid_to_kernel",
    "integers_to_kernel",
    "points_from_kernel",
    "point_grid_from_kernel",
    "numbers_from_kernel",
    "real_grid_from_kernel",
    "texts_from_kernel",
]

Floats = NDArray[np.float64]


def points_to_kernel(points: Floats) -> TColgp_Array1OfPnt:
    """Kernel row of the (n, 3) points."""
    return _row(TColgp_Array1OfPnt(1, len(points)), [gp_Pnt(x, y, z) for x, y, z in points.tolist()])


def plane_points_to_kernel(points: Floats) -> TColgp_Array1OfPnt2d:
    """Kernel row of the (n, 2) points."""
    return _row(TColgp_Array1OfPnt2d(1, len(points)), [gp_Pnt2d(x, y) for x, y in points.tolist()])


def reals_to_kernel(values: Floats) -> TColStd_Array1OfReal:
    """Kernel row of the (n,) numbers."""
    return _row(TColStd_Array1OfReal(1, len(values)), values.tolist())


def integers_to_kernel(values: NDArray[np.int64]) -> TColStd_Array1OfInteger:
    """Kernel row of the (n,) whole numbers."""
    return _row(TColStd_Array1OfInteger(1, len(values)), values.tolist())


def point_grid_to_kernel(points: Floats) -> TColgp_Array2OfPnt:
    """Kernel grid of the (nu, nv, 3) points."""
    rows, columns = points.shape[:2]
    return _grid(TColgp_Array2OfPnt(1, rows, 1, columns), [[gp_Pnt(*p) for p in row] for row in points.tolist()])


def real_grid_to_kernel(values: Floats) -> TColStd_Array2OfReal:
    """Kernel grid of the (nu, nv) numbers."""
    rows, columns = values.shape
    return _grid(TColStd_Array2OfReal(1, rows, 1, columns), values.tolist())


def points_from_kernel(array: TColgp_Array1OfPnt | TColgp_Array1OfPnt2d) -> Floats:
    """(n, 3) or (n, 2) points of a kernel row."""
    return np.array([array.Value(i).Coord() for i in range(array.Lower(), array.Upper() + 1)], dtype=np.float64)


def numbers_from_kernel(array: TColStd_Array1OfReal | TColStd_Array1OfInteger) -> NDArray[Any]:
    """(n,) numbers of a kernel row, whole if they were."""
    return np.array([array.Value(i) for i in range(array.Lower(), array.Upper() + 1)])


def point_grid_from_kernel(array: TColgp_Array2OfPnt) -> Floats:
    """(nu, nv, 3) points of a kernel grid."""
    columns = range(array.LowerCol(), array.UpperCol() + 1)
    rows = range(array.LowerRow(), array.UpperRow() + 1)
    return np.array([[array.Value(i, j).Coord() for j in columns] for i in rows], dtype=np.float64)


def real_grid_from_kernel(array: TColStd_Array2OfReal) -> Floats:
    """(nu, nv) numbers of a kernel grid."""
    columns = range(array.LowerCol(), array.UpperCol() + 1)
    rows = range(array.LowerRow(), array.UpperRow() + 1)
    return np.array([[array.Value(i, j) for j in columns] for i in rows], dtype=np.float64)


def texts_from_kernel(fill: Callable[..., Any], n_lists: int) -> list[list[str]]:
    """The lists of text that a kernel function fills, for functions that are handed `n_lists` of them."""
    lists = [TColStd_SequenceOfAsciiString() for _ in range(n_lists)]
    fill(*lists)
    return [[found.Value(i).ToCString() for i in range(1, found.Length() + 1)] for found in lists]


def _row(array: Any, values: list[Any]) -> Any:
    put = array.SetValue
    for i, value in enumerate(values, 1):
        put(i, value)
    return array


def _grid(array: Any, rows: list[list[Any]]) -> Any:
    put = array.SetValue
    for i, row in enumerate(rows, 1):
        for j, value in enumerate(row, 1):
            put(i, j, value)
    return array
