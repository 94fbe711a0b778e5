"""Where the robot goes for a touch, and how fast: from joint values of a plan to motions."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.jig import Face, Jig
from identify.model.touch import Plan
from probe.motion.settings import Settings

CREEP = 1e-3  # [rad/s], for a motion that goes nowhere
Joints = Float[np.ndarray, " joints"]
SMALL = 1e-4  # [rad]
BETWEEN = 1.1  # times as far from an axis between two postures as in one of them
SAMPLES = 33  # of a joint path, for the length of the tip's way


@dataclass(frozen=True, eq=False)
class Target:
    """A touch to be made: straight in joint space from the approach through the planned contact to the end."""

    id: str
    face: Face
    approach: Float[np.ndarray, " joints"]  # [rad] or [mm]
    contact: Float[np.ndarray, " joints"]
    end: Float[np.ndarray, " joints"]  # of the search, where nothing is met
    length: float  # [mm] of the tip's way from approach to end
    via: Float[np.ndarray, "vias joints"]  # postures that lead to the approach from the touch before


class Geometry:
    """Lengths and rates of joint paths of a cell's robot, by its nominal kinematics."""

    def __init__(self, cell: Cell, settings: Settings) -> None:
        self.cell = cell
        self.settings = settings
        self.search_speed = settings.search_speed or cell.touch.speed  # [mm/s]

    @cached_property
    def unit(self) -> Float[np.ndarray, " joints"]:
        """Factors from deg or mm to the inside."""
        return self.cell.robot.joint_unit()

    def tip(self, q: Float[np.ndarray, "poses joints"]) -> Float[np.ndarray, "poses 3"]:
        """Tip positions in the jig frame [mm]."""
        return self.cell.kinematics.tip(q, self.cell.theta)[0]

    def path(
        self, start: Float[np.ndarray, " joints"], end: Float[np.ndarray, " joints"]
    ) -> tuple[Float[np.ndarray, " samples"], Float[np.ndarray, "samples 3"], Float[np.ndarray, " samples"]]:
        """Fractions of a straight joint path, the tip there, and the way of the tip up to there [mm]."""
        s = np.linspace(0.0, 1.0, SAMPLES)
        tip = self.tip(start + s[:, None] * (end - start))
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(tip, axis=0), axis=1))])
        return s, tip, way

    def length(self, start: Float[np.ndarray, " joints"], end: Float[np.ndarray, " joints"]) -> float:
        """The way of the tip [mm]."""
        return float(self.path(start, end)[2][-1])

    def span(self, start: Float[np.ndarray, " joints"], end: Float[np.ndarray, " joints"]) -> float:
        """The largest joint motion as the controller counts [rad], where 1 mm of a sliding joint counts as 1 deg."""
        robot = self.cell.robot
        return float(np.radians(np.abs(robot.to_controller(end) - robot.to_controller(start)).max()))

    def beyond(
        self, start: Float[np.ndarray, " joints"], through: Float[np.ndarray, " joints"], travel: float
    ) -> Float[np.ndarray, " joints"]:
        """The point on the line from `start` `through` a point where the tip has travelled `travel` [mm].

        Shorter where a joint limit comes first.
        """
        direction = through - start
        near = self.length(start, through)
        if near == 0.0 or not direction.any():
            return through
        robot = self.cell.robot
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(direction > 0, (robot.upper - start) / direction, (robot.lower - start) / direction)
        widest = float(min(np.min(room[direction != 0]), 2.0 * travel / near))
        s, _, way = self.path(start, start + widest * direction)
        return start + float(np.interp(travel, way, s)) * widest * direction

    def search_rate(self, target: Target, speed: float) -> float:
        """Rate [rad/s] at which the tip searches at a speed [mm/s]."""
        return self.span(target.approach, target.end) * speed / target.length

    def velocity(
        self, start: Float[np.ndarray, " joints"], end: Float[np.ndarray, " joints"], rate: float
    ) -> Float[np.ndarray, " joints"]:
        """Joint speeds of a motion at a rate [rad/s] or [mm/s]."""
        return (end - start) * (rate / max(self.span(start, end), 1e-12))

    def move_rate(self, start: Float[np.ndarray, " joints"], end: Float[np.ndarray, " joints"], speed: float) -> float:
        """Rate [rad/s] at which neither a joint nor the tip [mm/s] is too fast."""
        speeds = np.abs(end - start) / self.cell.robot.speed
        seconds = max(float(speeds.max()), self.length(start, end) / speed)
        return max(self.span(start, end) / max(seconds, 1e-9) * self.settings.override, CREEP)

    def target(self, plan: Plan, i: int, jig: Jig) -> Target:
        """What is to be done for a touch of a plan."""
        approach, contact = plan.approach[i], plan.q[i]
        end = self.beyond(approach, contact, self.cell.touch.travel)
        face, length = jig.by_name[plan.face[i]], self.length(approach, end)
        return Target(plan.ids[i], face, approach, contact, end, length, plan.way(i)[:-1])

    def fraction(
        self, q: Float[np.ndarray, " joints"], start: Float[np.ndarray, " joints"], end: Float[np.ndarray, " joints"]
    ) -> tuple[float, float]:
        """How far along a joint line a point lies (0 ... 1), and how far off it [rad, or mm counted as deg]."""
        a, b, p = start / self.unit, end / self.unit, q / self.unit
        line = b - a
        square = float(line @ line)
        s = float((p - a) @ line / square) if square else 0.0
        return s, float(np.radians(np.abs(p - a - s * line).max()))


def reach(cell: Cell, plan: Plan) -> float:
    """The largest distance of the tip from the axis of a turning joint [mm], on the ways and searches of a plan."""
    q = np.concatenate([plan.q, *(plan.way(i) for i in range(len(plan)))])
    turns = SMALL * np.eye(q.shape[1])[np.logical_not(cell.robot.prismatic)]
    turned = cell.kinematics.tip((q + turns[:, None]).reshape(-1, q.shape[1]), cell.theta)[0]
    away = turned.reshape(len(turns), *q.shape[:1], 3) - cell.kinematics.tip(q, cell.theta)[0]
    return BETWEEN * float(np.linalg.norm(away, axis=2).max(initial=0.0)) / SMALL
