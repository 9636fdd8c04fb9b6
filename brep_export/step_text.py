"""The text of STEP files that are written from arrays: entities in a row, coordinates, and what makes them a part."""

import datetime
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from re import sub
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from brep_export.file_header import ORIGIN, FileHeader, LengthUnit
from brep_export.measures import ShapeMeasures

__all__ = ["UNITS", "StepText", "add_product", "directions", "number_list", "quoted", "real"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

UNITS = {
    LengthUnit.MILLIMETRE: "( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) )",
    LengthUnit.METRE: "( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT($,.METRE.) )",
}


def quoted(words: str) -> str:
    """Text between quotation marks; letters beyond ASCII by their numbers, as ISO 10303-21 wants them."""
    text = words.replace("\\", "\\\\").replace("'", "''")
    return sub(r"[^\x20-\x7e]+", lambda found: _by_number(found[0]), text)


def _by_number(letters: str) -> str:
    wide = max(map(ord, letters)) > 0xFFFF
    code = letters.encode("utf-32-be" if wide else "utf-16-be").hex().upper()
    return f"\\X{4 if wide else 2}\\{code}\\X0\\"


def real(value: float) -> str:
    """A number as STEP spells it: with a point, and a capital E."""
    mantissa, _, exponent = repr(float(value)).partition("e")
    return (mantissa if "." in mantissa else mantissa + ".") + ("E" + exponent if exponent else "")


class StepText:
    """Entities in the order of their numbers, on their way into a file: the text of a part is never held whole."""

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self._count = 0

    @classmethod
    @contextmanager
    def into(cls, path: str | Path, header: FileHeader) -> Iterator["StepText"]:
        """A file of AP214 that is complete when the block ends well."""
        stamp = datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%dT%H:%M:%S")
        name, author, organisation = (quoted(word) for word in (header.name, header.author, header.organisation))
        with Path(path).open("w", encoding="ascii", errors="replace", newline="\n") as file:
            file.write(
                "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\n"
                f"FILE_NAME('{name}','{stamp}',('{author}'),('{organisation}'),'{ORIGIN}','{ORIGIN}','');\n"
                "FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));\nENDSEC;\nDATA;\n"
            )
            yield cls(file)
            file.write("ENDSEC;\nEND-ISO-10303-21;\n")

    def add(self, entity: str) -> int:
        return int(self.add_all([entity])[0])

    def add_all(self, entities: Iterable[str]) -> Ints:
        """Numbers of many entities in a row."""
        first = self._count + 1
        for entity in entities:
            self._count += 1
            self._file.write(f"#{self._count}={entity};\n")
        return np.arange(first, self._count + 1)

    def add_points(self, points: Floats, decimals: int) -> Ints:
        """Numbers of the CARTESIAN_POINTs at (n, d) places."""
        form = "CARTESIAN_POINT('',(" + ",".join([f"%.{decimals}f"] * points.shape[1]) + "))"
        return self.add_all(form % tuple(row) for row in points.tolist())


def directions(text: StepText, ways: Floats, decimals: int = 12) -> Ints:
    """Numbers of the DIRECTIONs along (n, d) unit vectors."""
    rows = (",".join(f"{x:.{decimals}f}" for x in way) for way in ways.tolist())
    return text.add_all(f"DIRECTION('',({row}))" for row in rows)


def number_list(numbers: Ints | list[int]) -> str:
    return "(#" + ",#".join(map(str, np.asarray(numbers).tolist())) + ")"


def add_product(
    text: StepText,
    bodies: list[int],
    header: FileHeader,
    *,
    kind: str = "ADVANCED_BREP",
    measures: ShapeMeasures | None = None,
    accuracy: float = 1e-7,
) -> None:
    """What says that the bodies are a part, in which unit, and how large it is.

    kind      ADVANCED_BREP for solids, MANIFOLD_SURFACE for shells
    measures  by which a reader can tell that it read the part well
    accuracy  length within which edges and vertices lie on what they join
    """
    add, name = text.add, quoted(header.name)
    length = add(UNITS[header.unit])
    angle = add("( NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.) )")
    solid_angle = add("( NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT() )")
    sure = add(
        f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE({real(accuracy)}),#{length},'distance_accuracy_value','')"
    )
    world = add(
        f"( GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#{sure})) "
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT((#{length},#{angle},#{solid_angle})) REPRESENTATION_CONTEXT('','') )"
    )
    origin = add("CARTESIAN_POINT('',(0.,0.,0.))")
    z, x = add("DIRECTION('',(0.,0.,1.))"), add("DIRECTION('',(1.,0.,0.))")
    frame = add(f"AXIS2_PLACEMENT_3D('',#{origin},#{z},#{x})")
    shape = add(f"{kind}_SHAPE_REPRESENTATION('{name}',{number_list([frame, *bodies])},#{world})")
    context = add("APPLICATION_CONTEXT('core data for automotive mechanical design processes')")
    add(f"APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,#{context})")
    usage = add(f"PRODUCT_CONTEXT('',#{context},'mechanical')")
    product = add(f"PRODUCT('{name}','{name}','',(#{usage}))")
    add(f"PRODUCT_RELATED_PRODUCT_CATEGORY('part',$,(#{product}))")
    formation = add(f"PRODUCT_DEFINITION_FORMATION('','',#{product})")
    stage = add(f"PRODUCT_DEFINITION_CONTEXT('part definition',#{context},'design')")
    definition = add(f"PRODUCT_DEFINITION('design','',#{formation},#{stage})")
    what = add(f"PRODUCT_DEFINITION_SHAPE('','',#{definition})")
    add(f"SHAPE_DEFINITION_REPRESENTATION(#{what},#{shape})")
    if measures is not None:
        aspect = add(f"SHAPE_ASPECT('','',#{what},.F.)")
        _add_properties(text, measures, (aspect, world, length))


def _add_properties(text: StepText, measures: ShapeMeasures, about: tuple[int, int, int]) -> None:
    """The geometric validation properties of a shape aspect.

    about  numbers of the aspect, of the representation context and of the unit of length
    """
    aspect, world, length = about
    figures = [("surface area", "AREA", measures.area, 2), ("volume", "VOLUME", measures.volume, 3)]
    items = []
    for name, kind, value, power in figures:
        if value is not None:
            element = text.add(f"DERIVED_UNIT_ELEMENT(#{length},{power}.)")
            unit = text.add(f"DERIVED_UNIT((#{element}))")
            measure = f"{kind}_MEASURE({real(value)})"
            items.append((name, text.add(f"MEASURE_REPRESENTATION_ITEM('{name} measure',{measure},#{unit})")))
    centre = ",".join(map(real, measures.centroid))
    items.append(("centroid", text.add(f"CARTESIAN_POINT('centre point',({centre}))")))
    for name, item in items:
        held = text.add(f"REPRESENTATION('{name}',(#{item}),#{world})")
        told = text.add(f"PROPERTY_DEFINITION('geometric validation property','{name}',#{aspect})")
        text.add(f"PROPERTY_DEFINITION_REPRESENTATION(#{told},#{held})")
