"""The machine under makers' programs: the virtual arm, an input, and a controller that knows the arm by its drawing.

The interpreters of the makers' languages stand on it, and so does the live run that they are compared with. Noise
is drawn by the number of contacts so far, so that the same touch has the same noise whoever makes it.
"""

from dataclasses import dataclass, field

import numpy as np

from identify.model.cell import Cell
from identify.model.touch import Plan
from probe.line.clock import Clock
from probe.line.controller import Contact, NoContact, Refused, State
from probe.virtual.arm import Arm
from probe.virtual.records import CONTACT, MOVE, NOCONTACT, OK, SEARCH
from probe.virtual.robot import VirtualRobot
from probe.virtual.truth import Truth

SEGMENT, TURN = 15.0, np.radians(2.0)  # [mm], [rad] of a straight line that is run as one joint motion


class RepeatableArm(Arm):
    """An arm whose noise depends on how many contacts there were, and whose torch hits things if asked for."""

    collides = False  # a tenth of a second a motion

    def _collision(self, paths, length):
        return super()._collision(paths, length) if self.collides else None

    def _draw(self) -> None:
        self.rng = np.random.default_rng([3, self.contacts])
        super()._draw()


@dataclass
class ScriptedRobot(VirtualRobot):
    """A robot before a jig that is away in some searches, and whose input stays closed after one."""

    missing: frozenset[int] = frozenset()  # numbers of searches without the jig, from 1
    sticks: int = 0  # number of the search after which the input sticks
    searches: int = 0
    commanded: list = field(default_factory=list)  # [rad], ends of the moves

    def __post_init__(self) -> None:
        super().__post_init__()
        self.arm = RepeatableArm(self.cell, self.truth, self.rng, self._q)

    def new_search(self) -> None:
        """A touch begins."""
        self.searches += 1
        self.health.open = self.searches in self.missing

    def begin(self, kind, q, rate, *, watch=True):
        if kind == MOVE:
            self.commanded.append(np.array(q))
            if self.searches and self.searches == self.sticks and self.touches:
                self.health.stuck, self.sticks = True, 0
        return super().begin(kind, q, rate, watch=watch)


def scripted(cell: Cell, truth: Truth, plan: Plan, missing=frozenset(), sticks: int = 0) -> ScriptedRobot:
    """A robot that stands where the plan begins."""
    start = plan.way(0)[0]
    return ScriptedRobot(cell, truth, np.random.default_rng(1), start, missing=frozenset(missing), sticks=sticks)


