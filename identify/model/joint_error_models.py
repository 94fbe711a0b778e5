"""What a real arm does beyond geometry: models of joint errors, one function and one row of ERROR_MODELS each.

Every effect is linear in its parameters, which are zero on a nominal robot: a term has a shape, a function of joint
values, of gravity and of how a touch was made, and its parameter says how much of it there is. Gravity acts on the
nominal dimensions, which are right to a percent; the tip, whose place may be unknown, is taken from the parameters.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal, Protocol

import casadi as ca
import numpy as np
from jaxtyping import Float

from identify.model.joint import Joint

DEG = np.pi / 180
GRAVITY = 9.80665  # [m/s^2]
SIDE = 0.01  # [m], lever of a weight below which nobody knows on which flank of its teeth a gear rests


@dataclass(frozen=True)
class Size:
    """A file unit of error parameters, and how large they are on robots: one standard deviation of the prior."""

    unit: str
    inside: float  # factor from the file unit to millimetres, radians, newtons and kelvins
    usual: float  # in the file unit


SIZES = {
    "harmonics_deg": Size("deg", DEG, 0.01),  # an encoder or gear off centre by 2 to 20 micrometres
    "sag_deg_m": Size("deg/m", DEG, 0.1),
    "compliance_deg_knm": Size("deg/kNm", DEG / 1000, 3.0),  # 2e4 Nm/rad, a small robot's joint
    "backlash_deg": Size("deg", DEG, 0.02),
    "coupling": Size("1", 1.0, 2e-4),
    "gear": Size("1", 1.0, 2e-4),
    "growth_ppm_k": Size("ppm/K", 1e-6, 20.0),  # aluminium 23, steel 12
}
"""What a key below `priors: errors:` in cell.yaml says, and what holds where it is not written."""

Target = tuple[Literal["joint", "tilt", "length"], int]


class Dimensions(Protocol):
    """What error models use of a robot: its drawing, its weights, and the names of its models."""

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints from base to flange."""

    @property
    def base_T_first(self) -> Float[np.ndarray, "4 4"]:
        """A URDF's base link, before joint 1 [mm]."""

    @property
    def last_T_flange(self) -> Float[np.ndarray, "4 4"]:
        """Behind the frame of the last joint [mm]."""

    @property
    def errors(self) -> tuple[str, ...]:
        """Rows of ERROR_MODELS that this robot has."""

    @property
    def up(self) -> tuple[float, float, float]:
        """Against gravity, in the base frame."""

    @property
    def payload(self) -> tuple[float, tuple[float, float, float]] | None:
        """Mass [kg] and its centre [mm] in the flange frame."""

    @property
    def drawn(self) -> tuple[tuple[float, ...], ...]:
        """Five link parameters a joint, by the drawing [rad] or [mm]."""

    @property
    def prismatic(self) -> tuple[bool, ...]:
        """Whether each joint is prismatic."""

    @property
    def weighed(self) -> bool:
        """Whether the masses of the links are known."""

    @property
    def error_parameters(self) -> tuple[tuple[str, str, str], ...]:
        """Name, key of its size, and model of every error parameter."""


@dataclass(frozen=True, eq=False)
class Term:
    """One error parameter: its name, the key of its size, and what one unit of it adds, and where."""

    name: str
    size: str  # a key of SIZES
    shapes: dict[Target, ca.SX]


