"""The virtual robot: it moves in time, meets the jig where its true geometry says, and knows nothing of any port.

Encoders read what is commanded; the arm behind them is off by the play of the gears and by joint noise, drawn anew for
each motion that begins in the open. A contact trips the relay after its delay, at the next servo step; a search latches
the encoders then, and every motion brakes. All times are controller time in seconds.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from identify.model.base_placement import parked
from identify.model.cell import Cell
from probe.virtual.arm import Arm, Trip
from probe.virtual.collision import Collision
from probe.virtual.motion import Profile, straight
from probe.virtual.records import CONTACT, MOVE, NEVER, NOCONTACT, OK, SEARCH, Executed, Health, Outcome, Truly
from probe.virtual.truth import Truth

BACK = np.radians(0.05)  # a retreat may miss the line that it came along by that much
SETTLED = 0.05  # [s] open before a move watches for contact again: the chatter of an opening contact is no touch


@dataclass(eq=False)
class _Motion:
    kind: str
    target: Float[np.ndarray, " joints"]
    rate: float
    profile: Profile
    start: Float[np.ndarray, " joints"]
    trip: Trip
    watch: bool  # whether the controller looks at the contact
    code: str = ""  # why it ends early
    text: str = ""
    tripped: float = NEVER  # [s], the servo step at which the controller sees the contact
    latch: Float[np.ndarray, " joints"] | None = None  # where it saw the contact

    @property
    def collides(self) -> float:
        """When arm or torch hit something; never, where the motion ends before."""
        return NEVER if self.trip.collision is None else self.profile.time(self.trip.collision.fraction)

    def at(self, time: float) -> Float[np.ndarray, " joints"]:
        return self.start + self.profile.at(time)[0] * (self.target - self.start)


@dataclass
class VirtualRobot:
    """A robot before a jig; `start` is where it stands, jogged above the jig where not given."""

    cell: Cell
    truth: Truth
    rng: np.random.Generator
    start: Float[np.ndarray, " joints"] | None = None
    time: float = 0.0
    health: Health = field(default_factory=Health)
    executed: list[Executed] = field(default_factory=list)
    touches: list[Truly] = field(default_factory=list)
    collisions: list[Collision] = field(default_factory=list)  # of arm and torch, each of which stopped the robot

    def __post_init__(self) -> None:
        robot = self.cell.robot
        at = parked(self.cell) if self.start is None else np.asarray(self.start, dtype=float)
        if at.shape != (len(robot.joints),) or not np.isfinite(at).all():
            raise ValueError(f"the robot stands at {at.tolist()}, expected {len(robot.joints)} finite joint values")
        self._q = np.clip(at, robot.lower, robot.upper)
        self._zero = np.zeros_like(self._q)  # what the encoders read in the true zero position
        self._motion: _Motion | None = None
        self._retreat: np.ndarray | None = None  # where an EARLY move began
        self.begun = 0  # motions
        self.arm = Arm(self.cell, self.truth, self.rng, self._q)

    @property
    def q(self) -> Float[np.ndarray, " joints"]:
        """What the encoders read now [rad] or [mm]."""
        return (self._q if self._motion is None else self._motion.at(self.time)) - self._zero

    @property
    def moving(self) -> bool:
        """Whether a motion runs."""
        return self._motion is not None

    @property
    def kind(self) -> str:
        """MOVE or SEARCH while a motion runs, else nothing."""
        return "" if self._motion is None else self._motion.kind

    @property
    def expected(self) -> tuple[float, float]:
        """When the running motion began, and when it will trip or end [s]."""
        motion = self._motion
        if motion is None:
            return self.time, self.time
        return motion.profile.pieces[0].start, min(motion.tripped, motion.profile.end)

    @property
    def due(self) -> float:
        """When something happens next by itself [s]."""
        if self._motion is None:
            return NEVER
        return min(self._motion.tripped, self._motion.collides, self._motion.profile.end)

    @property
    def contact(self) -> bool:
        """Whether the touch input reads closed now; just after a change it chatters."""
        if self.health.stuck or self.health.open:
            return self.health.stuck
        motion, arm = self._motion, self.arm
        closed, since = (arm.closed, arm.changed) if motion is None else motion.trip.state(motion.profile, self.time)
        bouncing = 0 <= self.time - since < self._bounce
        step = int(self.time / self.truth.effects.servo)
        return bool((step * 2654435761 >> 16) & 1) if bouncing else closed

    @property
    def _bounce(self) -> float:
        return self.truth.effects.bounce if self.health.bounce is None else self.health.bounce

    def refusal(self, kind: str, q: Float[np.ndarray, " joints"], rate: float) -> Outcome | None:
        """Why a motion cannot begin, or nothing."""
        robot, names = self.cell.robot, [joint.name for joint in self.cell.robot.joints]
        outside = np.flatnonzero((q < robot.lower) | (q > robot.upper))
        if self.health.estop:
            return self._refused("ESTOP", "the emergency stop is pressed")
        if not self.health.homed:
            return self._refused("UNHOMED", "home the machine")
        if not (np.isfinite(q).all() and np.isfinite(rate) and rate > 0):
            return self._refused("SYNTAX", "joints and rate are finite, the rate is above 0")
        if len(outside):
            return self._refused("LIMIT", f"{names[outside[0]]} would leave its limits")
        if kind == SEARCH and self.contact:
            return self._refused("ALREADY", "the wire touches before the search")
        if self._retreat is not None and (kind == SEARCH or not self._leads_back(q + self._zero)):
            return self._refused("EARLY", "only back towards where the move began")
        return None

    def _refused(self, code: str, text: str) -> Outcome:
        return Outcome(code, self.q, self.q, text)

    def _leads_back(self, q: np.ndarray) -> bool:
        """Whether a target lies on the line from here to where the EARLY move began."""
        assert self._retreat is not None
        unit = self.cell.robot.joint_unit()
        line, step = (self._retreat - self._q) / unit, (q - self._q) / unit
        along = np.clip(step @ line / max(line @ line, 1e-18), 0, 1)
        return bool(np.abs(step - along * line).max() < np.degrees(BACK) and along > 0)

    def begin(self, kind: str, q: Float[np.ndarray, " joints"], rate: float, *, watch: bool = True) -> Outcome | None:
        """Begin a motion to `q` at `rate` [rad/s] of the fastest joint; the refusal where it cannot begin.

        A controller that does not `watch` its input drives a MOVE on into whatever it touches. Nobody watches the way
        back after an EARLY one: it leads out again past whatever was met, and may graze it.
        """
        if self._motion is not None:
            return self._refused("BUSY", "a motion is running")
        refusal = self.refusal(kind, q, rate)
        if refusal is not None:
            return refusal
        target = q + self._zero
        profile = straight(self.cell.robot, self._q, target, rate, self.time)
        trip = self.arm.follow(self._q, target)
        watched = kind == SEARCH or (watch and self._retreat is None)
        self._motion = _Motion(kind, target, rate, profile, self._q, trip, watched)
        self.begun += 1
        self.foresee()
        return None

    def foresee(self) -> None:
        """When the controller will see the contact: after the relay's delay, at a servo step; again after a mishap."""
        motion, effects = self._motion, self.truth.effects
        if motion is None:
            return
        if not motion.watch or self.health.open or (motion.kind == MOVE and self.health.stuck):
            motion.tripped = NEVER
            return
        met = motion.trip.contact(motion.profile, SETTLED if motion.kind == MOVE else 0.0)
        time = NEVER if met is None else motion.profile.time(met.enter)
        began = motion.profile.pieces[0].start  # on a servo step, as commands are
        steps = np.ceil((time + effects.relay_delay - began) / effects.servo - 1e-9) if np.isfinite(time) else NEVER
        motion.tripped = max(began + float(steps * effects.servo), time)

    def obstruct(self, fraction: float) -> None:
        """Something conducting stands at a fraction of the motion that has begun, until the robot has backed off."""
        if self._motion is not None and not self.health.open:
            self._motion.trip = self.arm.obstruct(self._motion.trip, fraction)
            self.foresee()

    def stop(self, code: str, text: str = "") -> None:
        """Brake the motion that runs, if any, and end it with a code."""
        motion = self._motion
        if motion is not None and not motion.code:
            motion.code, motion.text = code, text
            motion.profile = motion.profile.stopped(self.time)
            if motion.tripped > self.time:
                self.foresee()

    def halt(self, code: str, text: str = "") -> None:
        """Stop, and let the time pass that braking takes."""
        self.stop(code, text)
        while self._motion is not None:
            self.advance(self.due)

    def advance(self, time: float) -> Outcome | None:
        """Let time pass; how the motion ended, when it did."""
        while self._motion is not None and self.due <= time:
            motion = self._motion
            self.time = max(self.time, self.due)
            if motion.collides <= min(motion.tripped, motion.profile.end):
                self._collide(motion)
            elif motion.tripped <= motion.profile.end:
                self._trip(motion)
            else:
                return self._finish(motion, time)
        self.time = max(self.time, time)
        return None

    def _collide(self, motion: _Motion) -> None:
        """Arm or torch hit something: the drives trip, and only a person goes on from there."""
        collision = motion.trip.collision
        assert collision is not None, "a collision is foreseen"
        self.collisions.append(collision)
        motion.trip, motion.tripped = replace(motion.trip, collision=None), NEVER
        motion.code, motion.text, self.health.estop = "ESTOP", str(collision), True
        motion.profile = motion.profile.stopped(self.time)

    def _trip(self, motion: _Motion) -> None:
        """The controller sees the contact: a search latches, a move ends EARLY, both brake."""
        signal, motion.tripped = motion.tripped, NEVER
        if motion.kind == SEARCH:
            motion.latch = motion.at(signal)
            self._remember(motion, signal, motion.latch)
        if not motion.code:
            motion.code = CONTACT if motion.kind == SEARCH else "EARLY"
            motion.text = "" if motion.kind == SEARCH else "the wire touched on the way"
        motion.profile = motion.profile.stopped(signal)

    def _remember(self, motion: _Motion, signal: float, latch: Float[np.ndarray, " joints"]) -> None:
        """Write down where the wire truly touched, where it did."""
        met = motion.trip.contact(motion.profile)
        if met is None or (time := motion.profile.time(met.enter)) > signal:
            return
        q = motion.start + met.enter * (motion.target - motion.start) - self._zero
        arm, latch = motion.trip.arm(met.enter), latch - self._zero
        self.touches.append(Truly(time, signal, met.surface, q, arm, latch, self.arm.theta, self.arm.shift))
        self.arm.count()

    def _finish(self, motion: _Motion, time: float) -> Outcome:
        ended = self.time
        self._q, self._motion = motion.at(ended), None
        self.arm.rest(motion.trip, motion.profile, ended)
        q = self.q
        latch = q if motion.code != CONTACT or motion.latch is None else motion.latch - self._zero
        kind = motion.code or (OK if motion.kind == MOVE else NOCONTACT)
        if kind == "EARLY":  # one that ended where it began has no way back
            self._retreat = motion.start if np.abs(self._q - motion.start).max() > BACK else None
        elif not self.arm.closed:
            self._retreat = None
        outcome = Outcome(kind, latch, q, motion.text)
        self.executed.append(
            Executed(
                motion.kind, motion.target - self._zero, motion.rate, motion.profile.pieces[0].start, ended, outcome
            )
        )
        self.time = max(self.time, time)
        return outcome

    def move(self, q: Float[np.ndarray, " joints"], rate: float) -> Outcome:
        """Move straight to `q` and wait until the robot stands [controller time]."""
        return self._run(MOVE, q, rate)

    def search(self, q: Float[np.ndarray, " joints"], rate: float) -> Outcome:
        """Move straight towards `q` until the wire touches, and wait until the robot stands."""
        return self._run(SEARCH, q, rate)

    def _run(self, kind: str, q: Float[np.ndarray, " joints"], rate: float) -> Outcome:
        outcome = self.begin(kind, np.asarray(q, dtype=float), rate)
        while outcome is None:
            outcome = self.advance(self.due)
        return outcome

    def restart(self, *, keeps_position: bool = True) -> None:
        """The controller starts anew: the drives drop where they are, and perhaps the position is lost."""
        self.halt("STOPPED", "the controller restarted")
        self._retreat = None
        if not keeps_position:
            self._zero = self._q.copy()
            self.health.homed = False

    def home(self) -> None:
        """Find the true zero position again, as an operator would."""
        self._zero, self.health.homed = np.zeros_like(self._zero), True
