"""Measurements other than touches that can be made: postures within reach and view that are clear, a table a kind."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.frames import euler
from identify.model.ik import reach
from identify.model.measurement import MEASUREMENTS, Measurements
from identify.model.touch import Contacts, Distances, Poses, Positions
from identify.model.zone import cone, frames, zone_of
from oed.candidates.sight import IN_SIGHT, sight, unseen_note
from probe.motion.clearance import CLEAR, WIRE, Clearance

VIEW = 300.0  # [mm] around zone and jig, where a tracker sees the tip if the cell does not say
ROUNDS = 40  # of drawing postures, before those that were found have to do
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Postures:
    """Postures for measurements of one kind, and the point of the cell that each names."""

    q: Float[np.ndarray, "postures joints"]  # [rad] or [mm]
    point: Int[np.ndarray, " postures"]  # place in the points of the cell; -1 for none
    placement: tuple[str, ...] | None = None
    tool: tuple[str, ...] | None = None

    def take(self, index: Int[np.ndarray, " some"]) -> "Postures":
        """Some of them."""
        names = (each and tuple(each[i] for i in index) for each in (self.placement, self.tool))
        return Postures(self.q[index], self.point[index], *names)

    def and_those(self, other: "Postures") -> "Postures":
        """These and others of the same cell."""
        names = (a and b and a + b for a, b in ((self.placement, other.placement), (self.tool, other.tool)))
        return Postures(np.concatenate([self.q, other.q]), np.concatenate([self.point, other.point]), *names)


def planned_cell(cell: Cell) -> tuple[Cell, tuple[str, ...]]:
    """The cell without frames and points that are to be fitted, which no plan can aim at, and a sentence about them."""
    parts = {"placements": cell.placements, "tools": cell.tools}
    placed: dict[str, dict[str, object]] = {
        key: {name: frame for name, frame in frames_.items() if frame is not None} for key, frames_ in parts.items()
    }
    points = {name: point for name, point in cell.points.items() if point.position is not None}
    left_out = [name for key, frames_ in parts.items() for name in frames_ if name not in placed[key]]
    left_out += [name for name in cell.points if name not in points]
    spacings = tuple(s for s in cell.spacings if {s.start, s.end} <= points.keys())
    notes = (f"not planned, since their place is to be fitted: {', '.join(left_out)}; write about where they are",)
    some = replace(cell, points=points, spacings=spacings, **placed)  # type: ignore[arg-type]
    return some, notes if left_out else ()


def measurements(
    cell: Cell,
    kind: str,
    rng: np.random.Generator,
    count: int,
    *,
    theta: Float[np.ndarray, " parameters"] | None = None,
    clearance: Clearance | None = None,
) -> tuple[Measurements, tuple[str, ...]]:
    """Measurements of a kind that can be made, `count` of them where there are so many, and what a tracker cannot see.

    They read what the robot `theta` (nominal) would give. Further placements and tools of the cell are used as often
    as the first. Raises InputError if the cell lacks what the kind needs, or no posture is clear and in sight.
    """
    if kind not in POSTURES:
        raise InputError(f"measurements of kind '{kind}' cannot be planned; choose of touch, {', '.join(POSTURES)}")
    theta = cell.theta if theta is None else theta
    clearance = Clearance(cell, theta) if clearance is None else clearance
    draw, table = POSTURES[kind]
    whole, reasons = Postures(np.empty((0, len(cell.robot.joints))), np.empty(0, dtype=int)), np.empty(0, dtype=int)
    for _ in range(ROUNDS):
        clear = _clear(draw(cell, theta, rng, max(200, count)), kind, clearance)
        views = sight(cell, kind, clearance, clear.q, clear.placement, clear.tool)
        reasons = np.append(reasons, views)
        visible = clear.take(np.flatnonzero(views == IN_SIGHT))
        whole = whole.and_those(visible) if len(whole.q) else visible
        if len(whole.q) >= count:
            break
    note = unseen_note(cell.device(kind), kind, reasons)
    if not len(whole.q):
        why = note or "no posture within reach and view is clear of jig and arm"
        raise InputError(f"no {kind} can be measured: {why}")
    return table(cell, theta, whole.take(np.arange(min(len(whole.q), count)))), (note,) if note else ()


def _clear(postures: Postures, kind: str, clearance: Clearance) -> Postures:
    """Postures in which nothing meets jig or arm, but for a tip that sits in a socket."""
    clear = postures.take(np.flatnonzero(clearance.hits(postures.q) == CLEAR))
    if kind == "contact":
        return clear
    return clear.take(np.flatnonzero(clearance.segment_gaps(*clearance.wire(clear.q), WIRE) >= WIRE))


def free(cell: Cell, theta: np.ndarray, rng: np.random.Generator, count: int, kind: str = "position") -> Postures:
    """Any posture whose tip is within view."""
    robot, box = cell.robot, _view(cell, kind)
    q = rng.uniform(robot.lower, robot.upper, (20 * count, len(robot.joints)))
    tip = cell.kinematics.tip(q, theta)[0]
    q = q[((tip >= box[:, 0]) & (tip <= box[:, 1])).all(axis=1)]
    return Postures(q, np.full(len(q), -1), *_names(cell, len(q), rng))


def _view(cell: Cell, kind: str) -> Float[np.ndarray, "3 2"]:
    """Where a tracker sees the tip [mm]: the box of the device, or that around zone and jig."""
    box = cell.device(kind).box
    if box is not None:
        return box
    ends = zone_of(cell).box.T if cell.jig is None else np.concatenate([zone_of(cell).box.T, cell.jig.corners])
    return np.stack([ends.min(axis=0) - VIEW * np.array([1, 1, 0]), ends.max(axis=0) + VIEW], axis=1)


def _around(cell: Cell, theta: np.ndarray, rng: np.random.Generator, count: int) -> Postures:
    """Postures with the tip at a distance from a point, the line between them within a cone about the vertical."""
    device, number = cell.device("distance"), rng.integers(len(_points(cell, "distance")), size=count)
    middle = np.tile(UP, (count, 1))
    tip = _points(cell, "distance")[number] + rng.uniform(*device.range, (count, 1)) * cone(
        middle, device.max_tilt, rng.random((count, 2))
    )
    return _at(cell, theta, rng, tip, number, cell.touch.max_tilt)


def _in(cell: Cell, theta: np.ndarray, rng: np.random.Generator, count: int) -> Postures:
    """Postures with the tip in a point, the tool within a cone about the vertical."""
    points = _points(cell, "contact")
    number = rng.integers(len(points), size=count)
    return _at(cell, theta, rng, points[number], number, cell.device("contact").max_tilt)


def _points(cell: Cell, kind: str) -> Float[np.ndarray, "points 3"]:
    if not cell.points:
        raise InputError(f"a plan of kind {kind} needs {MEASUREMENTS[kind].needs}; write about where each stands")
    return np.array(list(cell.places.values()))


def _at(
    cell: Cell, theta: np.ndarray, rng: np.random.Generator, tip: np.ndarray, number: np.ndarray, tilt: float
) -> Postures:
    """Postures with the tip at places, the tool within a cone about straight down, any branch."""
    robot, m = cell.robot, len(tip)
    axis = cone(np.tile(-UP, (m, 1)), tilt, rng.random((m, 2)))
    start = rng.uniform(robot.lower, robot.upper, (m, len(robot.joints)))
    turned, joints = frames(axis, 2 * np.pi * rng.random(m)), len(robot.joints)
    solved = reach(cell.kinematics, theta, tip, turned, start, free_roll=joints == 5, free_orientation=joints < 5)
    return Postures(solved.q, number).take(solved.reached())


def _names(cell: Cell, count: int, rng: np.random.Generator) -> tuple[tuple[str, ...] | None, tuple[str, ...] | None]:
    """A placement and a tool of each measurement, the first ones and the further ones alike; None without further."""

    def drawn(further: Sequence[str]) -> tuple[str, ...] | None:
        return tuple(rng.choice(["", *further], count).tolist()) if further else None

    return drawn(list(cell.placements)), drawn(list(cell.tools))


def _ids(postures: Postures) -> tuple[str, ...]:
    return tuple(str(i + 1) for i in range(len(postures.q)))


def _tips(cell: Cell, theta: np.ndarray, at: Postures) -> tuple[np.ndarray, np.ndarray]:
    """Tips [mm] and rotations of postures with placements and tools of their own."""
    each = np.tile(theta, (len(at.q), 1))
    for names, poses, part in ((at.placement, cell.placements, slice(0, 6)), (at.tool, cell.tools, slice(-6, None))):
        for i, name in enumerate(names or ()):
            if name:
                each[i, part] = poses[name]
    tip, R = cell.kinematics.tip(at.q, each)
    return tip, R


def _position_table(cell: Cell, theta: np.ndarray, at: Postures) -> Measurements:
    tip = _tips(cell, theta, at)[0]
    return Positions(_ids(at), at.q, tip, np.full(len(tip), cell.sigma("position")), at.placement, at.tool)


def _pose_table(cell: Cell, theta: np.ndarray, at: Postures) -> Measurements:
    tip, R = _tips(cell, theta, at)
    sigma, turn = np.full(len(tip), cell.sigma("pose")), np.full(len(tip), cell.device("pose").turn_sigma)
    return Poses(_ids(at), at.q, tip, euler(R), sigma, turn, at.placement, at.tool)


def _distance_table(cell: Cell, theta: np.ndarray, at: Postures) -> Measurements:
    names, places = list(cell.points), np.array(list(cell.places.values()))
    distance = np.linalg.norm(cell.kinematics.tip(at.q, theta)[0] - places[at.point], axis=1)
    anchor = tuple(names[i] for i in at.point)
    return Distances(_ids(at), at.q, anchor, distance, np.full(len(distance), cell.sigma("distance")))


def _contact_table(cell: Cell, theta: np.ndarray, at: Postures) -> Measurements:
    names = list(cell.points)
    return Contacts(_ids(at), at.q, tuple(names[i] for i in at.point), np.full(len(at.q), cell.sigma("contact")))


Draw = Callable[[Cell, np.ndarray, np.random.Generator, int], Postures]
MakeTable = Callable[[Cell, np.ndarray, Postures], Measurements]
POSTURES: dict[str, tuple[Draw, MakeTable]] = {
    "position": (free, _position_table),
    "pose": (partial(free, kind="pose"), _pose_table),
    "distance": (_around, _distance_table),
    "contact": (_in, _contact_table),
}
"""How postures of each kind are drawn, and the table that they make."""
