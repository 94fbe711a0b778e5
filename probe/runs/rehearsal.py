"""A dry run: every approach of a plan at a safe distance, and no touch."""

from identify.model.cell import Cell
from identify.model.touch import Plan
from probe.line.clock import Clock
from probe.line.controller import Controller, NotReady, Refused, TouchError
from probe.motion.joint_path import Geometry, Joints, Target
from probe.motion.room import Room
from probe.motion.settings import Settings
from probe.runs.events import Finished, Listener, Started, Touching, ignore
from probe.runs.preflight import validate


def rehearse(
    plan: Plan,
    controller: Controller,
    cell: Cell,
    settings: Settings = Settings(),  # noqa: B008, frozen
    *,
    tell: Listener = ignore,
    clock: Clock | None = None,
) -> Finished:
    """Visit the approach of every touch, further off its face by `settings.dry_distance`; nothing is written.

    Raises InputError where something speaks against the plan, TouchError where something is touched or goes wrong: the
    robot is then back where that move began, or stands still.
    """
    clock = clock or Clock()
    began = clock.robot()
    targets = validate(plan, cell, settings, controller.joints)
    geometry = Geometry(cell, settings)
    here = _ready(controller)
    places = [geometry.beyond(t.contact, t.approach, _far(t, geometry)) for t in targets]
    room = Room(cell, [q for t, place in zip(targets, places, strict=True) for q in (*t.via, place)])
    tell(Started(len(targets), 0, controller.name))
    for target, place in zip(targets, places, strict=True):
        tell(Touching(target.id, target.face.name, 1))
        route = room.route(here, place, list(target.via))
        if not route:
            hit = room.obstruction(here, place, list(target.via))
            raise TouchError(f"no clear way to touch '{target.id}' was found: {hit}; jog the robot above the jig first")
        for q in route:
            here = _move(controller, geometry, here, q, target)
    finished = Finished(0, len(targets), clock.robot() - began)
    tell(finished)
    return finished


def _far(target: Target, geometry: Geometry) -> float:
    """How far from its contact a touch is rehearsed [mm of the tip's way]."""
    return geometry.length(target.contact, target.approach) + geometry.settings.dry_distance


def _move(controller: Controller, geometry: Geometry, here: Joints, q: Joints, target: Target) -> Joints:
    """One move; back to where it began where something is touched."""
    try:
        return controller.move(q, geometry.move_rate(here, q, geometry.settings.move_speed))
    except KeyboardInterrupt:
        controller.stop()
        raise
    except Refused as refusal:
        if refusal.code == "EARLY":
            controller.move(here, geometry.move_rate(q, here, geometry.settings.retract_speed))
        raise TouchError(f"on the way to touch '{target.id}': {refusal}") from None


def _ready(controller: Controller) -> Joints:
    state = controller.state()
    if state.moving:
        raise NotReady("the robot is moving; wait until it stands")
    if not state.homed:
        raise NotReady("the machine is not homed; home it, then start again")
    if state.contact:
        raise NotReady("the touch input is closed before the first motion; free the wire, or check the input")
    return state.q
