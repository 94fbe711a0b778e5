"""A dry run: every approach of a plan at a safe distance, and no touch."""

from collections.abc import Sequence

import numpy as np

from identify.model.cell import Cell
from identify.model.touch import Plan
from probe.line.clock import Clock
from probe.line.controller import Controller, NotReady, Refused, TouchError
from probe.motion.joint_path import Geometry, Joints, Target
from probe.motion.room import Room
from probe.motion.settings import Settings
from probe.runs.events import Finished, Listener, Started, Touching, ignore
from probe.runs.preflight import validate
from probe.runs.retreat import stop_for_sure

SHARES = 0.25, 0.5, 0.75, 1.0  # of the distance by which an approach is rehearsed further off


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
    room, last = Room(cell, [q for t in targets for q in (*t.via, t.approach)]), None
    places = retreats(targets, geometry, room)
    tell(Started(len(targets), 0, controller.name))
    for target, place in zip(targets, places, strict=True):
        tell(Touching(target.id, target.face.name, 1))
        route = room.route(here, place, [*target.via])
        if not route and last:
            route = route_back(room, here, place, target, last)
        if not route:
            hit = room.obstruction(here, place, list(target.via))
            raise TouchError(f"no clear way to touch '{target.id}' was found: {hit}; jog the robot above the jig first")
        for q in route:
            here = _move(controller, geometry, here, q, target)
        last = target
    finished = Finished(0, len(targets), clock.robot() - began)
    tell(finished)
    return finished


def retreats(targets: Sequence[Target], geometry: Geometry, room: Room) -> list[Joints]:
    """Where touches are rehearsed: further off than their approaches, as far as the way back to them is clear.

    At most `settings.dry_distance` of the tip's way; shorter where a joint limit comes first.
    """
    places = [target.approach for target in targets]
    for share in SHARES:
        further = share * geometry.settings.dry_distance
        far = [
            geometry.beyond(t.contact, t.approach, geometry.length(t.contact, t.approach) + further) for t in targets
        ]
        clear = room.clear([np.stack([t.approach, q]) for t, q in zip(targets, far, strict=True)])
        places = [q if ok else place for q, ok, place in zip(far, clear, places, strict=True)]
    return places


def route_back(room: Room, here: Joints, place: Joints, target: Target, last: Target) -> list[Joints]:
    """Postures of a live run from the last approach to that of a target, and on to its place; empty if not clear."""
    return room.route(here, place, [last.approach, *target.via, target.approach])


def _move(controller: Controller, geometry: Geometry, here: Joints, q: Joints, target: Target) -> Joints:
    """One move; back to where it began where something is touched."""
    try:
        return controller.move(q, geometry.move_rate(here, q, geometry.settings.move_speed))
    except KeyboardInterrupt:
        stop_for_sure(controller)
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
