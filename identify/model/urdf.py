"""From a URDF to a robot: the chain between two of its links, in the parameters of the model."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

import numpy as np
from jaxtyping import Float

from identify.model.axes import Axis, chain
from identify.model.files import InputError, Mistake, nearest, read_text
from identify.model.frames import inverse, transform
from identify.model.robot import Joint, Robot

METRE = 1000.0  # [mm]
LONGEST = 30.0  # [m], a longer offset or stroke was meant in millimetres
TURNS = 20 * np.pi  # [rad], a larger limit was meant in degrees
MOVES = ("revolute", "continuous", "prismatic")
SPEED = {"revolute": np.pi / 2, "continuous": np.pi / 2, "prismatic": 500.0}  # where the URDF states none, or zero


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


def read_urdf(path: Path, base: str, flange: str) -> Robot:
    """The robot between two links of a URDF; joints become j1, j2, ... and keep their zero and sign.

    Fixed joints are folded in. Consecutive axes within 5 degrees of parallel take Hayati's form (alpha, beta), others
    the common normal (beta = 0). Raises InputError with every mistake in the chain.
    """
    urdf = _parse(path)
    up, down = _path(urdf, base, flange)
    T, axes, joints = np.eye(4), list[Axis](), list[ET.Element]()
    for element in up:
        T = T @ inverse(_origin(urdf, element))
    for element in down:
        T = T @ _origin(urdf, element)
        if element.get("type") != "fixed":
            axes.append(Axis(T[:3, 3], T[:3, :3] @ _direction(urdf, element)))
            joints.append(element)
    ranges = [_range(urdf, element) for element in joints]
    if not joints and not urdf.mistakes:
        urdf.wrong(None, f"no joint moves between '{base}' and '{flange}'; name the first and last link of the arm")
    if urdf.mistakes:
        raise InputError(urdf.mistakes)
    found = chain(axes, T)
    return Robot(
        name=urdf.root.get("name") or path.stem,
        joints=tuple(
            Joint(f"j{i + 1}", element.get("type") == "prismatic", theta, d, a, alpha, beta, *limits)
            for i, (element, (theta, d, a, alpha, beta), limits) in enumerate(
                zip(joints, found.links.tolist(), ranges, strict=True)
            )
        ),
        source=f"{path.name}, from '{base}' to '{flange}'",
        base_T_first=found.base_T_first,
        last_T_flange=found.last_T_flange,
    )


def _parse(path: Path) -> Urdf:
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


def _path(urdf: Urdf, base: str, flange: str) -> tuple[list[ET.Element], list[ET.Element]]:
    """Fixed joints to climb from the base, then joints to descend to the flange."""
    above = _joints_above(urdf)
    links = {element.get("name", "") for element in urdf.root.iterfind("link")}
    links |= {link for child, (parent, _) in above.items() for link in (child, parent)}
    for role, name in (("base", base), ("flange", flange)):
        if name not in links:
            urdf.wrong(None, f"no link '{name}' for the {role}{nearest(name, links) or _listed(links)}")
    if urdf.mistakes:
        raise InputError(urdf.mistakes)
    up, down = _climb(urdf, above, base), _climb(urdf, above, flange)
    while up and down and up[-1] is down[-1]:
        up, down = up[:-1], down[:-1]
    top = {_end(climb[-1], "parent") if climb else name for climb, name in ((up, base), (down, flange))}
    if len(top) > 1:
        urdf.fail(None, f"no chain of joints joins '{base}' and '{flange}'")
    for element in up:
        if element.get("type") != "fixed":
            name = element.get("name", "")
            urdf.wrong(element, f"joint '{name}' moves base '{base}'; name a base before it, or swap base and flange")
    return up, down[::-1]


def _joints_above(urdf: Urdf) -> dict[str, tuple[str, ET.Element]]:
    """The parent link of every child link, and the joint between them."""
    above = dict[str, tuple[str, ET.Element]]()
    for element in urdf.root.iterfind("joint"):
        name, parent, child = element.get("name", ""), _end(element, "parent"), _end(element, "child")
        if not parent or not child:
            urdf.wrong(
                element, f'joint \'{name}\' does not join two links; write <parent link="..."/> <child link="..."/>'
            )
        elif child in above:
            urdf.wrong(
                element, f"link '{child}' hangs on joint '{name}' and on '{above[child][1].get('name', '')}'; keep one"
            )
        else:
            above[child] = (parent, element)
    return above


def _climb(urdf: Urdf, above: dict[str, tuple[str, ET.Element]], link: str) -> list[ET.Element]:
    """The joints above a link, up to the root."""
    found: list[ET.Element] = []
    while link in above:
        link, element = above[link]
        if element in found:
            urdf.fail(element, f"joint '{element.get('name', '')}' closes a loop; a chain has two ends")
        found.append(element)
    return found


def _end(element: ET.Element, which: str) -> str:
    found = element.find(which)
    return "" if found is None else found.get("link", "")


def _listed(links: set[str]) -> str:
    return f"; its links: {', '.join(sorted(links)[:20])}" if links else "; the file has no links"


def _origin(urdf: Urdf, joint: ET.Element) -> Float[np.ndarray, "4 4"]:
    """Where a joint stands on its parent link: Trans(xyz) Rz(yaw) Ry(pitch) Rx(roll) [mm]."""
    name, origin = f"joint '{joint.get('name', '')}'", joint.find("origin")
    xyz = urdf.vector(origin, "xyz", [0.0, 0.0, 0.0], name)
    rpy = urdf.vector(origin, "rpy", [0.0, 0.0, 0.0], name)
    if origin is not None and np.abs(xyz).max() > LONGEST:
        urdf.wrong(origin, f"{name}: an offset of {np.abs(xyz).max():g} m: millimetres? a URDF is in metres")
    if origin is not None and np.abs(rpy).max() > 7:
        urdf.wrong(origin, f"{name}: rpy is {np.abs(rpy).max():g} rad: degrees? a URDF is in radians")
    return transform(np.concatenate([xyz * METRE, rpy[::-1]]))


def _direction(urdf: Urdf, joint: ET.Element) -> Float[np.ndarray, " 3"]:
    """The unit axis of a joint in its own frame; x where none is written."""
    name, axis = f"joint '{joint.get('name', '')}'", joint.find("axis")
    direction = urdf.vector(axis, "xyz", [1.0, 0.0, 0.0], name)
    length = np.linalg.norm(direction)
    if length == 0:
        urdf.wrong(axis, f"{name}: the axis is zero; write a direction such as 0 0 1")
        return np.eye(3)[0]
    return direction / length


def _range(urdf: Urdf, joint: ET.Element) -> tuple[float, float, float]:
    """Lower limit, upper limit and speed of a moving joint [rad] or [mm]."""
    name, kind, limit = f"joint '{joint.get('name', '')}'", joint.get("type", ""), joint.find("limit")
    if kind not in MOVES:
        urdf.wrong(joint, f"{name} is {kind or 'of no type'}, expected fixed, {', '.join(MOVES)}")
        return 0.0, 0.0, 0.0
    if joint.find("mimic") is not None:
        urdf.wrong(joint, f"{name} mimics another; the chain needs joints that move on their own")
    unit = METRE if kind == "prismatic" else 1.0
    speed = urdf.vector(limit, "velocity", [0.0], name)[0] * unit or SPEED[kind]
    if kind == "continuous":
        return -2 * np.pi, 2 * np.pi, float(abs(speed))
    if limit is None:
        urdf.wrong(joint, f'{name} has no limits; write <limit lower="..." upper="..."/>')
        return 0.0, 0.0, 0.0
    before = len(urdf.mistakes)
    lower, upper = urdf.vector(limit, "lower", [0.0], name)[0], urdf.vector(limit, "upper", [0.0], name)[0]
    if lower >= upper and len(urdf.mistakes) == before:
        urdf.wrong(limit, f"{name}: limits run from {lower:g} to {upper:g}; write the smaller first")
    largest = max(abs(lower), abs(upper))
    if kind == "prismatic" and largest > LONGEST:
        urdf.wrong(limit, f"{name}: a stroke of {largest:g} m: millimetres? a URDF is in metres")
    if kind == "revolute" and largest > TURNS:
        urdf.wrong(limit, f"{name}: a limit of {largest:g} rad: degrees? a URDF is in radians")
    return float(lower * unit), float(upper * unit), float(abs(speed))
