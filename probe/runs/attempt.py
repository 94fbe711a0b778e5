"""One attempt at one touch, and the way back from wherever it ended: every motion of a run passes here."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from probe.line.clock import Clock
from probe.line.controller import (
    CODES,
    Contact,
    Controller,
    InTheWay,
    NoContact,
    NotReady,
    Rebooted,
    Refused,
    State,
    TouchError,
)
from probe.motion.joint_path import Geometry, Target
from probe.motion.router import Ways
from probe.motion.settings import Settings
from probe.runs.acceptance import objection
from probe.runs.events import Listener, Recovered, Waiting
from probe.runs.records import Intent, Reading
from probe.runs.session import Session

HOPELESS = {"ESTOP", "UNHOMED", "STOPPED"}  # somebody at the robot decided so: no motion follows
FUTILE = {"LIMIT", "SYNTAX"}  # a second attempt would be answered alike
WAYS_BACK = 3  # attempts to go back along an approach
REST = 0.1  # [s] for the contact to settle once the robot rests on it
POLL = 0.05  # [s] between two looks at the touch input

Joints = Float[np.ndarray, " joints"]


@dataclass(frozen=True, eq=False)
class Measured:
    """An attempt that counts."""

    reading: Reading
    fast: Reading | None = None


@dataclass(frozen=True)
class Failed:
    """An attempt that does not count."""

    status: str  # as in touches.csv
    reason: str
    again: bool = True  # whether another attempt may end better


class Motion:
    """The robot in the hands of a run: it knows where it stands, and writes down every motion before it asks for it."""

    def __init__(
        self, controller: Controller, session: Session, settings: Settings, tell: Listener, clock: Clock
    ) -> None:
        self.controller, self.session, self.settings, self.tell, self.clock = controller, session, settings, tell, clock
        self.geometry = Geometry(session.cell, settings)
        self.ways = Ways(self.geometry, [q for i in range(len(session.plan)) for q in session.plan.way(i)])
        self.here: Joints = np.full(controller.joints, np.nan)  # [rad] or [mm]
        self.boot = ""

    def begin(self) -> tuple[bool, Measured | Failed | None]:
        """Look at the controller, and bring a broken run back to its approach.

        Whether the position can be trusted, and what came of a search whose answer nobody heard. Raises TouchError
        and does not move where the input is closed, the machine unhomed, or a restart not agreed to.
        """
        state = self._state()
        if state.moving:
            self.controller.stop()
            state = self._state()
        if not state.homed:
            raise NotReady(f"{CODES['UNHOMED']}; home it, then start again")
        self.boot, self.here = state.boot, state.q
        if self.session.intent is None:
            self._first_look(state)
            return True, None
        known = state.boot == self.session.boot != ""
        if not known and not self.settings.trust_position:
            cause = "has started anew since" if state.boot else "cannot tell whether it has started anew since"
            raise Rebooted(
                f"the controller {cause}: check that it is homed and shows where the robot stands, then go on "
                "with --resume --trust-position"
            )
        picked_up = self._picked_up(state)
        self.retreat()
        return known, picked_up

    def attempt(self, target: Target, name: str, near: Joints | None = None) -> Measured | Failed:
        """Approach, search, retract and verify, once; the robot stands at a safe place afterwards.

        The search begins `near` the contact, where that is given. Raises LinkLost, Rebooted, and TouchError where it
        cannot get there or the input stays closed.
        """
        back = target.approach
        try:
            self._approach(target, name)
            if near is not None:
                self._move(near, name, "move", back, self.settings.near_speed)
                target = self._from(near, target)
            if self.settings.fast_speed is None:
                return self._search(target, name, back)
            quick = self._seek(target, name, "fast", self.settings.fast_speed, back)
            if isinstance(quick, Failed):
                return quick
            fast = self._reading(quick, target, self.settings.fast_speed)
            slow = self._search(self._backed_off(quick, target, name, back), name, back)
            return replace(slow, fast=fast) if isinstance(slow, Measured) else slow
        except Refused as refusal:
            if refusal.code in HOPELESS:
                raise TouchError(f"{refusal}; put that right, then go on with --resume") from None
            self.retreat()
            self.tell(Recovered(str(refusal)))
            status = "early" if refusal.code == "EARLY" else "skipped"
            return Failed(status, str(refusal), refusal.code not in FUTILE)

    def retreat(self) -> None:
        """Go back along the last motion to where it is safe, and out of contact; raises TouchError where it cannot."""
        came_from: Joints | None = None
        for _ in range(WAYS_BACK):
            intent, began = self.session.intent, self._state().q
            if intent is None or self._stands(began, intent):
                break
            if intent.kind == "retract" and self._apart(began, intent.start):
                came_from = intent.start
            try:
                self._move(intent.back, intent.id, "retract", intent.back, self.settings.retract_speed)
                break
            except Refused as refusal:
                if refusal.code in HOPELESS:
                    raise TouchError(f"{refusal}; put that right, then go on with --resume") from None
                if refusal.code == "EARLY":
                    self.here = self._state().q
                    came_from = began if self._apart(self.here, began) else came_from
                    self._lean(came_from, intent)
        else:
            raise TouchError("the robot did not get back to its last approach; move it there by hand, then --resume")
        self._await_open(self.session.intent)

    def _lean(self, origin: Joints | None, intent: Intent) -> None:
        """The wire caught on its way back: only towards where that began is open, until the wire is free."""
        if origin is None:
            return
        nudge = 2 * self.settings.arrived / self.geometry.span(self.here, origin)
        share = 0.5 if self._state().contact else min(nudge, 0.5)
        q = self.here + share * (origin - self.here)
        try:
            self._move(q, intent.id, "retract", intent.back, self.geometry.search_speed)
        except Refused as refusal:
            self.tell(Waiting(str(refusal)))

    def _apart(self, a: Joints, b: Joints) -> bool:
        return self.geometry.span(a, b) > self.settings.arrived

    def _stands(self, q: Joints, intent: Intent) -> bool:
        """Whether the robot needs no way back; raises TouchError where it is not on the way at all."""
        self.here = q
        if not self._apart(q, intent.back):
            return True
        at, off = self.geometry.fraction(q, intent.start, intent.end)
        slack = self.settings.arrived / max(self.geometry.span(intent.start, intent.end), self.settings.arrived)
        if off <= self.settings.arrived and -slack <= at <= 1 + slack:
            return False
        if self.settings.trust_position:
            return True
        raise TouchError(
            "the robot does not stand on its last path: somebody has moved it; bring the tip clear of the jig by hand, "
            "then go on with --resume --trust-position"
        )

    def _first_look(self, state: State) -> None:
        if state.contact:
            raise NotReady("the touch input is closed before the first motion; free the wire, or check the input")
        self.session.trusted(state.boot)
        try:
            self._move(state.q, "", "move", state.q, self.settings.retract_speed)  # nowhere: to see that it obeys
        except Refused as refusal:
            raise NotReady(f"{refusal}; put that right, then start again") from None

    def _picked_up(self, state: State) -> Measured | Failed | None:
        """What came of a search that an earlier run did not finish."""
        search, contact = self.session.search, self.session.contact
        if search is None:
            return None
        if contact is None:
            latch = self.controller.latch()
            if latch is None or (latch.boot, latch.sequence) != (search.boot, search.sequence):
                return Failed("skipped", "nothing was touched")
            contact = Contact(latch.q, state.q, latch.boot, latch.sequence)
            self.session.latched(contact)
        if self.session.intent is search and not state.contact:
            return Failed("skipped", "the contact did not last")
        why_not = objection(contact, search, self.geometry)
        velocity = self.geometry.velocity(search.start, search.end, search.rate)
        return Failed("skipped", why_not) if why_not else Measured(Reading(contact.q, velocity))

    def _approach(self, target: Target, name: str) -> None:
        if self._apart(self.here, target.approach):
            route = self.ways.route(self.here, target.approach, list(target.via))
            if not route:
                raise InTheWay(
                    f"every way to touch '{name}' leads through the jig from where the robot stands; "
                    "jog it above the jig, then go on with --resume --trust-position"
                )
            for q in route:
                self._move(q, name, "move", self.here, self.settings.move_speed)
        self._await_open()

    def _search(self, target: Target, name: str, back: Joints) -> Measured | Failed:
        """The search that counts, and the way back."""
        found = self._seek(target, name, "search", self.geometry.search_speed, back)
        if isinstance(found, Failed):
            return found
        self.retreat()
        return Measured(self._reading(found, target, self.geometry.search_speed))

    def _seek(self, target: Target, name: str, kind: str, speed: float, back: Joints) -> Contact | Failed:
        """Search at a speed [mm/s]; where it ends in a contact that counts, the robot still rests on it."""
        rate = self.geometry.search_rate(target, speed)
        intent = self._intend(kind, name, target.approach, target.end, back, rate)
        found = self.controller.search(target.end, rate)
        if isinstance(found, NoContact):
            self.here = found.q
            self.retreat()
            return Failed("miss", f"nothing met within {target.length:.1f} mm of search")
        self.session.latched(found)
        self.here = found.stop
        why_not = objection(found, intent, self.geometry)
        if not why_not and not self._rests():
            why_not = "the contact did not last until the robot stood still"
        if not why_not:
            return found
        self.retreat()
        return Failed("skipped", why_not)

    def _rests(self) -> bool:
        """Whether the input is closed while the robot rests on the contact; it may bounce at first."""
        until = self.clock.now() + REST
        while not (closed := self._state().contact) and self.clock.now() < until:
            self.clock.sleep(REST / 10)
        return closed

    def _backed_off(self, quick: Contact, target: Target, name: str, back: Joints) -> Target:
        """Stand a little before a contact: where the slow search begins."""
        at, _ = self.geometry.fraction(quick.q, target.approach, target.end)
        at = max(at - self.settings.back_off / target.length, 0.0)
        start = target.approach + at * (target.end - target.approach)
        self._move(start, name, "retract", back, self.settings.retract_speed)
        self._await_open()
        return self._from(start, target)

    def _from(self, start: Joints, target: Target) -> Target:
        """The same search from a later start."""
        return replace(target, approach=start, length=self.geometry.length(start, target.end))

    def _await_open(self, came: Intent | None = None) -> None:
        """Wait for the sensing signal to clear: power sources hold it for 0.3 to 0.5 s.

        Where it does not although the robot `came` back, the approach itself may touch: a little further back, then.
        """
        since = self.clock.now()
        while self._state().contact:
            waited = self.clock.now() - since
            if waited > self.settings.stuck:
                raise TouchError(
                    f"the touch input is still closed {self.settings.stuck:g} s after the wire left the face; "
                    "free or cut the wire, check the input, then go on with --resume"
                )
            if came is not None and waited > self.settings.stuck / 2:
                self._further(came)
                came = None
            self.tell(Waiting("sensing signal clears"))
            self.clock.sleep(POLL)

    def _further(self, came: Intent) -> None:
        """On along the way back, beyond the approach that it led to."""
        origin = came.end if self._apart(came.end, came.back) else came.start
        far = self.geometry.length(origin, came.back) + self.settings.further
        q = self.geometry.beyond(origin, came.back, far)
        try:
            self._move(q, came.id, "retract", q, self.geometry.search_speed)
        except Refused as refusal:
            self.tell(Waiting(str(refusal)))

    def _move(self, q: Joints, name: str, kind: str, back: Joints, speed: float) -> None:
        """Move at a speed of the tip [mm/s]; raises Refused where it does not arrive."""
        rate = self.geometry.move_rate(self.here, q, speed)
        self._intend(kind, name, self.here, q, back, rate)
        self.here = self.controller.move(q, rate)
        if self._apart(self.here, q):
            raise Refused("NOTREACHED", f"off by {np.degrees(self.geometry.span(self.here, q)):.3f} deg")

    def _intend(self, kind: str, name: str, start: Joints, end: Joints, back: Joints, rate: float) -> Intent:
        intent = Intent(kind, name, self.boot, self.controller.sequence, start, end, back, rate)
        self.session.intend(intent)
        return intent

    def _state(self) -> State:
        state = self.controller.state()
        if self.boot not in ("", state.boot):
            raise Rebooted("the controller has started anew; go on with --resume")
        return state

    def _reading(self, contact: Contact, target: Target, speed: float) -> Reading:
        rate = self.geometry.search_rate(target, speed)
        return Reading(contact.q, self.geometry.velocity(target.approach, target.end, rate))
