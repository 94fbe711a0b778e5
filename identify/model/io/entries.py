"""Between what files hold, in millimetres and degrees, and what it describes; both ways."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from identify.model.cell import DEG, Cell, Controller, Point, Priors, Spacing, TouchSettings, Wire, Zone
from identify.model.files import InputError
from identify.model.frames import pose, transform
from identify.model.io import schema
from identify.model.io.devices import device_entry, device_of
from identify.model.io.joint_counting import counting_entry, counting_of
from identify.model.io.units import described, entry_of, outside
from identify.model.jig import Box, Face, Jig
from identify.model.joint import SLIDING, TURNING, Capsule, Joint
from identify.model.robot import POSE_NAMES, Robot
from identify.model.shape import Shape

POSE_KEYS = tuple(f"{name}_{'deg' if name.startswith('r') else 'mm'}" for name in POSE_NAMES)
LINK_UNIT = np.array([DEG, 1.0, 1.0, DEG, DEG])
POSE_UNIT = np.array([1.0, 1.0, 1.0, DEG, DEG, DEG])


def pose_of(entry: schema.PoseEntry | Literal["fit"]) -> Float[np.ndarray, " 6"] | None:
    """A frame's x, y, z [mm], rz, ry, rx [rad]; None where it is to be fitted."""
    return None if entry == "fit" else np.array([getattr(entry, key) for key in POSE_KEYS]) * POSE_UNIT


def pose_entry(frame: Float[np.ndarray, " 6"] | None) -> dict[str, float] | str:
    """The inverse of `pose_of`."""
    return "fit" if frame is None else dict(zip(POSE_KEYS, (frame / POSE_UNIT).tolist(), strict=True))


def joint_of(number: int, entry: schema.JointEntry) -> Joint:
    """A joint from its entry."""
    slides = entry.type == "prismatic"
    limits, speed = (entry.limits_mm, entry.speed_mm_s) if slides else (entry.limits_deg, entry.speed_deg_s)
    if limits is None:
        raise InputError(f"joint '{entry.name or f'j{number}'}' has no limits_{'mm' if slides else 'deg'}")
    unit, usual_speed = (1.0, SLIDING) if slides else (DEG, TURNING)
    return Joint(
        entry.name or f"j{number}",
        slides,
        entry.theta_deg * DEG,
        entry.d_mm,
        entry.a_mm,
        entry.alpha_deg * DEG,
        entry.beta_deg * DEG,
        limits[0] * unit,
        limits[1] * unit,
        usual_speed if speed is None else speed * unit,
        entry.mass_kg,
        entry.centre_mm,
    )


def robot_of(file: schema.RobotFile) -> Robot:
    """A robot from its file."""
    capsules = tuple(described(Capsule, capsule) for capsule in file.capsules)
    joints = tuple(joint_of(i + 1, entry) for i, entry in enumerate(file.joints))
    first, flange = (transform(np.asarray(pose_of(entry))) for entry in (file.base_to_first, file.last_to_flange))
    robot = Robot(
        file.name,
        joints,
        file.source,
        capsules,
        first,
        flange,
        errors=tuple(file.errors),
        up=file.up,
        drawing=tuple(tuple((np.array(link) * LINK_UNIT).tolist()) for link in file.drawing),
        payload=_payload(file.payload),
        temperature=file.temperature_c,
    )
    unit = dict(zip(robot.parameters, robot.parameter_unit(), strict=True))
    values = tuple(file.error_values.get(name, 0.0) * unit[name] for name, _, _ in robot.error_parameters)
    return replace(robot, error_values=values)


def _payload(entry: schema.PayloadEntry | None) -> tuple[float, tuple[float, float, float]] | None:
    return None if entry is None else (entry.mass_kg, entry.centre_mm)


def _payload_entry(robot: Robot) -> dict[str, Any] | None:
    return None if robot.payload is None else {"mass_kg": robot.payload[0], "centre_mm": robot.payload[1]}


def equipped(file: schema.CellFile, robot: Robot) -> Robot:
    """The robot with what the cell says of its errors, its mounting, its load, its temperature and its controller."""
    return replace(
        robot,
        errors=robot.errors if file.errors is None else tuple(file.errors),
        error_values=robot.error_values if file.errors is None else (),
        up=robot.up if file.up is None else file.up,
        payload=robot.payload if file.payload is None else _payload(file.payload),
        temperature=robot.temperature if file.temperature_c is None else file.temperature_c,
        counting=robot.counting if file.joints is None else counting_of(file.joints, [j.name for j in robot.joints]),
    )


