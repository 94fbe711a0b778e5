"""What a program does for each touch of a plan: the legs to its approach, and the search."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from identify.model.cell import DEG, Cell
from identify.model.files import InputError
from identify.model.frames import rotation
from identify.model.ik import reach
from identify.model.touch import Plan
from probe.motion.joint_path import Geometry, Target
from probe.motion.room import Room
from probe.programs.log import JOINTS
from probe.programs.options import Options
from probe.runs.preflight import validate
from probe.runs.rehearsal import retreats, route_back

INSIDE = 0.002 * DEG  # [rad] of the joint limits: a pulse of the coarsest joint
SHORTER = np.linspace(1.0, 0.5, 11)  # of the search, where a joint limit ends the straight line before
NEARER = 0.5  # [mm] that two approaches may differ
SLOWEST, FASTEST = 0.01, 0.3  # of the joint speeds, on a move: an operator stands beside it

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
    further: float  # [mm] of the tip's way that the last leg ends before the approach, in a rehearsal
    seconds: float  # of the search


def routines(plan: Plan, cell: Cell, options: Options, *, straight: bool) -> list[Routine]:
    """The touches of a plan; with `straight` the tip searches along a line, else all joints move in proportion.

    Raises InputError with everything that speaks against the plan. In a rehearsal each approach lies further off its
    face, and no search is made.
    """
    settings = options.settings(cell)
    _check_joints(cell)
    targets = validate(plan, cell, settings)
    geometry = Geometry(cell, settings)
    ends = line_ends(cell, targets, geometry) if straight else [target.end for target in targets]
    ends = [_inside(end, cell) for end in ends]
    room = Room(cell, [q for target in targets for q in (*target.via, target.approach)])
    places = retreats(targets, geometry, room) if options.rehearsal else [target.approach for target in targets]
    out, here, last = list[Routine](), None, None
    for target, place, end in zip(targets, places, ends, strict=True):
        out.append(_routine(len(out) + 1, target, end, _route(here, place, target, last, room), geometry))
        here, last = place, target
    return out


def _check_joints(cell: Cell) -> None:
    """Raise InputError where a robot is not one of six turning joints, which all these languages move alike."""
    slides, joints = cell.robot.prismatic, len(cell.robot.joints)
    if joints == JOINTS and not any(slides):
        return
    cure = "make the touches over a line, with touchcal run"
    if joints == JOINTS + 1 and slides[0] and not any(slides[1:]):
        cure = (
            "hold the track still and describe the arm behind it (touchcal init --base-link, its carriage), or " + cure
        )
    raise InputError(
        f"robot '{cell.robot.name}' has {joints} joints ({cell.robot.kinds}), and programs move {JOINTS} that turn: "
        f"{cure}"
    )


def near_approaches(touches: Sequence[Routine]) -> tuple[str, ...]:
    """What to say of a rehearsal in which some approaches are nearer to their faces than others."""
    usual = max(touch.further for touch in touches)
    near = [f"{touch.id} ({touch.further:.0f} mm)" for touch in touches if touch.further < usual - NEARER]
    if not near:
        return ()
    return (
        f"{len(near)} of {len(touches)} approaches are rehearsed from less than {usual:.0f} mm further off, because "
        f"more is not clear or a joint limit comes first: {', '.join(near)}",
    )


def line_ends(cell: Cell, targets: Sequence[Target], geometry: Geometry) -> list[Joints]:
    """Where searches along a straight line end: on through the contact, the wire's direction as at the approach.

    Shorter where a joint limit comes first; raises InputError where the contact is not on the way.
    """
    start, contact = (np.stack([getattr(t, name) for t in targets]) for name in ("approach", "contact"))
    position, R = cell.kinematics.tip(start, cell.theta)
    way = geometry.tip(contact) - position
    near = np.linalg.norm(way, axis=1)
    travel = np.array([geometry.length(t.approach, t.end) for t in targets])
    ends, straight_on = start.copy(), np.zeros(len(targets), dtype=bool)
    for share in SHORTER:
        rest = np.flatnonzero(~straight_on)
        goal = position[rest] + (share * travel / near)[rest, None] * way[rest]
        reached = reach(cell.kinematics, cell.theta, goal, R[rest], start[rest])
        good = reached.reached() & (np.abs(reached.q - start[rest]).max(axis=1) < 1.0)
        good &= share * travel[rest] > near[rest]
        ends[rest[good]], straight_on[rest[good]] = reached.q[good], True
        if straight_on.all():
            return list(ends)
    name = targets[int(np.argmin(straight_on))].id
    raise InputError(f"touch '{name}': the tip cannot go straight on from the approach to the face; plan it again")


def _inside(q: Joints, cell: Cell) -> Joints:
    """Joints that stay within their limits when they are rounded."""
    return np.clip(q, cell.robot.lower + INSIDE, cell.robot.upper - INSIDE)


def _route(here: Joints | None, place: Joints, target: Target, last: Target | None, room: Room) -> list[Joints | None]:
    """The postures to an approach, as a live run goes there; the first is where the robot stands."""
    if here is None or last is None:
        return [None, *target.via, place]
    if route := room.route(here, place, [*target.via]) or route_back(room, here, place, target, last):
        return [here, *route]
    hit = room.obstruction(here, place, list(target.via))
    raise InputError(f"no clear way to touch '{target.id}' was found: {hit}; plan the order again")


def _routine(number: int, target: Target, end: Joints, route: list[Joints | None], geometry: Geometry) -> Routine:
    cell = geometry.cell
    legs = tuple(
        _leg(a, _inside(b, cell), geometry, geometry.settings.move_speed) for a, b in pairwise(route) if b is not None
    )
    tips = geometry.tip(np.stack([target.approach, end]))
    base_R_jig = rotation(*(np.zeros(3) if cell.base is None else cell.base[3:])).T
    length = geometry.length(target.approach, end)
    return Routine(
        number=number,
        id=target.id,
        face=target.face.name,
        legs=legs,
        back=_leg(end, legs[-1].q, geometry, geometry.settings.retract_speed),
        start=target.approach,
        end=end,
        along=base_R_jig @ (tips[1] - tips[0]),
        length=length,
        further=geometry.length(target.approach, legs[-1].q),
        seconds=length / geometry.search_speed,
    )


def _leg(start: Joints | None, q: Joints, geometry: Geometry, speed: float) -> Leg:
    """A joint motion at a speed of the tip [mm/s]; from anywhere where the start is not known."""
    robot = geometry.cell.robot
    if start is None or not (step := np.abs(q - start)).any():
        return Leg(q, SLOWEST, SLOWEST * float(robot.speed.max()))
    rate = geometry.move_rate(start, q, speed)
    share = rate / geometry.span(start, q) * float((step / robot.speed).max())
    usable = float(np.clip(share, SLOWEST, FASTEST))
    return Leg(q, usable, rate * usable / share)