class Arm:
    """A robot in a posture, as its error models see it.

    `conditions` are how a touch was made: the direction of every joint's motion into it (-1, 0 or 1), the temperature
    above the reference [K], and the payload beyond that of the robot, as a part of it.
    """

    def __init__(self, robot: Dimensions, q: ca.SX, tool: ca.SX, conditions: ca.SX) -> None:
        self.robot, self.q, self.tool = robot, q, tool
        self.direction, self.warmth, self.beyond = conditions[:-FURTHER], conditions[WARMTH], conditions[BEYOND]

    @cached_property
    def frames(self) -> list[tuple[ca.SX, ca.SX]]:
        """Rotation and origin [mm] of link frames 0 to N in the base frame, by the nominal dimensions."""
        R, p = ca.SX(self.robot.base_T_first[:3, :3].round(15)), ca.SX(self.robot.base_T_first[:3, 3])
        frames = [(R, p)]
        for i, (theta, d, a, alpha, beta) in enumerate(self.robot.drawn):
            slides = self.robot.prismatic[i]
            turn, slide = (ca.SX(theta), d + self.q[i]) if slides else (theta + self.q[i], ca.SX(d))
            c, s = ca.cos(turn), ca.sin(turn)
            p = p + R @ ca.vertcat(a * c, a * s, slide)
            R = R @ (_turn(c, s) @ ca.SX(_twist(alpha, beta)))
            frames.append((R, p))
        return frames

    @cached_property
    def weights(self) -> list[tuple[int, str, ca.SX, ca.SX | float]]:
        """The link that carries a weight, its name, its place [mm] in the base frame, and its size [N].

        Where masses are not given, a weight of one newton hangs at the origin of every link and one at the payload, or
        at the tip: any mass between is a combination of these. A measurement's own payload hangs at the same centre.
        """
        robot, last = self.robot, len(self.robot.joints)
        R, p = self.frames[-1]
        flange = p + R @ ca.SX(robot.last_T_flange[:3, 3])
        R = R @ ca.SX(robot.last_T_flange[:3, :3].round(15))
        mass, centre = robot.payload if robot.payload else (0.0, (0.0, 0.0, 0.0))
        load = flange + R @ (ca.SX(list(centre)) if robot.payload else self.tool[:3])
        larger = 1 + self.beyond if robot.payload else 1.0
        if not robot.weighed:
            return [*((k, f"sag{k}", self.frames[k][1], 1.0) for k in range(1, last + 1)), (last, "load", load, larger)]
        links = [
            (k, "", self.frames[k][1] + self.frames[k][0] @ ca.SX(list(joint.centre)), joint.mass * GRAVITY)
            for k, joint in enumerate(robot.joints, 1)
        ]
        return [*links, (last, "", load, mass * GRAVITY * larger)]

    def torque(self, joint: int, place: ca.SX) -> ca.SX:
        """Torque of one newton about the axis of a joint [Nm]."""
        R, p = self.frames[joint]
        return ca.dot(R[:, 2], self.moment(place, p))

    def moment(self, place: ca.SX, about: ca.SX) -> ca.SX:
        """Moment of one newton about a point [Nm], in the base frame."""
        return ca.cross((place - about) / 1000, ca.SX((-np.array(self.robot.up)).tolist()))

    def side(self, joint: int) -> ca.SX:
        """Where a joint rests in its play: behind its motion where that was recorded, else where gravity pulls it."""
        pull = sum((w * self.torque(joint, place) for k, _, place, w in self.weights if k > joint), ca.SX(1, 1))
        pull = pull / sum(w for k, _, _, w in self.weights if k > joint)
        unknown = 1 - ca.fabs(self.direction[joint])
        return unknown * ca.tanh(pull / SIDE) - self.direction[joint]


def _turn(c: ca.SX, s: ca.SX) -> ca.SX:
    return ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s, c, 0), ca.horzcat(0, 0, 1))


def _twist(alpha: float, beta: float) -> np.ndarray:
    """Rx(alpha) Ry(beta), with what is zero but for rounding exactly zero."""
    ca_, sa, cb, sb = np.cos(alpha), np.sin(alpha), np.cos(beta), np.sin(beta)
    M = np.array([[cb, 0, sb], [sa * sb, ca_, -sa * cb], [-ca_ * sb, sa, ca_ * cb]])
    return np.where(np.abs(M) < 1e-15, 0.0, M)


def harmonics(arm: Arm) -> Iterator[Term]:
    """Eccentric gears and encoders: the first two harmonics of every turning joint."""
    for i, joint in enumerate(arm.robot.joints):
        for order in (1, 2) if not joint.prismatic else ():
            yield Term(f"{joint.name}.cos{order}", "harmonics_deg", {("joint", i): ca.cos(order * arm.q[i])})
            yield Term(f"{joint.name}.sin{order}", "harmonics_deg", {("joint", i): ca.sin(order * arm.q[i])})


def compliance(arm: Arm) -> Iterator[Term]:
    """Joints and base give way to the torque of gravity.

    With masses in the robot file one compliance a joint and one of the base; without, one sag a joint and weight: the
    compliance times the unknown mass. The compliance of the base is the same about all axes.
    """
    origin = arm.frames[0][1]
    for i, joint in enumerate(arm.robot.joints):
        if not joint.prismatic:
            pulls = [(name, w * arm.torque(i, place)) for k, name, place, w in arm.weights if k > i]
            for name, size, pull in _sags(arm.robot, pulls):
                yield Term(f"{joint.name}.{name}", size, {("joint", i): pull})
    for name, size, pull in _sags(arm.robot, [(n, w * arm.moment(p, origin)) for _, n, p, w in arm.weights]):
        yield Term(f"base.{name}", size, {("tilt", axis): pull[axis] for axis in range(3)})


def _sags(robot: Dimensions, pulls: Sequence[tuple[str, ca.SX]]) -> list[tuple[str, str, ca.SX]]:
    """One term for all weights where they are known, else one for each."""
    if robot.weighed:
        return [("compliance", "compliance_deg_knm", sum((pull for _, pull in pulls), ca.SX(*pulls[0][1].shape)))]
    return [(name, "sag_deg_m", pull) for name, pull in pulls]


