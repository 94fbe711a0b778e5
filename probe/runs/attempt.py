"""One attempt at one touch, and the way back from wherever it ended: every motion of a run passes here."""

from dataclasses import dataclass, replace

from probe.line.controller import CODES, Contact, InTheWay, NoContact, NotReady, Rebooted, Refused, State, TouchError
from probe.motion.joint_path import Target
from probe.runs.acceptance import objection, unconfirmed
from probe.runs.events import Recovered
from probe.runs.records import APPROACH, CONTACT, RETRACTED, Reading
from probe.runs.retreat import HOPELESS, Joints, Retreat

LEGS = 8  # driven last, that are driven back where no way leads on
FUTILE = {"LIMIT", "SYNTAX"}  # a second attempt would be answered alike


@dataclass(frozen=True, eq=False)
class Success:
    """An attempt that counts."""

    reading: Reading
    fast: Reading | None = None


@dataclass(frozen=True)
class Failure:
    """An attempt that does not count."""

    status: str  # as in touches.csv
    reason: str
    again: bool = True  # whether another attempt may end better


class Motion(Retreat):
    """Attempts at touches, each from its approach to its retract."""

    def begin(self) -> tuple[bool, Success | Failure | None]:
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
        same = state.boot == self.session.boot != ""
        if not same and not self.settings.trust_position:
            cause = "has started anew since" if state.boot else "cannot tell whether it has started anew since"
            raise Rebooted(
                f"the controller {cause}: check that it is homed and shows where the robot stands, then go on "
                "with --resume --trust-position"
            )
        picked_up = self._picked_up(state)
        search = self.session.search
        self.retreat()
        if isinstance(picked_up, Success) and search and (reason := unconfirmed(self.session.evidence, search)):
            picked_up = Failure("skipped", reason)
        return same, picked_up

    def attempt(self, target: Target, name: str, near: Joints | None = None) -> Success | Failure:
        """Approach, search, retract and verify, once; the robot stands at a safe place afterwards.

        The search begins `near` the contact, where that is given. Raises InTheWay, with nothing moved, where no clear
        way leads there; LinkLost, Rebooted, and TouchError where it does not get there or the input stays closed.
        """
        back = target.approach
        if hit := self.room.hits([target.face], target.approach[None], target.contact[None])[0]:
            return Failure("skipped", hit, again=False)
        try:
            self._approach(target, name)
            if near is not None:
                self._move(near, name, "move", back, self.settings.near_speed)
                target = self._from(near, target)
            if self.settings.fast_speed is None:
                return self._search(target, name, back)
            quick = self._seek(target, name, "fast", self.settings.fast_speed, back)
            if isinstance(quick, Failure):
                return quick
            fast = self._reading(quick, target, self.settings.fast_speed)
            slow = self._search(self._backed_off(quick, target, name, back), name, back)
            return replace(slow, fast=fast) if isinstance(slow, Success) else slow
        except Refused as refusal:
            if refusal.code in HOPELESS:
                raise TouchError(f"{refusal}; put that right, then go on with --resume") from None
            self.retreat()
            self.tell(Recovered(str(refusal)))
            status = "early" if refusal.code == "EARLY" else "skipped"
            return Failure(status, str(refusal), refusal.code not in FUTILE)

    def _first_look(self, state: State) -> None:
        if state.contact:
            raise NotReady("the touch input is closed before the first motion; free the wire, or check the input")
        self.session.trusted(state.boot)
        try:
            self._move(state.q, "", "move", state.q, self.settings.retract_speed)  # nowhere: to see that it obeys
        except Refused as refusal:
            raise NotReady(f"{refusal}; put that right, then start again") from None

    def _picked_up(self, state: State) -> Success | Failure | None:
        """What came of a search that an earlier run did not finish."""
        search, contact = self.session.search, self.session.contact
        if search is None:
            return None
        if contact is None:
            latch = self.controller.latch()
            if latch is None or (latch.boot, latch.sequence) != (search.boot, search.sequence):
                return Failure("skipped", "nothing was touched")
            contact = Contact(latch.q, state.q, latch.boot, latch.sequence)
            self.session.latched(contact)
        if self.session.intent is search:
            self._observe(CONTACT, self._settled())
        elif RETRACTED not in self.session.evidence:
            return Failure("skipped", "nobody saw the input open when the wire left the face")
        why_not = objection(contact, search, self.session.evidence, self.geometry)
        velocity = self.geometry.velocity(search.start, search.end, search.rate)
        return Failure("skipped", why_not) if why_not else Success(Reading(contact.q, velocity))

    def _approach(self, target: Target, name: str) -> None:
        if self.apart(self.here, target.approach):
            route = self.room.route(self.here, target.approach, list(target.via)) or self._retraced(target.approach)
            if not route:
                hit = self.room.obstruction(self.here, target.approach, list(target.via))
                raise InTheWay(f"no clear way was found: {hit}")
            for q in route:
                start = self.here
                self._move(q, name, "move", start, self.settings.move_speed)
                self.trail.append((start, q))
        self._await_open()

    def _retraced(self, goal: Joints) -> list[Joints]:
        """Back over the legs last driven, to a place from which a way leads to the goal; empty where there is none.

        A leg that was driven is clear, also where the robot as it is known by now seems to pass too near.
        """
        back: list[Joints] = []
        for start, end in self.trail[: -LEGS - 1 : -1]:
            if self.apart(back[-1] if back else self.here, end):
                break
            back.append(start)
            if route := self.room.route(start, goal):
                return [*back, *route]
        return []

    def _search(self, target: Target, name: str, back: Joints) -> Success | Failure:
        """The search that counts, and the way back."""
        result = self._seek(target, name, "search", self.geometry.search_speed, back)
        if isinstance(result, Failure):
            return result
        intent = self.session.search
        self.retreat()
        if intent and (why_not := unconfirmed(self.session.evidence, intent)):
            return Failure("skipped", why_not)
        return Success(self._reading(result, target, self.geometry.search_speed))

    def _seek(self, target: Target, name: str, kind: str, speed: float, back: Joints) -> Contact | Failure:
        """Search at a speed [mm/s]; where it ends in a contact that counts, the robot still rests on it."""
        rate = self.geometry.search_rate(target, speed)
        self._observe(APPROACH, self._state())
        intent = self._intend(kind, name, target.approach, target.end, back, rate)
        result = self.controller.search(target.end, rate)
        if isinstance(result, NoContact):
            self.here = result.q
            self.retreat()
            return Failure("miss", f"nothing met within {target.length:.1f} mm of search")
        self.session.latched(result)
        self.here = result.stop
        self._observe(CONTACT, self._settled())
        why_not = objection(result, intent, self.session.evidence, self.geometry)
        if not why_not:
            return result
        self.retreat()
        return Failure("skipped", why_not)

    def _settled(self) -> State:
        """The state of a robot that has rested on a contact; the input may bounce at first, a flicker is soon over."""
        for _ in range(2):
            self.clock.sleep(self.settings.rest / 2)
            state = self._state()
            if not state.contact:
                break
        return state

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

    def _reading(self, contact: Contact, target: Target, speed: float) -> Reading:
        rate = self.geometry.search_rate(target, speed)
        return Reading(contact.q, self.geometry.velocity(target.approach, target.end, rate))