def robot_entry(robot: Robot) -> dict[str, Any]:
    """The inverse of `robot_of`."""
    unit = dict(zip(robot.parameters, robot.parameter_unit(), strict=True))
    names = [name for name, _, _ in robot.error_parameters]
    return {
        "name": robot.name,
        "source": robot.source,
        "joints": [_joint_entry(joint) for joint in robot.joints],
        "capsules": [entry_of(capsule, schema.CapsuleEntry) for capsule in robot.capsules],
        "base_to_first": pose_entry(pose(robot.base_T_first)),
        "last_to_flange": pose_entry(pose(robot.last_T_flange)),
        "errors": list(robot.errors),
        "error_values": {name: value / unit[name] for name, value in zip(names, robot.error_values, strict=False)},
        "drawing": [(np.array(link) / LINK_UNIT).tolist() for link in robot.drawing],
        "up": robot.up,
        "payload": _payload_entry(robot),
        "temperature_c": robot.temperature,
    }


def _joint_entry(joint: Joint) -> dict[str, Any]:
    unit, factor = ("mm", 1.0) if joint.prismatic else ("deg", DEG)
    return {
        "name": joint.name,
        "type": "prismatic" if joint.prismatic else "revolute",
        "theta_deg": joint.theta / DEG,
        "d_mm": joint.d,
        "a_mm": joint.a,
        "alpha_deg": joint.alpha / DEG,
        "beta_deg": joint.beta / DEG,
        f"limits_{unit}": [joint.lower / factor, joint.upper / factor],
        f"speed_{unit}_s": joint.speed / factor,
        "mass_kg": joint.mass,
        "centre_mm": joint.centre,
    }


def jig_of(file: schema.JigFile, folder: Path = Path()) -> Jig:
    """A jig from its file, which stands in a folder."""
    faces, boxes = (described(Face, f) for f in file.faces), (described(Box, b) for b in file.boxes)
    return Jig(file.name, tuple(faces), tuple(boxes), obstacles_of(file.obstacles, folder))


def obstacles_of(entries: Sequence[schema.ObstacleEntry], folder: Path) -> tuple[Shape, ...]:
    """Solids that stand still, from their entries in a file that stands in a folder."""
    return tuple(_obstacle(entry, entry.name or f"obstacle {i + 1}", folder) for i, entry in enumerate(entries))


def _obstacle(entry: schema.ObstacleEntry, name: str, folder: Path) -> Shape:
    T = transform(np.asarray(pose_of(entry.pose)))
    if entry.mesh is not None:
        return Shape(0, name, "mesh", (entry.scale,) * 3, T, entry.mesh, folder / entry.mesh)
    kind, size = ("box", entry.box_mm) if entry.box_mm else ("cylinder", entry.cylinder_mm)
    return Shape(0, name, kind, tuple(size or ()), T)


def obstacle_entry(shape: Shape) -> dict[str, Any]:
    """The inverse of `obstacles_of`; a mesh stands where it was found."""
    form: dict[str, Any] = {f"{shape.kind}_mm": shape.size}
    if shape.kind == "mesh":
        form = {"mesh": str(shape.path and shape.path.absolute()), "scale": shape.size[0]}
    return {"name": shape.name, **form, "pose": pose_entry(pose(shape.pose))}


def jig_entry(jig: Jig) -> dict[str, Any]:
    """The inverse of `jig_of`."""
    return {
        "name": jig.name,
        "faces": [entry_of(face, schema.FaceEntry) for face in jig.faces],
        "boxes": [entry_of(box, schema.BoxEntry) for box in jig.boxes],
        "obstacles": [obstacle_entry(shape) for shape in jig.obstacles],
    }


def priors_of(entry: schema.PriorsEntry) -> Priors:
    """Tolerances from their entry."""
    base, tool = (entry.base_mm, entry.base_deg * DEG), (entry.tool_mm, entry.tool_deg * DEG)
    return Priors(base, tool, (entry.length_mm, entry.angle_deg * DEG), entry.errors)


def priors_entry(priors: Priors) -> dict[str, Any]:
    """The inverse of `priors_of`."""
    keys = ("base_mm", "base_deg"), ("tool_mm", "tool_deg"), ("length_mm", "angle_deg")
    entry: dict[str, Any] = {}
    for (length, angle), pair in zip(keys, (priors.base, priors.tool, priors.link), strict=True):
        entry |= {length: pair[0], angle: outside(pair[1], DEG)}
    return entry | ({"errors": dict(priors.errors)} if priors.errors else {})


