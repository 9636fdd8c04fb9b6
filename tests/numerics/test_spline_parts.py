import numpy as np
from scipy.interpolate import BSpline, CubicSpline

from recon.numerics.spline_parts import spline_part


def test_a_part_is_the_longer_spline_itself_between_its_ends():
    rng = np.random.default_rng(2)
    t, rows = np.cumsum(rng.uniform(0.2, 1.0, 20)), rng.normal(size=(20, 3))
    rows[-1] = rows[0]
    whole = CubicSpline(t, rows, bc_type="periodic")
    knots, control = spline_part(t[5:13], rows[5:13], whole(t[[5, 12]], 1))
    at = np.linspace(t[5], t[12], 101)
    np.testing.assert_allclose(BSpline(knots, control, 3)(at), whole(at), atol=1e-12)
    assert (control[[0, -1]] == rows[[5, 12]]).all()
