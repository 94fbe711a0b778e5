"""What single values of a YAML file cannot show: units mixed up, names taken twice, ranges turned around.

Every check looks at the entries that can be read, also in a file that has other mistakes, so that all come at once.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from identify.model.files import InputError, Mistake, nearest
from identify.model.io.devices import device_mistakes
from identify.model.io.document import Document, entries, usable
from identify.model.io.joint_counting import counting_mistakes
from identify.model.io.schema import (
    BoxEntry,
    CapsuleEntry,
    FaceEntry,
    JointEntry,
    ObstacleEntry,
    PoseEntry,
    Strict,
    TouchEntry,
    WireEntry,
    ZoneEntry,
)
from identify.model.joint_error_models import ERROR_MODELS, SIZES
from identify.model.meshes import READERS, read_mesh
from identify.model.robot import Robot

METRES = "metres? write millimetres"
RADIANS = "radians? write degrees"
SHORT = 5.0  # [mm], below which a whole robot, jig or placement was meant in metres


def cell_mistakes(document: Document, robot: Robot | None) -> list[Mistake]:
    """What is wrong in cell.yaml beyond its form; names of parameters where the robot is known."""
    wrong = []
    for key in ("base", "tool"):
        if pose := usable(document.get(key), PoseEntry):
            wrong += _placement(document, key, pose)
    touch = usable(document.get("touch"), TouchEntry) or TouchEntry()
    for name in ("approach_mm", "travel_mm"):
        if getattr(touch, name) < 0.5:
            wrong.append(document.wrong(f"{name} is {getattr(touch, name):g}: {METRES}", "touch", name))
    wire = usable(document.get("wire"), WireEntry) or WireEntry()
    if 0 < wire.radius_mm < 0.02:
        wrong.append(document.wrong(f"a wire of radius {wire.radius_mm:g} mm: {METRES}", "wire", "radius_mm"))
    zone = usable(document.get("zone"), ZoneEntry)
    for key, tilted in (("touch", touch), ("zone", zone)):
        if tilted and tilted.max_tilt_deg < 1.6:
            wrong.append(document.wrong(f"a tilt of {tilted.max_tilt_deg:g} degrees: {RADIANS}", key, "max_tilt_deg"))
    wrong += _zone(document, zone) if zone else []
    wrong += _spacings(document) + device_mistakes(document)
    wrong += obstacle_mistakes(document)
    if robot is not None:
        wrong += counting_mistakes(document, [joint.name for joint in robot.joints])
    return wrong + _bounds(document) + (_parameters(document, robot) if robot else [])


def _spacings(document: Document) -> list[Mistake]:
    """Spacings between points that the cell does not have."""
    points, spacings = document.get("points"), document.get("spacings")
    names = list(points) if isinstance(points, dict) else []
    return [
        document.wrong(f"no point '{entry[key]}'{nearest(entry[key], names)}; name it in points:", "spacings", i, key)
        for i, entry in enumerate(spacings if isinstance(spacings, list) else [])
        for key in ("from", "to")
        if isinstance(entry, dict) and isinstance(entry.get(key), str) and entry[key] not in names
    ]


def _placement(document: Document, key: str, pose: PoseEntry) -> list[Mistake]:
    wrong = []
    if 0 < max(abs(pose.x_mm), abs(pose.y_mm), abs(pose.z_mm)) < SHORT:
        wrong.append(document.wrong(f"{key} lies within {SHORT:g} mm of its origin: {METRES}", key))
    return wrong + _in_radians(document, pose, ("rz_deg", "ry_deg", "rx_deg"), key)


def _in_radians(document: Document, entry: Strict, names: Sequence[str], *place: int | str) -> list[Mistake]:
    """Numbers that should be degrees and are 45, 90, 135 or 180 degrees in radians."""
    angles = {name: getattr(entry, name) for name in names}
    return [
        document.wrong(f"{name} is {angle:g}: {RADIANS}", *place, name)
        for name, angle in angles.items()
        if np.isclose(abs(angle), np.pi * np.arange(1, 5) / 4, rtol=0, atol=5e-4).any()
    ]


def _zone(document: Document, zone: ZoneEntry) -> list[Mistake]:
    wrong = [
        document.wrong(f"zone box: {axis} runs from {lo:g} to {hi:g}; write the smaller first", "zone", "box_mm")
        for axis, (lo, hi) in zip("xyz", zone.box_mm, strict=True)
        if lo >= hi
    ]
    if max(abs(v) for pair in zone.box_mm for v in pair) < SHORT:
        wrong.append(
            document.wrong(f"the zone lies within {SHORT:g} mm of the jig's origin: {METRES}", "zone", "box_mm")
        )
    return wrong


def _bounds(document: Document) -> list[Mistake]:
    bounds = document.get("bounds")
    ranges = {k: v for k, v in bounds.items() if _is_range(v)} if isinstance(bounds, dict) else {}
    return [
        document.wrong(f"bounds of {name} run from {lo:g} to {hi:g}; write the smaller first", "bounds", name)
        for name, (lo, hi) in ranges.items()
        if lo >= hi
    ]


def _is_range(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(isinstance(v, int | float) for v in value)


def _parameters(document: Document, robot: Robot) -> list[Mistake]:
    """Names of parameters that the robot does not have."""
    bounds, names = document.get("bounds"), robot.parameters
    places: list[tuple[str, int | str, Any]] = [("fixed", i, name) for i, name in enumerate(document.items("fixed"))]
    places += [("bounds", name, name) for name in (bounds if isinstance(bounds, dict) else {})]
    return [
        document.wrong(f"{key}: the robot has no parameter '{name}'{nearest(name, names)}", key, place)
        for key, place, name in places
        if isinstance(name, str) and name not in names
    ]


def error_mistakes(document: Document) -> list[Mistake]:
    """Error models, and sizes of them, that do not exist."""
    wrong = [
        document.wrong(f"errors: no error model '{name}'{_known(name, ERROR_MODELS)}", "errors", i)
        for i, name in enumerate(document.items("errors"))
        if isinstance(name, str) and name not in ERROR_MODELS
    ]
    priors = document.get("priors")
    sizes = priors.get("errors") if isinstance(priors, dict) else None
    return wrong + [
        document.wrong(f"priors: no size '{key}' of an error{_known(key, SIZES)}", "priors", "errors", key)
        for key in (sizes if isinstance(sizes, dict) else ())
        if isinstance(key, str) and key not in SIZES
    ]


def _known(name: str, names: Iterable[str]) -> str:
    return f"{nearest(name, names)}; there are {', '.join(names)}"


def robot_mistakes(document: Document) -> list[Mistake]:
    """What is wrong in robot.yaml beyond its form."""
    joints = entries(document, "joints", JointEntry)
    wrong = [m for i, entry in joints for m in _joint(document, i, entry)]
    names = dict[str, int]()
    for i, entry in joints:
        name = entry.name or f"j{i + 1}"
        if name in names or name in {"base", "tool"} or "." in name:
            wrong.append(
                document.wrong(f"joint name '{name}' is taken or has a dot; choose another", "joints", i, "name")
            )
        names.setdefault(name, i)
    count = len(document.items("joints"))
    for i, capsule in entries(document, "capsules", CapsuleEntry):
        if capsule.link > count:
            wrong.append(
                document.wrong(f"link {capsule.link} does not exist; the last is {count}", "capsules", i, "link")
            )
    longest = max((max(abs(entry.a_mm), abs(entry.d_mm)) for _, entry in joints), default=0.0)
    if 0 < longest < SHORT:
        wrong.append(document.wrong(f"no link is longer than {longest:g} mm: {METRES}", "joints"))
    return wrong + error_mistakes(document)


def error_value_mistakes(document: Document, robot: Robot) -> list[Mistake]:
    """Values of error parameters that the robot does not have."""
    values, names = document.get("error_values"), [name for name, _, _ in robot.error_parameters]
    return [
        document.wrong(f"error_values: no error parameter '{name}'{_known(str(name), names)}", "error_values", name)
        for name in (values if isinstance(values, dict) else ())
        if name not in names
    ]


def _joint(document: Document, i: int, entry: JointEntry) -> list[Mistake]:
    unit, other = ("mm", "deg") if entry.type == "prismatic" else ("deg", "mm")
    raw, key, limits, wrong = document.items("joints")[i], f"limits_{unit}", getattr(entry, f"limits_{unit}"), []
    if raw.get("type", entry.type) != entry.type:  # a mistake by itself, and the units depend on it
        return []
    if limits is None and key not in raw:
        wrong.append(document.wrong(f"joint {i + 1} needs {key}: [lower, upper]", "joints", i))
    elif limits and limits[0] >= limits[1]:
        wrong.append(document.wrong(f"joint {i + 1}: limits run from {limits[0]:g} to {limits[1]:g}", "joints", i, key))
    elif limits and unit == "deg" and max(map(abs, limits)) < 7:
        wrong.append(document.wrong(f"joint {i + 1}: limits within 7 degrees: {RADIANS}", "joints", i, key))
    for name in (f"limits_{other}", f"speed_{other}_s"):
        if getattr(entry, name) is not None:
            cure = f"write {name.replace(other, unit)} in place of {name}"
            wrong.append(document.wrong(f"joint {i + 1} is {entry.type}: {cure}", "joints", i, name))
    return wrong + _in_radians(document, entry, ("theta_deg", "alpha_deg", "beta_deg"), "joints", i)


def jig_mistakes(document: Document) -> list[Mistake]:
    """What is wrong in jig.yaml beyond its form."""
    faces = entries(document, "faces", FaceEntry)
    wrong = [m for i, face in faces for m in _face(document, i, face)]
    names = list[str]()
    for i, face in faces:
        if face.name in names:
            wrong.append(
                document.wrong(f"face '{face.name}' is named twice; give it a name of its own", "faces", i, "name")
            )
        names.append(face.name)
    largest = max((float(np.linalg.norm([f.u_mm, f.v_mm], axis=1).max()) for _, f in faces), default=0.0)
    if 0 < largest < SHORT:
        wrong.append(document.wrong(f"no face is larger than {SHORT:g} mm: {METRES}", "faces"))
    for i, box in entries(document, "boxes", BoxEntry):
        if not np.all(np.array(box.lower_mm) < np.array(box.upper_mm)):
            wrong.append(document.wrong("lower_mm is not below upper_mm", "boxes", i, "lower_mm"))
    return wrong + obstacle_mistakes(document)


def obstacle_mistakes(document: Document) -> list[Mistake]:
    """Obstacles of jig.yaml or cell.yaml that are no single solid, or meshes that are not there."""
    wrong = list[Mistake]()
    for i, entry in entries(document, "obstacles", ObstacleEntry):
        forms = [key for key in ("box_mm", "cylinder_mm", "mesh") if getattr(entry, key) is not None]
        if len(forms) != 1:
            words = " and ".join(forms) or "no form"
            text = f"an obstacle has {words}; write one of box_mm, cylinder_mm and mesh"
            wrong.append(document.wrong(text, "obstacles", i))
        elif entry.mesh is not None:
            path = document.path.parent / entry.mesh
            if path.suffix.lower() not in READERS:
                text = f"mesh '{entry.mesh}' is neither STL nor OBJ; export it as one of these"
                wrong.append(document.wrong(text, "obstacles", i, "mesh"))
            elif not path.is_file():
                text = f"mesh file '{entry.mesh}' does not exist beside {document.path.name}"
                wrong.append(document.wrong(text, "obstacles", i, "mesh"))
            else:
                try:
                    read_mesh(path)
                except InputError as error:
                    wrong += [m for m in error.mistakes if isinstance(m, Mistake)]
    return wrong


def _face(document: Document, i: int, face: FaceEntry) -> list[Mistake]:
    u, v = np.array(face.u_mm), np.array(face.v_mm)
    area = np.linalg.norm(u) * np.linalg.norm(v)
    if np.linalg.norm(np.cross(u, v)) <= 1e-6 * area:
        return [document.wrong(f"face '{face.name}': u and v span no area", "faces", i, "u_mm")]
    if abs(u @ v) > 1e-6 * area:
        return [document.wrong(f"face '{face.name}': u and v are not at right angles", "faces", i, "u_mm")]
    return []
