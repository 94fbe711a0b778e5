"""All touches of a plan at once, without time and without a port: for studies, campaigns and tests."""

import numpy as np
from jaxtyping import Bool, Float

from identify.model.cell import Cell
from identify.model.touch import HIT, Plan, Touches
from probe.virtual.contact import INTERVAL, NO_FACE, Paths, first_contact
from probe.virtual.surfaces import surfaces
from probe.virtual.truth import Truth


def search_end(cell: Cell, plan: Plan) -> Float[np.ndarray, "touches joints"]:
    """Where searches end that meet nothing: on through the contact point, `touch.travel` from the approach.

    Beyond the joint limits the search ends at the limit.
    """
    reach = cell.touch.travel / cell.touch.approach
    step = plan.q - plan.approach
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(step > 0, cell.robot.upper - plan.approach, cell.robot.lower - plan.approach) / step
    room = np.where(step == 0, np.inf, room)
    return plan.approach + np.clip(room.min(axis=1), 0, reach)[:, None] * step


def touch_batch(
    cell: Cell,
    truth: Truth,
    plan: Plan,
    rng: np.random.Generator,
    *,
    sigma: float | None = None,
    timing: bool = False,
    blind: bool = False,
) -> Touches:
    """What a robot measures that is truly `truth`, when it makes the touches of a plan one after the other.

    Each touch searches along the straight line in joint space from the approach through the planned point and on to
    `search_end`, and stops at the first thing it meets. Contacts scatter by `sigma` [mm] along the normal (default:
    the truth's, else the cell's `touch.sigma`); joint noise and backlash of the truth act too. With `timing`, the
    latch is late by the relay delay and falls on a servo step. Status: hit where the planned face was met; early where
    the wire touched at the approach already; miss elsewhere, with the note saying what was met. With `blind`, whatever
    is met is a hit: a controller cannot tell.
    """
    if cell.jig is None:
        raise ValueError("touches need a jig; name one in cell.yaml (jig: library:step-block)")
    effects, count = truth.effects, len(plan)
    if sigma is None:
        sigma = cell.touch.sigma if effects.sigma is None else effects.sigma
    surface = surfaces(cell.the_jig, cell.wire, dict(truth.faces), cell.obstacles)
    end = search_end(cell, plan)
    shift = sigma * rng.standard_normal(count)
    paths = _true_paths(cell, truth, plan.approach, end, rng)
    intervals = int(np.ceil(1.25 * cell.touch.travel / INTERVAL))
    fraction, met, early = first_contact(truth.kinematics(cell), surface, paths, shift, intervals)
    latch = np.where(early, 0.0, fraction)
    if timing:
        latch = np.where(early, 0.0, _late(cell, truth, paths, fraction, rng))
    hits = (met != NO_FACE) & (latch < 1) & ~early
    latch = np.where(hits | early, latch, 1.0)
    q = plan.approach + latch[:, None] * (end - plan.approach)
    return _touches(
        cell, truth, plan, q, np.array([*surface.names, ""])[np.where(hits, met, NO_FACE)], hits, early, blind
    )


def joint_spread(cell: Cell, by_kind: tuple[float, float]) -> Float[np.ndarray, " joints"]:
    """One value a joint from the pair for sliding [mm] and turning [rad] joints."""
    return np.where(cell.robot.prismatic, *by_kind)


def _true_paths(cell: Cell, truth: Truth, start: np.ndarray, end: np.ndarray, rng: np.random.Generator) -> Paths:
    """The paths of the arm behind encoders, noise and gears; the approach came from the same side as the search."""
    noise = joint_spread(cell, truth.effects.joint_noise)
    play = joint_spread(cell, truth.effects.backlash) / 2
    off = noise * rng.standard_normal(start.shape) if noise.any() else np.zeros_like(start)
    geared = start + off - np.sign(end - start) * play if play.any() else None
    changes = np.unique([touch for touch, _ in truth.effects.wire])
    if truth.effects.warming:
        changes = np.arange(1, len(start))
    stage = np.searchsorted(changes, np.arange(len(start)), side="right")
    theta = np.array([truth.after(0), *(truth.after(int(touch)) for touch in changes)])[stage]
    return Paths(start + off, end + off, theta, geared, play)


def _late(
    cell: Cell, truth: Truth, paths: Paths, fraction: np.ndarray, rng: np.random.Generator
) -> Float[np.ndarray, " touches"]:
    """Fractions at the latch: the relay's delay after the contact, and then the next servo step."""
    at = np.where(np.isfinite(fraction), fraction, 0.5)
    rows, small = np.arange(len(at)), 1e-4
    before, after = (paths.tips(truth.kinematics(cell), rows, at + d)[0] for d in (-small, small))
    per_fraction = np.linalg.norm(after - before, axis=1) / (2 * small)  # [mm] of tip for the whole path
    wait = truth.effects.relay_delay + truth.effects.servo * rng.uniform(size=len(at))
    return fraction + wait * cell.touch.speed / np.maximum(per_fraction, 1e-9)


def _touches(
    cell: Cell,
    truth: Truth,
    plan: Plan,
    q: Float[np.ndarray, "touches joints"],
    met: np.ndarray,
    hits: Bool[np.ndarray, " touches"],
    early: Bool[np.ndarray, " touches"],
    blind: bool,
) -> Touches:
    faces = cell.the_jig.by_name
    aim = np.array(plan.face)
    names, where = np.unique(aim, return_inverse=True)
    sides = [faces[name] for name in names]
    hit = hits & (blind | (met == aim))
    note = np.where(hits, np.char.add("touched ", met), f"no contact within {cell.touch.travel:g} mm")
    note = np.where(early, "in contact at the approach", np.where(hit, "", note))
    return Touches(
        ids=plan.ids,
        face=plan.face,
        q=q,
        normal=np.array([f.normal for f in sides]).reshape(-1, 3)[where],
        offset=np.array([f.offset for f in sides])[where],
        sigma=np.full(len(plan), cell.touch.sigma),
        status=tuple(np.where(early, "early", np.where(hit, HIT, "miss")).tolist()),
        temperature=truth.temperature(np.arange(len(plan))),
        time=("",) * len(plan),
        note=tuple(note.tolist()),
        approach=plan.approach,
    )
