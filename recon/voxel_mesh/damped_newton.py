"""Newton's method for something with free numbers, each step halved until it helps enough."""

from typing import Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["Movable", "damped_newton"]

Floats = NDArray[np.float64]

ENOUGH = 0.97  # a step that leaves more than this of the sum is the last
SIZES = (1.0, 0.5, 0.25)  # of a step, tried one after the other


class Movable(Protocol):
    """A guess of the numbers."""

    @property
    def badness(self) -> float:
        """The sum of squares that is to be small."""
        ...

    def step(self) -> Floats:
        """What the numbers want to grow by, as far as the sum is quadratic in them."""
        ...

    def moved(self, step: Floats) -> Self:
        """The guess with its numbers grown by so much."""
        ...


Guess = TypeVar("Guess", bound=Movable)


def damped_newton(guess: Guess, *, steps: int) -> Guess:
    """The guess after at most so many steps, fewer where even a quarter of one leaves nearly the whole sum."""
    for _ in range(steps):
        step = guess.step()
        for size in SIZES:
            there = guess.moved(size * step)
            if there.badness < ENOUGH * guess.badness:
                break
        else:
            break
        guess = there
    return guess
