"""What a file says about itself: name, author, unit."""

from dataclasses import dataclass
from enum import StrEnum

from recon.version import __version__

__all__ = ["FileHeader", "LengthUnit", "ORIGIN"]

ORIGIN = f"recon-brep {__version__}"


class LengthUnit(StrEnum):
    """The unit of the coordinates of a shape; the values are the words of STEP and IGES."""

    MILLIMETRE = "MM"
    METRE = "M"
    INCH = "INCH"

    @property
    def in_metres(self) -> float:
        return {"MM": 1e-3, "M": 1.0, "INCH": 0.0254}[self.value]


@dataclass(frozen=True)
class FileHeader:
    """Who made what, in which unit; coordinates are written as they are, the unit says what they mean."""

    name: str = "part"
    author: str = ""
    organisation: str = ""
    unit: LengthUnit = LengthUnit.MILLIMETRE
