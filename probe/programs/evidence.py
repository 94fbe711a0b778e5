"""Which of the logged touches count: the rules of a live run, as far as a log shows what they ask for."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from identify.model.cell import DEG, Cell
from identify.model.files import InputError, Mistake
from identify.model.touch import HIT, Plan, Touches
from probe.line.controller import Contact as RobotContact
from probe.motion.joint_path import Geometry, Target
from probe.motion.settings import Settings
from probe.programs.log import CLOSED, HELD, MISSED, NOT_MADE, TOUCHED, Entry, Log, stamp
from probe.programs.routine import line_ends
from probe.runs.acceptance import objection, unconfirmed
from probe.runs.prediction import Predictor
from probe.runs.preflight import validate
from probe.runs.records import APPROACH, CONTACT, RETRACTED, Intent, Observation

OFF_LINE, TURNED = 2.0, 1.0 * DEG  # [mm], [rad] of a tip from a straight line: controller and model differ a little


@dataclass(frozen=True)
class Imported:
    """Rows of touches.csv, and the touches of the plan that no log tells of."""

    touches: Touches
    missing: tuple[str, ...]


def imported(
    logs: Sequence[Log],
    plan: Plan,
    cell: Cell,
    maker: str,
    *,
    straight: bool,
    temperature: float | None = None,
    note: str = "",
) -> Imported:
    """The touches of a plan that programs of a maker logged; where two logs tell of one, the later log counts.

    A touch counts if the program saw the input open before, closed at rest and open after the retract, if the latched
    joints lie on the search (`straight`: on the line of the tip), the overtravel fits the speed, and no earlier touches
    contradict it. Raises InputError for logs of another plan or program.
    """
    entries = _entries(logs, plan, cell, maker)
    settings = Settings(search_speed=logs[0].speed)
    targets = validate(plan, cell, settings)
    geometry = Geometry(cell, settings)
    if straight:
        ends = line_ends(cell, targets, geometry)
        targets = [
            replace(t, end=end, length=geometry.length(t.approach, end)) for t, end in zip(targets, ends, strict=True)
        ]
    judge = _Judge(geometry, straight)
    rows = [
        (i, entries[i + 1], *judge.status(targets[i], entries[i + 1])) for i in range(len(plan)) if i + 1 in entries
    ]
    numbers = [i for i, *_ in rows]
    q = [entry.latch if status in (HIT, "outlier") else targets[i].approach for i, entry, status, _ in rows]
    none = np.full(len(rows), np.nan)
    touches = Touches(
        ids=tuple(plan.ids[i] for i in numbers),
        face=tuple(plan.face[i] for i in numbers),
        q=np.array(q).reshape(-1, plan.q.shape[1]),
        normal=np.full((len(rows), 3), np.nan),
        offset=none,
        sigma=none,
        status=tuple(status for _, _, status, _ in rows),
        temperature=none if temperature is None else np.full(len(rows), temperature),
        time=("",) * len(rows),
        note=tuple("; ".join(filter(None, (reason, note))) for *_, reason in rows),
        approach=plan.approach[numbers],
    )
    return Imported(touches, tuple(name for i, name in enumerate(plan.ids) if i + 1 not in entries))


def _entries(logs: Sequence[Log], plan: Plan, cell: Cell, maker: str) -> dict[int, Entry]:
    """What was made, by number; raises InputError where a log is not of this plan."""
    own, mistakes = stamp(plan, cell.robot, maker), []
    entries: dict[int, Entry] = {}
    for log in logs:
        if log.stamp != own:
            text = f"it is the log of another plan (stamp {log.stamp}, expected {own}); name its plan with --plan"
            mistakes.append(Mistake(log.file, 0, text))
        elif log.first + log.count - 1 > len(plan):
            text = f"it tells of touches up to {log.first + log.count - 1}, the plan has {len(plan)}"
            mistakes.append(Mistake(log.file, 0, f"{text}; name the plan that the program was written from"))
        elif log.speed != logs[0].speed:
            text = f"its search speed is {log.speed:g} mm/s, that of {logs[0].file} {logs[0].speed:g}"
            mistakes.append(Mistake(log.file, 0, f"{text}; import them one by one"))
        mistakes += [
            Mistake(
                log.file, e.line, f"touch {e.number} has code {e.code}, expected {NOT_MADE} to {HELD}; save it again"
            )
            for e in log.entries
            if not NOT_MADE <= e.code <= HELD
        ]
        mistakes += [
            Mistake(log.file, e.line, f"touch {e.number} has a contact but no joints; save all files of one run")
            for e in log.entries
            if e.code == TOUCHED and not np.isfinite([e.latch, e.rest]).all()
        ]
        entries |= {entry.number: entry for entry in log.entries if entry.code != NOT_MADE}
    if mistakes:
        raise InputError(mistakes)
    return entries


def _observations(code: int, target: Target, rest: np.ndarray) -> dict[str, Observation]:
    """What a program saw of the input, as the driver notes it; its exact stop says that it stood at the approach."""
    return {
        APPROACH: Observation(APPROACH, "", target.approach, code == CLOSED),
        CONTACT: Observation(CONTACT, "", rest, code in (TOUCHED, HELD)),
        RETRACTED: Observation(RETRACTED, "", target.approach, code == HELD),
    }


class _Judge:
    """Judges touches in their order, and learns from those that count."""

    def __init__(self, geometry: Geometry, straight: bool) -> None:
        self.geometry, self.straight, self.predictor = geometry, straight, Predictor(geometry.cell)

    def status(self, target: Target, entry: Entry) -> tuple[str, str]:
        """Status and note of a touch, as in touches.csv."""
        if entry.code == MISSED:
            return "miss", f"nothing met within {target.length:.1f} mm of search"
        rate = self.geometry.search_rate(target, self.geometry.search_speed)
        intent = Intent("search", target.id, "", 0, target.approach, target.end, target.approach, rate)
        met = entry.code != CLOSED  # without a search there is no latch
        latches = (entry.latch, entry.rest) if met else (target.approach, target.approach)
        (latch, off), (rest, _) = (self._on_search(target, q) for q in latches)
        observations = _observations(entry.code, target, rest)
        contact = RobotContact(latch, rest, "", 0)
        if (
            why_not := off
            or objection(contact, intent, observations, self.geometry)
            or unconfirmed(observations, intent)
        ):
            return "skipped", why_not
        surprise = self.predictor.judge(entry.latch, target.face)
        if surprise.beyond(self.geometry.settings.disagreement):
            return "outlier", f"{surprise.difference:+.2f} mm from the prediction"
        self.predictor.learn(entry.latch, target.face)
        return HIT, ""

    def _on_search(self, target: Target, q: np.ndarray) -> tuple[np.ndarray, str]:
        """Joints at the same share of the line in joint space, and why the tip is off the straight line of search."""
        if not self.straight or np.isnan(q).any():
            return q, ""
        cell = self.geometry.cell
        tips, R = cell.kinematics.tip(np.stack([target.approach, target.end, q]), cell.theta)
        way, gone = tips[1] - tips[0], tips[2] - tips[0]
        share = float(gone @ way / (way @ way))
        off = float(np.linalg.norm(gone - share * way))
        turned = float(np.arccos(np.clip((np.trace(R[0].T @ R[2]) - 1) / 2, -1, 1)))
        reason = ""
        if off > OFF_LINE or turned > TURNED:
            reason = f"the tip lies {off:.2f} mm off the line of search, turned by {np.degrees(turned):.2f} deg"
        return target.approach + share * (target.end - target.approach), reason
