"""What a program does for each touch of a plan: the legs to its approach, and the search."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.frames import rotation
from identify.model.ik import reach
from identify.model.touch import Plan
from probe.motion.joint_path import Geometry, Target
from probe.programs.log import JOINTS
from probe.programs.options import Options
from probe.runs.preflight import validate

SHORTER = np.linspace(1.0, 0.5, 11)  # of the search, where a joint limit ends the straight line before
SLOWEST = 0.01  # of the joint speed, on a move

Joints = Float[np.ndarray, " joints"]


@dataclass(frozen=True, eq=False)
class Leg:
    """One joint motion to a posture."""

    q: Joints  # [rad]
    share: float  # of the largest joint speed, 0 ... 1
    speed: float  # [rad/s] of the fastest joint


@dataclass(frozen=True, eq=False)
class Routine:
    """One touch: the legs to its approach, and the search from there."""

    number: int  # of the touch in the plan, from 1
    id: str
    face: str
    legs: tuple[Leg, ...]  # the last ends at the approach
    back: Leg  # to the approach again
    start: Joints  # [rad], where the search begins
    end: Joints  # [rad], where it ends without a contact
    along: Float[np.ndarray, " 3"]  # [mm], from start to end in the robot's base frame
    length: float  # [mm] of the tip's way
    seconds: float  # of the search


def routines(plan: Plan, cell: Cell, options: Options, *, straight: bool) -> list[Routine]:
    """The touches of a plan; with `straight` the tip searches along a line, else all joints move in proportion.

    Raises InputError with everything that speaks against the plan. In a rehearsal each approach lies further off its
    face, and no search is made.
    """
    settings = options.settings(cell)
    if len(cell.robot.joints) != JOINTS or any(cell.robot.prismatic):
        raise InputError(
            f"robot '{cell.robot.name}' has {len(cell.robot.joints)} joints, expected {JOINTS} revolute ones: programs "
            "for tracks, positioners and other arms are not written yet"
        )
    targets = validate(plan, cell, settings)
    geometry = Geometry(cell, settings)
    ends = line_ends(cell, targets, geometry) if straight else [target.end for target in targets]
    return [_routine(i, targets[i], ends[i], geometry, options) for i in range(len(targets))]


def line_ends(cell: Cell, targets: Sequence[Target], geometry: Geometry) -> list[Joints]:
    """Where searches along a straight line end: on through the contact, the wire's direction as at the approach.

    Shorter where a joint limit comes first; raises InputError where the contact is not on the way.
    """
    start, contact = (np.stack([getattr(t, name) for t in targets]) for name in ("approach", "contact"))
    position, R = cell.kinematics.tip(start, cell.theta)
    way = geometry.tip(contact) - position
    near = np.linalg.norm(way, axis=1)
    travel = np.array([geometry.length(t.approach, t.end) for t in targets])
    ends, found = start.copy(), np.zeros(len(targets), dtype=bool)
    for share in SHORTER:
        rest = np.flatnonzero(~found)
        goal = position[rest] + (share * travel / near)[rest, None] * way[rest]
        reached = reach(cell.kinematics, cell.theta, goal, R[rest], start[rest])
        good = reached.reached() & (np.abs(reached.q - start[rest]).max(axis=1) < 1.0)
        good &= share * travel[rest] > near[rest]
        ends[rest[good]], found[rest[good]] = reached.q[good], True
        if found.all():
            return list(ends)
    name = targets[int(np.argmin(found))].id
    raise InputError(f"touch '{name}': the tip cannot go straight on from the approach to the face; plan it again")


def line_point(cell: Cell, start: Joints, end: Joints, shares: Float[np.ndarray, " shares"]) -> np.ndarray:
    """Joints [rad] at shares of a straight line of the tip, which keeps its orientation."""
    position, R = cell.kinematics.tip(np.stack([start, end]), cell.theta)
    goal = position[0] + shares[:, None] * (position[1] - position[0])
    guess = start + shares[:, None] * (end - start)
    return reach(cell.kinematics, cell.theta, goal, np.repeat(R[:1], len(shares), axis=0), guess).q


def _routine(i: int, target: Target, end: Joints, geometry: Geometry, options: Options) -> Routine:
    cell = geometry.cell
    approach = target.approach
    if options.rehearsal:
        far = geometry.length(target.contact, approach) + geometry.settings.dry_distance
        approach = geometry.beyond(target.contact, approach, far)
    stops = [*target.via, approach]
    legs = [
        _leg(start, q, geometry, geometry.settings.move_speed) for start, q in zip([None, *stops], stops, strict=False)
    ]
    tips = geometry.tip(np.stack([target.approach, end]))
    base_R_jig = rotation(*(np.zeros(3) if cell.base is None else cell.base[3:])).T
    length = geometry.length(target.approach, end)
    back = _leg(end, approach, geometry, geometry.settings.retract_speed)
    return Routine(
        i + 1,
        target.id,
        target.face.name,
        tuple(legs),
        back,
        target.approach,
        end,
        base_R_jig @ (tips[1] - tips[0]),
        length,
        length / geometry.search_speed,
    )


def _leg(start: Joints | None, q: Joints, geometry: Geometry, speed: float) -> Leg:
    """A joint motion at a speed of the tip [mm/s]; from anywhere where the start is not known."""
    robot = geometry.cell.robot
    if start is None or not (step := np.abs(q - start)).any():
        return Leg(q, SLOWEST, SLOWEST * float(robot.speed.max()))
    rate = geometry.move_rate(start, q, speed)
    share = rate / geometry.span(start, q) * float((step / robot.speed).max())
    return Leg(q, float(np.clip(share, SLOWEST, 1.0)), rate)
