"""The whole plan, checked before the first motion: every reason not to start, at once."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from identify.model.cell import Cell
from identify.model.files import InputError, Mistake
from identify.model.touch import Plan
from probe.motion.joint_path import Geometry, Target
from probe.motion.room import Room
from probe.motion.settings import Settings

CLEARANCE = 5.0  # [mm], the least distance of an approach point from its face
ELSEWHERE = 100.0  # [mm], more than any tolerance of robot and set-up together: another robot, or another cell


def validate(plan: Plan, cell: Cell, settings: Settings, joints: int | None = None) -> list[Target]:
    """The targets of a plan; raises InputError with everything that speaks against making them.

    `joints` is what the controller says it has.
    """
    mistakes = [Mistake("settings", 0, text) for text in _settings(settings)]
    joints_of_robot, columns = len(cell.robot.joints), plan.q.shape[1]
    if columns != joints_of_robot:
        mistakes.append(
            Mistake("plan", 0, f"it is for {columns} joints, the robot '{cell.robot.name}' has {joints_of_robot}")
        )
    if joints not in (None, joints_of_robot):
        mistakes.append(
            Mistake("controller", 0, f"it moves {joints} joints, the robot '{cell.robot.name}' has {joints_of_robot}")
        )
    faces = {} if cell.jig is None else cell.jig.by_name
    mistakes += [Mistake("plan", 0, cell.unknown_face(face)) for face in dict.fromkeys(plan.face) if face not in faces]
    if mistakes or cell.jig is None:
        raise InputError(mistakes or "the cell has no jig to touch; name one in cell.yaml (jig: library:step-block)")
    geometry = Geometry(cell, settings)
    mistakes = [Mistake("plan", 0, text) for text in _elsewhere(plan, geometry)]
    mistakes = mistakes or [Mistake("plan", 0, text) for i in range(len(plan)) for text in _joints(plan, i, cell)]
    if mistakes:
        raise InputError(mistakes)
    targets = [geometry.target(plan, i, cell.jig) for i in range(len(plan))]
    mistakes = [
        Mistake("plan", 0, f"touch '{target.id}': {text}")
        for i, target in enumerate(targets)
        for text in _touch(plan, i, target, geometry)
    ]
    mistakes += [Mistake("plan", 0, text) for text in _moves(plan, targets, cell)]
    if mistakes:
        raise InputError(mistakes)
    return targets


def _settings(settings: Settings) -> Iterator[str]:
    if not 0 < settings.override <= 1:
        yield f"speed override is {settings.override:g}, expected more than 0 and at most 1"
    for name in ("move_speed", "retract_speed", "search_speed", "fast_speed", "back_off"):
        value = getattr(settings, name)
        if value is not None and not value > 0:
            yield f"{name} is {value:g}, expected more than 0"
    if settings.retries < 0 or settings.misses < 1:
        yield f"{settings.retries} retries and a stop after {settings.misses} misses, expected at least 0 and 1"


def _elsewhere(plan: Plan, geometry: Geometry) -> Iterator[str]:
    """A plan for another robot, in one sentence for all of its touches."""
    if geometry.cell.base is None or geometry.cell.tool is None:
        return
    away = np.linalg.norm(geometry.tip(plan.q) - plan.point, axis=1)
    if far := int(np.sum(away > ELSEWHERE)):
        yield (
            f"the model puts the tip up to {away.max():.0f} mm from the point to touch, {far} times in {len(plan)} "
            "touches; is the plan for another robot or cell?"
        )


def _joints(plan: Plan, i: int, cell: Cell) -> Iterator[str]:
    """Joint limits at approach and contact, and on the way there."""
    robot = cell.robot
    via = [("the way", q) for q in plan.way(i)[:-1]]
    for what, q in (*via, ("approach", plan.approach[i]), ("contact", plan.q[i])):
        for k in np.flatnonzero((q < robot.lower - 1e-9) | (q > robot.upper + 1e-9)).tolist():
            unit, sign = (1.0, "mm") if robot.prismatic[k] else (np.pi / 180, "deg")
            yield (
                f"touch '{plan.ids[i]}': {what} has joint {robot.joints[k].name} at {q[k] / unit:.3f} {sign}, expected "
                f"{robot.lower[k] / unit:g} to {robot.upper[k] / unit:g}; plan again with the limits of this robot"
            )


def _touch(plan: Plan, i: int, target: Target, geometry: Geometry) -> Iterator[str]:
    """One touch against the model of the cell."""
    cell = geometry.cell
    if np.abs(plan.normal[i] - target.face.normal).max() > 1e-4:
        yield f"its normal is not that of face '{target.face.name}'; is the plan for another jig?"
    contact, approach = geometry.tip(np.stack([target.contact, target.approach]))
    clear = float(target.face.normal @ (approach - contact))
    if clear < CLEARANCE:
        yield f"the approach lies {clear:.1f} mm before the face, expected at least {CLEARANCE:g}; plan again"
    way, end = geometry.length(target.approach, target.contact), geometry.length(target.approach, target.end)
    if way > cell.touch.travel:
        yield f"the contact is {way:.1f} mm from the approach, further than travel_mm: {cell.touch.travel:g}"
    elif end < way - 1e-6:
        yield "the search cannot reach its contact within the joint limits; plan again"
    fastest = max(geometry.search_speed, geometry.settings.fast_speed or 0.0)
    speeds = np.abs(target.end - target.approach) * fastest / max(target.length, 1e-9)
    for k in np.flatnonzero(speeds > cell.robot.speed).tolist():
        yield (
            f"searching at {fastest:g} mm/s asks {speeds[k] / cell.robot.speed[k]:.1f} times the speed of joint "
            f"{cell.robot.joints[k].name}; search slower"
        )


def _moves(plan: Plan, targets: list[Target], cell: Cell) -> Iterator[str]:
    """Arm, torch and wire must not hit anything: not at a touch, and not between two, as planned or round about."""
    room = Room(cell, [q for i in range(len(plan)) for q in plan.way(i)])
    met = room.hits([target.face for target in targets], plan.approach, plan.q)
    for target, hit in zip(targets, met, strict=True):
        if hit:
            yield f"touch '{target.id}' cannot be made: {hit}; plan again, or leave it out"
    legs = [np.vstack([a.approach, b.via, b.approach]) for a, b in pairwise(targets)]
    standing = [f"touch '{t.id}': {hit}" for t in targets for hit in room.met(np.vstack([t.via, t.approach]))]
    yield from (f"{hit}; plan again, or leave it out" for hit in standing)
    if any(met) or standing or not legs:
        return
    clear = room.clear(legs)
    for (a, b), free in zip(pairwise(targets), clear, strict=True):
        if not free and not room.route(a.approach, b.approach, list(b.via)):
            hit = room.obstruction(a.approach, b.approach, list(b.via))
            yield f"no clear way was found from touch '{a.id}' to touch '{b.id}': {hit}; plan the order again"
