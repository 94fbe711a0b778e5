"""A controller that speaks TOUCH/1 (DESIGN.md, section 6) over a serial line or a socket."""

import re
from typing import NoReturn

import numpy as np
from jaxtyping import Float

from identify.model.robot import Robot
from probe.line.clock import Clock
from probe.line.controller import Contact, Latch, LinkLost, NoContact, Refused, State
from probe.line.framing import LONGEST
from probe.line.link import Link
from probe.line.messages import Status
from probe.line.retry import Timing
from probe.line.transcript import Transport
from probe.line.watch import Watch

SPOKEN = "TOUCH/1"
FIELDS = re.compile(r"(\w+)=(\S+)")
OLD = "warning: its touch program is of the first version, and a delayed line can deceive it; put the new one on it"
GREETING_PATIENCE = 3.0  # [s]: a controller that is there answers at once, and a person waits for this


class Line:
    """The host's side of TOUCH/1."""

    def __init__(self, transport: Transport, robot: Robot, clock: Clock, timing: Timing | None = None) -> None:
        self.name = f"{SPOKEN} controller at {transport.url}"
        self.joints = len(robot.joints)
        self.link = Link(transport, clock, timing)
        self._unit = robot.joint_unit()
        self._q: Float[np.ndarray, " joints"] | None = None  # where it stands, as far as known
        self._closed = False  # the touch input, as it was last seen

    def connect(self) -> None:
        """Say hello; raises LinkLost where nobody speaks TOUCH/1, and Refused where the robot is another one."""
        self.link.greet(self.link.clock.at_least(GREETING_PATIENCE, 2.0))
        if self.link.joints != self.joints:
            raise Refused("ROBOT", f"it has {self.link.joints} joints, the robot of the cell {self.joints}")
        self.link.learn_version()
        if not self.link.bound:
            self.name += f" ({OLD})"
        if self.state().moving:
            self.stop()

    @property
    def sequence(self) -> int:
        """The number that the next command will carry."""
        return self.link.sequence

    def state(self) -> State:
        """How things stand now."""
        status = self.link.patiently(self.link.status)
        self._q, self._closed = self._joints(status.joints), status.closed
        return State(status.boot, status.running, status.closed, self._q, status.sequence)

    def move(self, q: Float[np.ndarray, " joints"], rate: float) -> Float[np.ndarray, " joints"]:
        """Move straight to `q`; where the robot stands afterwards."""
        answer = self._motion("MOVE", q, rate)
        if answer[0] != "OK":
            self._nonsense(f"{answer[0]} to a move")
        self._q = self._joints(answer[1].get("q", ""))
        return self._q

    def search(self, q: Float[np.ndarray, " joints"], rate: float) -> Contact | NoContact:
        """Move straight towards `q` until the wire touches."""
        kind, fields = self._motion("SEARCH", q, rate)
        if kind == "CONTACT":
            latched, self._q = self._joints(fields.get("q", "")), self._joints(fields.get("stop", ""))
            return Contact(latched, self._q, fields.get("boot", ""), _number(fields.get("seq", "")))
        if kind != "NOCONTACT":
            self._nonsense(f"{kind} to a search")
        self._q = self._joints(fields.get("q", ""))
        return NoContact(self._q)

    def latch(self) -> Latch | None:
        """The last latch of this boot."""
        try:
            fields = dict(FIELDS.findall(self.link.ask("LATCH").text))
        except Refused as refusal:
            if refusal.code == "NOLATCH":
                return None
            raise
        return Latch(self._joints(fields.get("q", "")), fields.get("boot", ""), _number(fields.get("seq", "")))

    def stop(self) -> None:
        """Stop the robot and return when it stands still."""
        self.link.halt()

    def close(self) -> None:
        """Give the port back."""
        self.link.transport.close()

    def _motion(self, verb: str, q: Float[np.ndarray, " joints"], rate: float) -> tuple[str, dict[str, str]]:
        start = self._q if self._q is not None else self.state().q
        begin, end, degrees = start / self._unit, q / self._unit, float(np.degrees(rate))
        from_contact = self._closed and verb == "MOVE"
        watch = Watch(begin, end, degrees, self.link.clock, from_contact=from_contact)

        def astray(status: Status) -> str:
            return watch.objection(self._joints(status.joints) / self._unit, status.closed)

        number = self.link.sequence  # known before the boot is: both sides may have to count anew
        boot = f" boot={self.link.boot}" if self.link.bound else ""
        body = f"{verb} {_text(end, 6)} {degrees:.5f}{boot}"
        if len(f"{number} {body}") > LONGEST - 6:
            body = f"{verb} {_text(end, 5)} {degrees:.3f}{boot}"
        self._q, self._closed = None, False
        answer = self.link.ask(body, max(float(np.abs(end - begin).max()) / degrees, 1e-3), astray)
        self._closed = answer.kind == "CONTACT"
        return answer.kind, dict(FIELDS.findall(answer.text))

    def _joints(self, text: str) -> Float[np.ndarray, " joints"]:
        try:
            values = np.array([float(value) for value in text.split(",")])
        except ValueError:
            values = np.array([np.nan])
        if len(values) != self.joints or not np.isfinite(values).all():
            self._nonsense(f"joints {text!r} where {self.joints} numbers were expected")
        return values * self._unit

    def _nonsense(self, what: str) -> NoReturn:
        raise LinkLost(f"the {self.name} answered {what}; its touch program does not keep to {SPOKEN}")


def _text(joints: Float[np.ndarray, " joints"], places: int) -> str:
    return ",".join(f"{value:.{places}f}" for value in joints)


def _number(text: str) -> int:
    return int(text) if text.isdecimal() else -1
