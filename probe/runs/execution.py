"""The run of a plan: which touch comes next, which counts, which is made again, and when to stop."""

from collections.abc import Iterable

import numpy as np

from identify.model.touch import HIT, Plan
from probe.line.clock import Clock
from probe.line.controller import Controller, InTheWay, TouchError
from probe.motion.joint_path import Joints, Target
from probe.motion.settings import Settings
from probe.runs.attempt import Failure, Motion, Success
from probe.runs.events import Drifted, Finished, Listener, Retried, Started, Touched, Touching, ignore
from probe.runs.prediction import Predictor, Surprise
from probe.runs.preflight import validate
from probe.runs.records import AGAIN, Reading, Result
from probe.runs.retreat import stop_for_sure
from probe.runs.session import Session

USUAL = Settings()
TWICE = ", twice"  # the note of a touch that was repeated at once, and found again
WORTH = 5.0  # [mm] of a search that a motion of its own may save


def run(
    plan: Plan,
    controller: Controller,
    session: Session,
    settings: Settings = USUAL,
    *,
    tell: Listener = ignore,
    clock: Clock | None = None,
) -> Finished:
    """Make the touches of a plan that the session does not have yet.

    Touches to which no clear way leads come last; where none leads there then either, they are skipped.
    Raises InputError before the first motion where something speaks against the plan; TouchError where the touches
    cannot go on, InTheWay where the robot cannot get away from where it stands. After each of them, and after
    KeyboardInterrupt, the same call with the same session goes on where it stopped. KeyboardInterrupt stops the robot;
    `retreat` then brings it back to its last approach.
    """
    execution = Execution(plan, controller, session, settings, tell, clock or Clock())
    try:
        return execution.all()
    except KeyboardInterrupt:
        stop_for_sure(controller)
        raise


def retreat(
    controller: Controller, session: Session, settings: Settings = USUAL, *, clock: Clock | None = None
) -> None:
    """Bring the robot back along its last motion, out of contact; raises TouchError where it is not on its way."""
    Motion(controller, session, settings, ignore, clock or Clock()).retreat()