def backlash(arm: Arm) -> Iterator[Term]:
    """Play of the gears: half of it to the side where the joint rests."""
    for i, joint in enumerate(arm.robot.joints):
        if not joint.prismatic:
            yield Term(f"{joint.name}.backlash", "backlash_deg", {("joint", i): arm.side(i) / 2})


def coupling(arm: Arm) -> Iterator[Term]:
    """Joints that turn a little with another: joint 3 with joint 2, each of the last three with those before it."""
    count = len(arm.robot.joints)
    wrist = [(i, k) for i in range(max(count - 3, 3), count) for k in range(count - 3, i)]
    for i, k in [(2, 1), *wrist] if count > 2 else []:
        if not (arm.robot.prismatic[i] or arm.robot.prismatic[k]):
            yield Term(f"{arm.robot.joints[i].name}.couple{k + 1}", "coupling", {("joint", i): arm.q[k]})


def gear(arm: Arm) -> Iterator[Term]:
    """A ratio or a pitch that is not the one that the controller counts with."""
    for i, joint in enumerate(arm.robot.joints):
        yield Term(f"{joint.name}.gear", "gear", {("joint", i): arm.q[i]})


def thermal(arm: Arm) -> Iterator[Term]:
    """Links grow with the temperature recorded with a touch, above the one that the robot's dimensions are for."""
    for i, joint in enumerate(arm.robot.joints):
        yield Term(f"{joint.name}.growth", "growth_ppm_k", {("length", i): arm.warmth})


ERROR_MODELS: dict[str, Callable[[Arm], Iterator[Term]]] = {
    "harmonics": harmonics,
    "compliance": compliance,
    "backlash": backlash,
    "coupling": coupling,
    "gear": gear,
    "thermal": thermal,
}
"""Joint error models by the names that robot and cell files use."""
CONDITIONAL = {"backlash", "thermal", "compliance"}  # those that depend on how a touch was made
FURTHER, WARMTH, BEYOND = 2, -2, -1  # conditions behind the directions of the joints: how many, and where they stand


def terms(robot: Dimensions, q: ca.SX, tool: ca.SX, conditions: ca.SX) -> list[Term]:
    """The terms of a robot's error models, in the order of the table."""
    return [term for _, term in _terms(Arm(robot, q, tool, conditions))]


def _terms(arm: Arm) -> Iterator[tuple[str, Term]]:
    """Terms with their models, without those that do nothing: no weight turns an upright axis."""
    for name, model in ERROR_MODELS.items():
        for term in model(arm) if name in arm.robot.errors else ():
            if not all(ca.simplify(shape).is_zero() for shape in term.shapes.values()):
                yield name, term


@lru_cache(maxsize=64)
def parameters(robot: Dimensions) -> tuple[tuple[str, str, str], ...]:
    """Name, key of its size, and model of every error parameter of a robot."""
    arm = Arm(robot, ca.SX.sym("q", len(robot.joints)), ca.SX.sym("tool", 6), conditions(robot))
    return tuple((term.name, term.size, name) for name, term in _terms(arm))


def conditions(robot: Dimensions) -> ca.SX:
    """Directions of the joints, temperature above the reference and payload beyond the robot's, as symbols."""
    return ca.SX.sym("conditions", len(robot.joints) + FURTHER)


@dataclass(frozen=True, eq=False)
class Deflected:
    """Joint values, parameters and tilt of the base as they are, where the controller and the drawing say otherwise."""

    q: ca.SX
    theta: ca.SX
    tilt: ca.SX | None  # [rad] about x, y and z of the base; None where it stands firm


def deflected(robot: Dimensions, q: ca.SX, theta: ca.SX, conditions: ca.SX | None = None) -> Deflected:
    """What the error models make of commanded joint values and identified parameters.

    Without `conditions`, temperature and payload are the robot's and gravity tells where joints rest.
    """
    if not robot.errors:
        return Deflected(q, theta, None)
    joints = len(robot.joints)
    place = {name: 6 + 5 * joints + k for k, (name, _, _) in enumerate(robot.error_parameters)}
    errors = terms(robot, q, theta[-6:], ca.SX.zeros(joints + FURTHER) if conditions is None else conditions)
    angles, longer, tilt = ca.SX(q), ca.SX.zeros(joints), ca.SX.zeros(3)
    for term in errors:  # perhaps fewer than there are parameters: without conditions some do nothing
        for (kind, i), shape in term.shapes.items():
            into = {"joint": angles, "length": longer, "tilt": tilt}[kind]
            into[i] += theta[place[term.name]] * shape
    stretched = ca.SX(theta)
    for i in range(joints):
        for k in (7 + 5 * i, 8 + 5 * i):  # d and a
            stretched[k] = theta[k] * (1 + longer[i])
    return Deflected(angles, stretched, tilt if "compliance" in robot.errors else None)
