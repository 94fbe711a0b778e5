"""Six-axis GRBL 1.1 and grblHAL whose axes are the joints of the robot: G38.3, [PRB:...], (MSG,tag) as a barrier.

GRBL counts its answers by nothing but their order, and one line too many shifts them all: so no answer is believed by
its place. Every command is followed by a message that GRBL echoes when it gets there, and a touch is what GRBL printed
between and prints again when asked. Moves are guarded like searches, but for those that begin in contact. GRBL has no
deadman and no checksums: a motion goes on to its end, or to the contact, where the line breaks, and a spoiled command
is noticed by where it leads. `$` settings are never written; `$X` and `$H` only on request.
"""

import numpy as np
from jaxtyping import Float

from identify.model.robot import Robot
from probe.controllers.grbl_link import GrblLink
from probe.controllers.grbl_words import OFFSETS, Probe, motion, numbers, read_probe, refusal
from probe.line.clock import Clock
from probe.line.controller import Contact, Latch, LinkLost, NoContact, Refused, State
from probe.line.transcript import Transport

NOWHERE = 0.002  # [axis units]
SLACK = 10.0  # [s] beyond the expected duration of a motion before it is stopped
HOMING = 180.0  # [s]


class Grbl:
    """The host's side of GRBL; `axis_unit_deg` is what one unit of a turning axis means there.

    GRBL prints three decimals: let a unit be 0.1 deg, and a touch is known to a hundredth of its scatter.
    """

    def __init__(
        self, transport: Transport, robot: Robot, clock: Clock, *, axis_unit_deg: float = 1.0, unlock: bool = False,
        home: bool = False,
    ) -> None:  # fmt: skip
        self.name = f"GRBL at {transport.url}"
        self.joints = len(robot.joints)
        self.link = GrblLink(transport, clock, self.joints)
        self._unit = np.where(robot.prismatic, 1.0, np.radians(axis_unit_deg))
        self._degree = robot.joint_unit()  # [rad] or [mm]
        self._unlock, self._home, self._number = unlock, home, 0

    def connect(self) -> None:
        """Find GRBL and check that it can be worked with; raises LinkLost, or Refused where it cannot."""
        link = self.link
        axes = link.axes(4 * link.silence)
        if axes != self.joints:
            raise Refused("ROBOT", f"it has {axes} axes, the robot of the cell {self.joints} joints")
        if self._home:
            link.unlock("$H", HOMING)
        elif link.report().state == "Alarm":
            if not self._unlock:
                raise Refused("UNHOMED", "GRBL is locked by an alarm: home it, or unlock it where that is safe")
            link.unlock("$X", link.patience)
        link.settle(4 * link.silence)
        said = link.told("$#") + link.told("$$")
        for name, values in (found.groups() for line in said if (found := OFFSETS.fullmatch(line))):
            if name in ("G54", "G92", "TLO") and np.any(numbers(values)):
                raise Refused("SYNTAX", f"{name} offsets its axes by {values}; set it to zero at the controller")
        if "$13=1" in said:
            raise Refused("SYNTAX", "it reports inches ($13=1); set $13=0 at the controller")
        link.adopt()

    @property
    def sequence(self) -> int:
        """The number that the next command will carry."""
        return self._number + 1

    def state(self) -> State:
        """How things stand now."""
        report = self.link.patiently(self.link.report)
        moving, homed = report.state not in ("Idle", "Alarm"), report.state != "Alarm"
        return State(self.link.boot, moving, report.probe, report.position * self._unit, self._number, homed)

    def move(self, q: Float[np.ndarray, " joints"], rate: float) -> Float[np.ndarray, " joints"]:
        """Move straight to `q`, guarded unless the wire touches already; where the robot stands afterwards."""
        before = self.state()
        if np.abs((q - before.q) / self._unit).max() < NOWHERE:
            return before.q  # GRBL calls a probing motion to where it stands an error
        probe = self._execute("G1" if before.contact else "G38.3", q, rate, before)
        stands = self.state()
        if probe is not None and probe.success:
            raise Refused("EARLY")
        return stands.q

    def search(self, q: Float[np.ndarray, " joints"], rate: float) -> Contact | NoContact:
        """Move straight towards `q` until the wire touches."""
        before = self.state()
        if before.contact:
            raise Refused("ALREADY")
        probe = self._execute("G38.3", q, rate, before)
        stands = self.state()
        if probe is None:
            raise Refused("NOTREACHED", "the answer was lost")
        if not probe.success:
            return NoContact(stands.q)
        return Contact(probe.position * self._unit, stands.q, self.link.boot, self._number)

    def latch(self) -> Latch | None:
        """Nothing: GRBL remembers a probe, but not of which search."""
        return None

    def stop(self) -> None:
        """Hold, and drop what is left of the motion; the position is kept."""
        self.link.patiently(self.link.halt)

    def close(self) -> None:
        """Give the port back."""
        self.link.transport.close()

    def _execute(self, word: str, q: Float[np.ndarray, " joints"], rate: float, before: State) -> Probe | None:
        """A motion from its command to standing still; the probe result, where it is one and was heard twice."""
        if before.moving:
            raise Refused("BUSY")
        if not before.homed:
            raise Refused("UNHOMED", "GRBL is locked by an alarm")
        self._number += 1
        seconds = max(float(np.max(np.abs(q - before.q) / self._degree)) / np.degrees(rate), 0.01)
        try:
            said = self.link.told(motion(word, q / self._unit, seconds), seconds + SLACK, still=True)
        except LinkLost:
            self.link.patiently(lambda: self.link.settle(seconds + self.link.patience))
            self.link.same_boot()
            raise Refused("NOTREACHED", "the line broke, and with it the answer") from None
        for line in said:
            if (refused := refusal(line)) is not None:
                raise Refused(*refused)
        heard = [probe.text for line in said if (probe := read_probe(line, self.joints))]
        if word == "G1" or not heard:
            return None
        again = self.link.patiently(lambda: self.link.told("$#"))
        probes = [probe for line in again if (probe := read_probe(line, self.joints))]
        return probes[0] if [probe.text for probe in probes] == heard else None