class Execution:
    """One run of a plan."""

    def __init__(
        self, plan: Plan, controller: Controller, session: Session, settings: Settings, tell: Listener, clock: Clock
    ) -> None:
        self.targets = validate(plan, session.cell, settings, controller.joints)
        self.controller, self.session, self.settings, self.tell, self.clock = controller, session, settings, tell, clock
        self.motion = Motion(controller, session, settings, tell, clock)
        self.predictor = Predictor(session.cell)
        self._by_id = {target.id: target for target in self.targets}
        self._start, self._made, self._missed = clock.robot(), 0, 0

    def all(self) -> Finished:
        """Everything, from the first look at the controller to the last touch."""
        for hit in self.session.hits():
            self._learn(hit.reading, self._of(hit.id))
        self.tell(Started(len(self.targets), self._done(), self.controller.name))
        self._begin()
        self._touch_all()
        while self._take_back():
            self._touch_all()
        results = [self.session.results[name] for name in self._by_id]
        skipped = {result.id: result.note for result in results if result.status == "skipped"}
        hits = sum(result.status == HIT for result in results)
        finished = Finished(hits, len(self.targets), self.clock.robot() - self._start, skipped)
        self.tell(finished)
        return finished

    def _touch_all(self) -> None:
        """Every touch without a result; those without a clear way come last, and are skipped if there is none then."""
        blocked, rest = dict[str, str](), [t for t in self.targets if t.id not in self.session.results]
        while len(blocked) < len(rest):
            rest = [target for target in rest if target.id not in self.session.results]
            blocked = {target.id: reason for target in rest if (reason := self._make(target))}
        if blocked and self._is_enclosed():
            name, reason = next(iter(blocked.items()))
            raise InTheWay(
                f"touch '{name}': {reason}; no clear way leads from where the robot stands to any of the "
                f"{len(blocked)} touches left; jog it above the jig, then go on with --resume --trust-position"
            )
        for name, reason in blocked.items():
            self._record(name, "skipped", self._standing(), None, 0, reason)

    def _make(self, target: Target) -> str:
        """Make a touch, or say why no clear way leads to it: nothing has moved then."""
        try:
            self._count(self._touch(target, target.id))
            self._look_for_drift()
        except InTheWay as error:
            return str(error)
        return ""

    def _is_enclosed(self) -> bool:
        """Whether no way leads from where the robot stands to any other place where it has touched."""
        hits = self.session.hits()
        elsewhere = [hit for hit in hits if self.motion.apart(self.motion.here, self._of(hit.id).approach)]
        return not hits or (len(elsewhere) > 0 and self._known(elsewhere) is None)

    def _take_back(self) -> bool:
        """Take back the touches that all others speak against, each once; whether there were any.

        What is far from the fit of all touches is judged by a fit that leaves it out: a wrong touch bends its own fit.
        """
        hits, floor = self.session.hits(), self.settings.disagreement
        doubtful = 0
        for hit in hits:
            if hit.id not in self._by_id or hit.id in self.session.doubted or TWICE in hit.note:
                continue
            if abs(self._judge(Success(hit.reading), self._of(hit.id)).difference) < floor / 2:
                continue
            others = Predictor(self.session.cell)
            for other in hits:
                if other.id != hit.id:
                    others.learn(other.reading.q, self._of(other.id).face)
            surprise = others.judge(hit.reading.q, self._of(hit.id).face)
            if surprise.beyond(floor):
                reason = f"{surprise.difference:+.2f} mm from what the other touches predict"
                self.session.doubt(hit.id, reason)
                self.tell(Retried(hit.id, 1, reason))
                doubtful += 1
        if doubtful:
            self.predictor = Predictor(self.session.cell)
            for hit in self.session.hits():
                self._learn(hit.reading, self._of(hit.id))
        return doubtful > 0

    def _begin(self) -> None:
        """See that the controller is ready, and bring a broken run to its end."""
        trusted, readings = self.motion.begin()
        search = self.session.search
        if search is not None and readings is not None:
            self._pick_up(search.id, readings)
        if not trusted:
            self._confirm_position()
            self.session.trusted(self.motion.boot)

    def _pick_up(self, name: str, result: Success | Failure) -> None:
        """Take the touch whose search was made, but whose row was never written."""
        if isinstance(result, Success) and name not in self.session.results:
            surprise = self._judge(result, self._of(name))
            if not surprise.beyond(self.settings.disagreement):
                self._record(name, HIT, result, surprise, 1, "picked up after an interruption")
                return
            result = Failure("outlier", "far from the prediction")
        self.session.rejected(result.reason if isinstance(result, Failure) else "made before")

    def _confirm_position(self) -> None:
        """After a restart, touch a known point again: the position must mean what it meant before."""
        if not self.session.hits():
            return
        before = self._known(reversed(self.session.hits()))
        if before is None:
            raise TouchError("no known point can be reached from here without passing the jig; jog the robot above it")
        target = self._of(before.id)
        result = self.motion.attempt(target, before.id)
        if isinstance(result, Failure):
            raise TouchError(f"touch '{before.id}' could not be repeated after the restart: {result.reason}")
        self.session.rejected("made to confirm the position")
        change = self._change(before.reading, result.reading, target)
        self.tell(Drifted(before.id, change))
        if abs(change) > self.settings.agreement:
            raise TouchError(
                f"touch '{before.id}' lies {change:+.2f} mm from where it was before the restart, expected within "
                f"{self.settings.agreement:g} mm: the position has moved; home the robot, or begin a new session"
            )

    def _touch(self, target: Target, name: str) -> Result:
        """One point, as often as it takes within bounds; its row is written in any case."""
        suspects = list[Success]()
        attempt, failure = 0, Failure("skipped", "")
        while failure.again and attempt <= self.settings.retries and (failure.status, attempt) != ("early", 2):
            attempt += 1
            self.tell(Touching(name, target.face.name, attempt))
            result = self.motion.attempt(target, name, self._near(target) if attempt == 1 else None)
            if isinstance(result, Success):
                surprise = self._judge(result, target)
                twin = any(self._alike(result, other, target) for other in suspects)
                if twin or not surprise.beyond(self.settings.disagreement):
                    note = f"{surprise.difference:+.2f} mm from the prediction{TWICE}" if twin else ""
                    return self._record(name, HIT, result, surprise, attempt, note)
                suspects.append(result)
                result = Failure("outlier", f"{surprise.difference:+.2f} mm from the prediction")
            failure = result
            self.session.rejected(failure.reason)
            self.tell(Retried(name, attempt, failure.reason))
        last = suspects[-1] if failure.status == "outlier" else self._standing()
        return self._record(name, failure.status, last, None, attempt, failure.reason)

    def _standing(self) -> Success:
        """Where the robot stands, for a touch that measured nothing."""
        return Success(Reading(self.motion.here, 0 * self.motion.here))

    def _record(
        self, name: str, status: str, reading: Success, surprise: Surprise | None, attempts: int, note: str
    ) -> Result:
        """Write the row, learn from it, and tell."""
        target, settings = self._of(name), self.settings
        temperature = np.nan if settings.temperature is None else settings.temperature
        words = "; ".join(filter(None, (note, settings.note)))
        result = Result(
            name, target.face.name, status, reading.reading, reading.fast, self.clock.stamp(), temperature, words
        )
        self.session.finish(result)
        if status == HIT:
            self._learn(reading.reading, target)
        self._made += 1
        seconds = (len(self.targets) - self._done()) * (self.clock.robot() - self._start) / self._made
        judged = surprise or Surprise(np.nan, np.nan, np.nan)
        self.tell(
            Touched(
                name,
                target.face.name,
                status,
                judged.residual,
                judged.difference,
                judged.expected,
                attempts,
                words,
                self._done(),
                len(self.targets),
                seconds,
            )
        )
        return result

    def _count(self, result: Result) -> None:
        """Stop where one touch after the other fails: something is not where the cell says."""
        self._missed = 0 if result.status in (HIT, "outlier") else self._missed + 1
        if self._missed >= self.settings.misses:
            raise TouchError(
                f"{self._missed} touches in a row failed, the last ({result.id}) because: {result.note}; are jig, base "
                "and wire where cell.yaml says? then go on with --resume"
            )

    def _look_for_drift(self) -> None:
        """Every so many touches, touch the first known point again that is in reach."""
        every, hits = self.settings.again_every, [hit for hit in self.session.hits() if AGAIN not in hit.id]
        first = self._known(hits) if every and hits and len(hits) % every == 0 else None
        if first is None:
            return
        number = 2 + sum(name.startswith(first.id + AGAIN) for name in self.session.results)
        again = self._touch(self._of(first.id), f"{first.id}{AGAIN}{number}")
        if again.status == HIT:
            self.tell(Drifted(again.id, self._change(first.reading, again.reading, self._of(first.id))))

    def _known(self, hits: Iterable[Result]) -> Result | None:
        """The first of some touches to which there is a way."""
        return next((hit for hit in hits if self.motion.room.route(self.motion.here, self._of(hit.id).approach)), None)

    def _learn(self, reading: Reading, target: Target) -> None:
        self.predictor.learn(reading.q, target.face)
        self.motion.room.believe(self.predictor.theta, self.predictor.covariance)

    def _near(self, target: Target) -> Joints | None:
        """How far the robot may go before it searches, by what is known; nothing where that is not worth a motion."""
        fraction, sigma = self.predictor.first_contact(target.approach, target.end, target.face)
        tips = self.motion.geometry.tip(np.stack([target.approach, target.end]))
        depth = float(target.face.normal @ (tips[0] - tips[1]))  # [mm] of the whole search, along the normal
        fraction -= (self.settings.sure * sigma + self.settings.disagreement + self.settings.near) / max(depth, 1e-9)
        worth = fraction * target.length > WORTH
        return target.approach + fraction * (target.end - target.approach) if worth else None

    def _judge(self, reading: Success, target: Target) -> Surprise:
        return self.predictor.judge(reading.reading.q, target.face)

    def _alike(self, a: Success, b: Success, target: Target) -> bool:
        return abs(self._change(a.reading, b.reading, target)) < self.settings.agreement

    def _change(self, before: Reading, after: Reading, target: Target) -> float:
        """How far a contact moved along the normal of its face [mm]."""
        tips = self.motion.geometry.tip(np.stack([before.q, after.q]))
        return float(target.face.normal @ (tips[1] - tips[0]))

    def _of(self, name: str) -> Target:
        """The target of a touch, or of its repetition."""
        return self._by_id[name] if name in self._by_id else self._by_id[name.rpartition(AGAIN)[0]]

    def _done(self) -> int:
        return sum(name in self.session.results for name in self._by_id)
