import numpy as np
import pytest
from numpy.testing import assert_array_equal

from brep_export import occ_arrays as arrays

RNG = np.random.default_rng(5)


@pytest.mark.parametrize(
    ("there", "back", "values"),
    [
        (arrays.points_to_kernel, arrays.points_from_kernel, RNG.normal(size=(7, 3))),
        (arrays.plane_points_to_kernel, arrays.points_from_kernel, RNG.normal(size=(7, 2))),
        (arrays.point_grid_to_kernel, arrays.point_grid_from_kernel, RNG.normal(size=(4, 5, 3))),
        (arrays.reals_to_kernel, arrays.numbers_from_kernel, RNG.normal(size=6)),
        (arrays.integers_to_kernel, arrays.numbers_from_kernel, np.array([4, 1, 2, 4])),
        (arrays.real_grid_to_kernel, arrays.real_grid_from_kernel, RNG.normal(size=(3, 8))),
    ],
    ids=["points", "plane points", "point grid", "reals", "integers", "real grid"],
)
def test_arrays_come_back_from_the_kernel_bit_for_bit(there, back, values):
    returned = back(there(values))
    assert_array_equal(returned, values)
    assert returned.dtype.kind == values.dtype.kind


def test_kernel_arrays_count_rows_and_columns_as_numpy_does():
    grid = RNG.normal(size=(2, 3, 3))
    assert arrays.point_grid_to_kernel(grid).Value(2, 3).Coord() == tuple(grid[1, 2])
