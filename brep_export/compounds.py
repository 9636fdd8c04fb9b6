"""Shapes side by side in one kernel shape."""

from collections.abc import Iterable, Sequence
from typing import TypeVar

from OCP.BRep import BRep_Builder
from OCP.TopoDS import TopoDS_Compound, TopoDS_Shape

__all__ = ["compound_of", "one_or_compound"]

Shape = TypeVar("Shape", bound=TopoDS_Shape)


def compound_of(shapes: Iterable[TopoDS_Shape]) -> TopoDS_Compound:
    """A compound of the shapes, of none where there are none."""
    builder, compound = BRep_Builder(), TopoDS_Compound()
    builder.MakeCompound(compound)
    for shape in shapes:
        builder.Add(compound, shape)
    return compound


def one_or_compound(shapes: Sequence[Shape]) -> Shape | TopoDS_Compound:
    """The one shape itself, or a compound of several."""
    return shapes[0] if len(shapes) == 1 else compound_of(shapes)
