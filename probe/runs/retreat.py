"""Every single motion of a run, and the way back from wherever one ended."""

import numpy as np
from jaxtyping import Float

from probe.line.clock import Clock
from probe.line.controller import Controller, Rebooted, Refused, State, TouchError
from probe.motion.joint_path import Geometry
from probe.motion.room import Room
from probe.motion.settings import Settings
from probe.runs.events import Listener, Waiting
from probe.runs.records import RETRACTED, Intent, Observation
from probe.runs.session import Session

HOPELESS = {"ESTOP", "UNHOMED", "STOPPED", "ASTRAY"}  # somebody decided so, or the robot does not obey: no motion
WAYS_BACK = 3  # attempts to go back along an approach
POLL = 0.05  # [s] between two looks at the touch input

Joints = Float[np.ndarray, " joints"]


def stop_for_sure(controller: Controller) -> None:
    """Stop the robot, as Ctrl-C asks; a second Ctrl-C does not end the stop before the robot stands."""
    try:
        controller.stop()
    except KeyboardInterrupt:
        controller.stop()


class Retreat:
    """The robot in the hands of a run: it knows where it stands, and writes down every motion before it asks for it."""

    def __init__(
        self, controller: Controller, session: Session, settings: Settings, tell: Listener, clock: Clock
    ) -> None:
        self.controller, self.session, self.settings, self.tell, self.clock = controller, session, settings, tell, clock
        self.geometry = Geometry(session.cell, settings)
        self.room = Room(session.cell, [q for i in range(len(session.plan)) for q in session.plan.way(i)])
        self.here: Joints = np.full(controller.joints, np.nan)  # [rad] or [mm]
        self.trail: list[tuple[Joints, Joints]] = []  # the legs between touches that were driven, the last one last
        self.boot = ""

    def retreat(self) -> None:
        """Go back along the last motion to where it is safe, and out of contact; raises TouchError where it cannot."""
        came_from: Joints | None = None
        for _ in range(WAYS_BACK):
            intent, began = self.session.intent, self._state().q
            if intent is None or self._stands(began, intent):
                break
            if intent.kind == "retract" and self.apart(began, intent.start):
                came_from = intent.start
            try:
                self._move(intent.back, intent.id, "retract", intent.back, self.settings.retract_speed)
                break
            except Refused as refusal:
                if refusal.code in HOPELESS:
                    raise TouchError(f"{refusal}; put that right, then go on with --resume") from None
                if refusal.code == "EARLY":
                    self.here = self._state().q
                    came_from = began if self.apart(self.here, began) else came_from
                    self._lean(came_from, intent)
        else:
            raise TouchError("the robot did not get back to its last approach; move it there by hand, then --resume")
        self._await_open(self.session.intent)
        if self.session.contact is not None:
            self._observe(RETRACTED, self._state())

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

    def apart(self, a: Joints, b: Joints) -> bool:
        """Whether two postures are further from each other than a robot that has arrived stands off its target."""
        return self.geometry.span(a, b) > self.settings.arrived

    def _stands(self, q: Joints, intent: Intent) -> bool:
        """Whether the robot needs no way back; raises TouchError where it is not on the way at all."""
        self.here = q
        if not self.apart(q, intent.back):
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

    def _await_open(self, came: Intent | None = None) -> None:
        """Wait for the sensing signal to clear: power sources hold it for 0.3 to 0.5 s.

        Where it does not although the robot `came` back, the approach itself may touch: a little further back, then.
        """
        since = self.clock.now()
        while self._state().contact:
            waited = self.clock.now() - since
            if waited > self.settings.stuck:
                if self.session.search is not None:
                    self.session.rejected("the touch input was still closed after the retract")
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
        """On along the way back, beyond the approach that it led to, where arm and torch hit nothing there."""
        origin = came.end if self.apart(came.end, came.back) else came.start
        far = self.geometry.length(origin, came.back) + self.settings.further
        q = self.geometry.beyond(origin, came.back, far)
        if self.room.met(np.linspace(self.here, q, 5)):
            return
        try:
            self._move(q, came.id, "retract", q, self.geometry.search_speed)
        except Refused as refusal:
            self.tell(Waiting(str(refusal)))

    def _move(self, q: Joints, name: str, kind: str, back: Joints, speed: float) -> None:
        """Move at a speed of the tip [mm/s]; raises Refused where it does not arrive."""
        rate = self.geometry.move_rate(self.here, q, speed)
        self._intend(kind, name, self.here, q, back, rate)
        self.here = self.controller.move(q, rate)
        if self.apart(self.here, q):
            raise Refused("NOTREACHED", f"off by {np.degrees(self.geometry.span(self.here, q)):.3f} deg")

    def _intend(self, kind: str, name: str, start: Joints, end: Joints, back: Joints, rate: float) -> Intent:
        intent = Intent(kind, name, self.boot, self.controller.sequence, start, end, back, rate)
        self.session.intend(intent)
        return intent

    def _observe(self, place: str, state: State) -> None:
        """Write down how things stand: evidence for or against the touch."""
        self.session.observed(Observation(place, state.boot, state.q, state.contact))

    def _state(self) -> State:
        state = self.controller.state()
        if self.boot not in ("", state.boot):
            raise Rebooted("the controller has started anew; go on with --resume")
        return state
