"""The three tolerances of the project, always passed, never global."""

from dataclasses import dataclass
from math import radians

from recon.errors import BadOption

__all__ = ["Tolerance"]


@dataclass(frozen=True)
class Tolerance:
    """How near is near enough, in the model's own units.

    merge   length: two points that lie closer are one
    fit     length: how far a surface may stay from what it was fitted to, and a kernel edge from its faces
    angle   radians: how far two tangent planes may differ along an edge that is said to be smooth
    Raises  BadOption when one of them is not positive.
    """

    merge: float = 1e-6
    fit: float = 0.05
    angle: float = radians(0.1)

    def __post_init__(self) -> None:
        for name in ("merge", "fit", "angle"):
            if not getattr(self, name) > 0.0:
                raise BadOption(f"tolerance {name}", f"must be positive, not {getattr(self, name)}")