def cell_of(
    file: schema.CellFile, robot: Robot, jig: Jig | None, sources: dict[str, str], folder: Path = Path()
) -> Cell:
    """A cell from its file, which stands in a folder, and the robot and the jig that the file names."""
    robot = equipped(file, robot)
    unit = dict(zip(robot.parameters, robot.parameter_unit(), strict=True))
    return Cell(
        robot=robot,
        jig=jig,
        base=pose_of(file.base),
        tool=pose_of(file.tool),
        wire=described(Wire, file.wire),
        touch=described(TouchSettings, file.touch),
        zone=None if file.zone is None else described(Zone, file.zone),
        priors=priors_of(file.priors),
        controller=described(Controller, file.controller),
        fixed=frozenset(file.fixed),
        bounds={k: (lo * unit[k], hi * unit[k]) for k, (lo, hi) in file.bounds.items()},
        sources=sources,
        devices={kind: device_of(kind, entry) for kind, entry in file.measure.items()},
        serial=file.serial,
        obstacles=obstacles_of(file.obstacles, folder),
        placements={name: pose_of(frame) for name, frame in file.placements.items()},
        tools={name: pose_of(frame) for name, frame in file.tools.items()},
        points={name: point_of(entry) for name, entry in file.points.items()},
        spacings=tuple(Spacing(s.start, s.end, s.mm, s.sigma_mm) for s in file.spacings),
    )


def point_of(entry: schema.PointEntry | Literal["fit"]) -> Point:
    """A named point from its entry."""
    return Point(None) if entry == "fit" else Point(np.array([entry.x_mm, entry.y_mm, entry.z_mm]), entry.sigma_mm)


def point_entry(point: Point) -> dict[str, float] | str:
    """The inverse of `point_of`."""
    if point.position is None:
        return "fit"
    return dict(zip(("x_mm", "y_mm", "z_mm"), point.position.tolist(), strict=True)) | {"sigma_mm": point.sigma}


def cell_entry(cell: Cell) -> dict[str, Any]:
    """A cell as one document that needs no other file: robot and jig stand in it."""
    unit = dict(zip(cell.robot.parameters, cell.robot.parameter_unit(), strict=True))
    return {
        "robot": robot_entry(cell.robot),
        "jig": None if cell.jig is None else jig_entry(cell.jig),
        "base": pose_entry(cell.base),
        "tool": pose_entry(cell.tool),
        "joints": counting_entry(cell.robot.counting, [joint.name for joint in cell.robot.joints]) or None,
        "wire": entry_of(cell.wire, schema.WireEntry),
        "touch": entry_of(cell.touch, schema.TouchEntry),
        "zone": None if cell.zone is None else entry_of(cell.zone, schema.ZoneEntry),
        "priors": priors_entry(cell.priors),
        "controller": entry_of(cell.controller, schema.ControllerEntry),
        "placements": {name: pose_entry(frame) for name, frame in cell.placements.items()},
        "tools": {name: pose_entry(frame) for name, frame in cell.tools.items()},
        "points": {name: point_entry(point) for name, point in cell.points.items()},
        "spacings": [{"from": s.start, "to": s.end, "mm": s.distance, "sigma_mm": s.sigma} for s in cell.spacings],
        "measure": {kind: device_entry(device) for kind, device in cell.devices.items()},
        "serial": cell.serial,
        "obstacles": [obstacle_entry(shape) for shape in cell.obstacles],
        "fixed": sorted(cell.fixed),
        "bounds": {name: [lo / unit[name], hi / unit[name]] for name, (lo, hi) in cell.bounds.items()},
    }


def cell_from_entry(entry: dict[str, Any], sources: dict[str, str]) -> Cell:
    """The inverse of `cell_entry`; raises pydantic's ValidationError or InputError where the document is not one."""
    file = schema.EmbeddedCell.model_validate(entry)
    robot = robot_of(file.robot)
    if unknown := sorted({*file.fixed, *file.bounds} - set(robot.parameters)):
        raise InputError(f"robot '{robot.name}' has no parameter '{unknown[0]}'")
    return cell_of(file, robot, None if file.jig is None else jig_of(file.jig), sources)
