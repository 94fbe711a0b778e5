"""A URDF as a document: its elements with their lines, and the numbers in them."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

import numpy as np
from jaxtyping import Float

from identify.model.files import InputError, Mistake, read_text
from identify.model.frames import transform

METRE = 1000.0  # [mm]
LONGEST = 30.0  # [m], a longer offset or stroke was meant in millimetres


@dataclass
class Urdf:
    """A URDF being read: its elements, the line each begins in, and the mistakes found so far."""

    file: str
    root: ET.Element
    lines: dict[ET.Element, int]
    mistakes: list[Mistake] = field(default_factory=list)

    def wrong(self, element: ET.Element | None, text: str) -> None:
        """Note a mistake at an element, or of the whole file."""
        self.mistakes.append(Mistake(self.file, 0 if element is None else self.lines[element], text))

    def fail(self, element: ET.Element | None, text: str) -> NoReturn:
        """Raise what was found, this last."""
        self.wrong(element, text)
        raise InputError(self.mistakes)

    def vector(self, element: ET.Element | None, key: str, default: list[float], what: str) -> np.ndarray:
        """An attribute of as many finite numbers as its default has."""
        text = None if element is None else element.get(key)
        if element is None or text is None:
            return np.array(default)
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            values = np.array([])
        if values.size != len(default) or not np.isfinite(values).all():
            cure = "; run xacro first" if "${" in text else ""
            kind = "a number" if len(default) == 1 else f"{len(default)} numbers"
            self.wrong(element, f"{what}: {key} is {text!r}, expected {kind}{cure}")
            return np.array(default)
        return values


def parsed(path: Path) -> Urdf:
    """The elements of a file with their lines, which ElementTree's own parser does not keep."""
    parser, builder, lines = expat.ParserCreate(), ET.TreeBuilder(), dict[ET.Element, int]()

    def start(tag: str, attributes: dict[str, str]) -> None:
        lines[builder.start(tag, attributes)] = parser.CurrentLineNumber

    parser.StartElementHandler, parser.EndElementHandler = start, builder.end
    try:
        parser.Parse(read_text(path), True)
    except expat.ExpatError as error:
        cause = expat.ErrorString(error.code)
        raise InputError([Mistake(str(path), error.lineno, f"not well-formed XML: {cause}")]) from None
    urdf = Urdf(str(path), builder.close(), lines)
    if urdf.root.tag != "robot":
        urdf.fail(urdf.root, f"the outermost element is <{urdf.root.tag}>, expected <robot>: is this a URDF?")
    return urdf


def end(element: ET.Element, which: str) -> str:
    """The link at one end of a joint."""
    child = element.find(which)
    return "" if child is None else child.get("link", "")


def origin(urdf: Urdf, element: ET.Element, name: str) -> Float[np.ndarray, "4 4"]:
    """Where an element stands on its link: Trans(xyz) Rz(yaw) Ry(pitch) Rx(roll) [mm]."""
    place = element.find("origin")
    xyz = urdf.vector(place, "xyz", [0.0, 0.0, 0.0], name)
    rpy = urdf.vector(place, "rpy", [0.0, 0.0, 0.0], name)
    if place is not None and np.abs(xyz).max() > LONGEST:
        urdf.wrong(place, f"{name}: an offset of {np.abs(xyz).max():g} m: millimetres? a URDF is in metres")
    if place is not None and np.abs(rpy).max() > 7:
        urdf.wrong(place, f"{name}: rpy is {np.abs(rpy).max():g} rad: degrees? a URDF is in radians")
    return transform(np.concatenate([xyz * METRE, rpy[::-1]]))