class Machine:
    """What a controller does with the arm: it counts in degrees, and knows the kinematics of the drawing."""

    def __init__(self, robot: ScriptedRobot) -> None:
        self.robot, self.cell = robot, robot.cell
        self.pauses: list[str] = []
        self.latches: list[np.ndarray] = []  # [deg], at the edge as the controller saw it

    # joints as the controller counts them

    @property
    def counts(self) -> np.ndarray:
        return self.cell.robot.to_controller(self.robot.q)

    def q(self, counts) -> np.ndarray:
        return self.cell.robot.from_controller(np.asarray(counts, dtype=float))

    def shown(self, q) -> np.ndarray:
        return self.cell.robot.to_controller(q)

    # time, and the input

    def wait(self, seconds: float) -> None:
        self.robot.advance(self.robot.time + seconds)

    @property
    def closed(self) -> bool:
        return self.robot.contact

    def opens(self, seconds: float) -> bool:
        """Wait for the input to open; whether it did."""
        end = self.robot.time + seconds
        while self.closed and self.robot.time < end:
            self.wait(0.01)
        return not self.closed

    def pause(self, why: str) -> None:
        """The operator frees the wire, and presses start."""
        self.pauses.append(why)
        self.robot.health.stuck = False

    # motions

    def move(self, counts, seconds: float | None = None, share: float | None = None, rate: float | None = None) -> None:
        """A joint motion in a time, at a share of the joint speeds, or at the speed of the fastest joint [rad/s]."""
        q = self.q(counts)
        step = np.abs(q - self.robot.q)
        if share is not None:
            seconds = float((step / (share * self.cell.robot.speed)).max())
        if rate is None:
            rate = float(step.max()) / seconds if seconds else 0.0
        self._run(MOVE, q, max(rate, 1e-4))

    def search(self, counts, seconds: float):
        """A joint motion that stops where the input closes: the latched counts, or None."""
        self.robot.new_search()
        outcome = self._run(SEARCH, self.q(counts), float(np.abs(self.q(counts) - self.robot.q).max()) / seconds)
        return self._latch(outcome)

    def search_line(self, position, rotation, speed: float):
        """A straight motion of the tip [mm/s] that stops where the input closes: the latched counts, or None."""
        self.robot.new_search()
        return self._line(position, rotation, speed, SEARCH)

    def move_line(self, position, rotation, speed: float) -> None:
        """A straight motion of the tip."""
        self._line(position, rotation, speed, MOVE)

    def _line(self, position, rotation, speed, kind):
        start, R = self.pose(self.counts)
        length = float(np.linalg.norm(position - start))
        turn, q = rotvec(R.T @ rotation), self.robot.q
        span = float(np.abs(self.solve(position, rotation, q) - q).max())
        pieces = max(1, int(np.ceil(length / SEGMENT)), int(np.ceil(span / TURN)))
        for k in range(1, pieces + 1):
            goal = self.solve(start + k / pieces * (position - start), R @ turned(k / pieces * turn), q)
            rate = max(float(np.abs(goal - q).max()) * speed * pieces / max(length, 1e-6), 1e-4)
            if kind == SEARCH and k > 1 and self.robot.arm.closed and not self.robot.health.open:
                return self._late(q, goal, rate)
            outcome = self._run(kind, goal, rate)
            if outcome.kind == CONTACT:
                return self._latch(outcome)
            q = goal
        return None

    def _late(self, q, goal, rate):
        """The contact closed at the end of the piece before: the controller sees it on the way into the next."""
        delay = self.robot.arm.changed + self.robot.truth.effects.relay_delay - self.robot.time
        share = min(1.0, max(delay, 0.0) * rate / float(np.abs(goal - q).max()))
        self._run(MOVE, q + share * (goal - q), rate)
        self.robot.arm.count()
        self.latches.append(self.counts)
        return self.counts

    def _run(self, kind, q, rate):
        outcome = self.robot.begin(kind, q, rate, watch=False)
        while outcome is None:
            outcome = self.robot.advance(self.robot.due)
        assert outcome.kind in (OK, CONTACT, NOCONTACT), outcome
        return outcome

    def _latch(self, outcome):
        if outcome.kind != CONTACT:
            return None
        self.latches.append(self.cell.robot.to_controller(outcome.q))
        return self.latches[-1]

    # the controller's kinematics: those of the drawing, the tip in the jig frame

    def pose(self, counts):
        position, R = self.cell.kinematics.tip(self.q(counts)[None], self.cell.theta)
        return position[0], R[0]

    def solve(self, position, rotation, q):
        """Inverse kinematics near a posture, by Newton's method."""
        for _ in range(30):
            p, R, J = self.cell.kinematics.pose_jacobian(q[None], self.cell.theta)
            error = np.concatenate([position - p[0], rotvec(rotation @ R[0].T)])
            q = q + np.linalg.solve(J[0], error)
            if np.abs(error[:3]).max() < 1e-9 and np.abs(error[3:]).max() < 1e-12:
                return q
        raise AssertionError("the pose is out of reach")


def rotvec(R: np.ndarray) -> np.ndarray:
    """The rotation vector of a small rotation."""
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    sine = float(np.linalg.norm(axis))
    return axis * (np.arctan2(sine, (np.trace(R) - 1) / 2) / sine if sine > 1e-15 else 1.0)


def turned(v: np.ndarray) -> np.ndarray:
    """The rotation by a rotation vector."""
    angle = float(np.linalg.norm(v))
    K = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]]) / max(angle, 1e-15)
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


class RobotClock(Clock):
    """Time that passes as the robot moves."""

    def __init__(self, robot: VirtualRobot) -> None:
        super().__init__()
        self.virtual = robot

    def now(self) -> float:
        return self.virtual.time

    def sleep(self, seconds: float) -> None:
        self.virtual.advance(self.virtual.time + max(seconds, 0.0))

    def stamp(self) -> str:
        return "2026-01-01T00:00:00Z"


class LiveController:
    """The same robot in the hands of the driver, without a line."""

    def __init__(self, robot: ScriptedRobot) -> None:
        self.robot, self.name, self.joints, self.last = robot, "the virtual robot", len(robot.q), 0

    @property
    def sequence(self) -> int:
        return self.last + 1

    def state(self) -> State:
        self.robot.advance(self.robot.time + 0.002)
        return State("A1B2", False, self.robot.contact, self.robot.q, self.last)

    def move(self, q, rate):
        self.last += 1
        outcome = self.robot.move(q, rate)
        if outcome.kind != OK:
            raise Refused(outcome.kind, outcome.text)
        return outcome.q

    def search(self, q, rate):
        self.last += 1
        self.robot.new_search()
        outcome = self.robot.search(q, rate)
        if outcome.kind == CONTACT:
            return Contact(outcome.q, outcome.stop, "A1B2", self.last)
        if outcome.kind == NOCONTACT:
            return NoContact(outcome.q)
        raise Refused(outcome.kind, outcome.text)

    def latch(self):
        return None

    def stop(self) -> None:
        self.robot.halt("STOPPED")

    def close(self) -> None:
        pass
