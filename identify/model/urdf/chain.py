"""From a URDF to a robot: the chain between two of its links, in the parameters of the model."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identify.model.files import InputError, nearest
from identify.model.frames import inverse
from identify.model.joint import SLIDING, TURNING, Joint
from identify.model.robot import Robot
from identify.model.urdf.axes import Axis, chain
from identify.model.urdf.document import LONGEST, METRE, Urdf, end, origin, parsed
from identify.model.urdf.shapes import collision_shapes

TURNS = 20 * np.pi  # [rad], a larger limit was meant in degrees
MOVES = ("revolute", "continuous", "prismatic")
SPEED = {"revolute": TURNING, "continuous": TURNING, "prismatic": SLIDING}  # where the URDF states none, or zero


def read_urdf(path: Path, base: str, flange: str) -> Robot:
    """The robot between any two links of a URDF; joints keep their names, zeros, signs and limits.

    The chain climbs from the base to the link that both share and descends to the flange: a positioner that holds the
    jig, a track and an arm are one robot. Fixed joints are folded in. Consecutive axes within 5 degrees of parallel
    take Hayati's form (alpha, beta), others the common normal (beta = 0). Raises InputError with every mistake in the
    chain.
    """
    urdf = parsed(path)
    up, down = _path(urdf, base, flange)
    T, axes, joints = np.eye(4), list[Axis](), list[ET.Element]()
    for element in up:  # a joint that is climbed moves its parent, seen from its child, by the opposite
        if element.get("type") != "fixed":
            axes.append(Axis(T[:3, 3], -T[:3, :3] @ direction(urdf, element)))
            joints.append(element)
        T = T @ inverse(origin(urdf, element, _named(element)))
    for element in down:
        T = T @ origin(urdf, element, _named(element))
        if element.get("type") != "fixed":
            axes.append(Axis(T[:3, 3], T[:3, :3] @ direction(urdf, element)))
            joints.append(element)
    ranges = [_range(urdf, element) for element in joints]
    if not joints and not urdf.mistakes:
        urdf.wrong(None, f"no joint moves between '{base}' and '{flange}'; name the first and last link of the arm")
    if urdf.mistakes:
        raise InputError(urdf.mistakes)
    robot_joints, names = chain(axes, T), _joint_names(joints)
    shapes = collision_shapes(urdf, base, joints, robot_joints.frames)
    if urdf.mistakes:
        raise InputError(urdf.mistakes)
    return Robot(
        name=urdf.root.get("name") or path.stem,
        joints=tuple(
            Joint(names[i], element.get("type") == "prismatic", theta, d, a, alpha, beta, *limits)
            for i, (element, (theta, d, a, alpha, beta), limits) in enumerate(
                zip(joints, robot_joints.links.tolist(), ranges, strict=True)
            )
        ),
        source=f"{path.name}, from '{base}' to '{flange}'",
        base_T_first=robot_joints.base_T_first,
        last_T_flange=robot_joints.last_T_flange,
        shapes=shapes,
    )


def _joint_names(joints: Sequence[ET.Element]) -> list[str]:
    """The names in the URDF; j1, j2, ... for those that cannot name a parameter."""
    names = [element.get("name", "") for element in joints]
    usable = [name and "." not in name and name not in ("base", "tool") and names.count(name) == 1 for name in names]
    return [name if use else f"j{i + 1}" for i, (name, use) in enumerate(zip(names, usable, strict=True))]


def _named(joint: ET.Element) -> str:
    return f"joint '{joint.get('name', '')}'"


def _path(urdf: Urdf, base: str, flange: str) -> tuple[list[ET.Element], list[ET.Element]]:
    """Joints to climb from the base, then joints to descend to the flange."""
    above = joints_above(urdf)
    links = links_of(urdf, above)
    for role, name in (("base", base), ("flange", flange)):
        if name not in links:
            urdf.wrong(None, f"no link '{name}' for the {role}{nearest(name, links) or _listed(links)}")
    if urdf.mistakes:
        raise InputError(urdf.mistakes)
    up, down = _climb(urdf, above, base), _climb(urdf, above, flange)
    while up and down and up[-1] is down[-1]:
        up, down = up[:-1], down[:-1]
    top = {end(climb[-1], "parent") if climb else name for climb, name in ((up, base), (down, flange))}
    if len(top) > 1:
        urdf.fail(None, f"no chain of joints joins '{base}' and '{flange}'")
    return up, down[::-1]


def links_of(urdf: Urdf, above: Mapping[str, tuple[str, ET.Element]]) -> set[str]:
    """The names of all links, those that only joints name among them."""
    links = {element.get("name", "") for element in urdf.root.iterfind("link")}
    return links | {link for child, (parent, _) in above.items() for link in (child, parent)}


def joints_above(urdf: Urdf) -> dict[str, tuple[str, ET.Element]]:
    """The parent link of every child link, and the joint between them."""
    above = dict[str, tuple[str, ET.Element]]()
    for element in urdf.root.iterfind("joint"):
        name, parent, child = element.get("name", ""), end(element, "parent"), end(element, "child")
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
    elements: list[ET.Element] = []
    while link in above:
        link, element = above[link]
        if element in elements:
            urdf.fail(element, f"joint '{element.get('name', '')}' closes a loop; a chain has two ends")
        elements.append(element)
    return elements


def _listed(links: set[str]) -> str:
    return f"; its links: {', '.join(sorted(links)[:20])}" if links else "; the file has no links"


def direction(urdf: Urdf, joint: ET.Element) -> Float[np.ndarray, " 3"]:
    """The unit axis of a joint in its own frame; x where none is written."""
    name, axis = _named(joint), joint.find("axis")
    direction = urdf.vector(axis, "xyz", [1.0, 0.0, 0.0], name)
    length = np.linalg.norm(direction)
    if length == 0:
        urdf.wrong(axis, f"{name}: the axis is zero; write a direction such as 0 0 1")
        return np.eye(3)[0]
    return direction / length


def _range(urdf: Urdf, joint: ET.Element) -> tuple[float, float, float]:
    """Lower limit, upper limit and speed of a moving joint [rad] or [mm]."""
    name, kind, limit = _named(joint), joint.get("type", ""), joint.find("limit")
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
