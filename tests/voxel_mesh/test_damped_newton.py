"""Newton's method with halved steps, on sums whose least value is known."""

from dataclasses import dataclass

import numpy as np
import pytest

from recon.voxel_mesh.damped_newton import damped_newton


@dataclass
class Arctan:
    """The root of arctan, from which Newton's whole steps run away when they begin farther off than 1.39."""

    x: float

    @property
    def badness(self):
        return float(np.arctan(self.x) ** 2)

    def step(self):
        return np.array([-np.arctan(self.x) * (1.0 + self.x**2)])

    def moved(self, step):
        return Arctan(self.x + float(step[0]))


@pytest.mark.parametrize("start", [0.5, -2.0, 3.0])
def test_halved_steps_come_to_a_root_that_whole_ones_run_away_from(start):
    assert abs(damped_newton(Arctan(start), steps=12).x) < 1e-6


def test_where_no_step_helps_the_guess_stays():
    far = Arctan(1e3)
    assert damped_newton(far, steps=12) is far
