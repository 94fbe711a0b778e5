"""Six-axis GRBL 1.1 and grblHAL whose axes are the joints of the robot: G38.3, [PRB:...], (MSG,tag) as a barrier.

GRBL counts its answers by nothing but their order, and one line too many shifts them all: so no answer is believed by
its place. Every command is followed by a message that GRBL echoes when it gets there, and a touch is what GRBL printed
between and prints again when asked.

GRBL has no checksums either. So a target is first written as a tool offset (G43.1, which moves nothing and is forgotten
at a reset) with the modes, read back (`$#`, `$G`), and sent again where GRBL understood something else. The motion
itself is to zero: of its line a lost byte is an error, and a changed digit leads less than one axis unit astray, which
the watch on the motion ends. Its feed is the inverse of its time (G93): a GRBL that started anew just before it leads
to another zero, but as slowly, because it takes the feed for axis units a minute. A GRBL without tool offsets on all
axes is driven slowly enough for the watch alone. Moves are guarded like searches, but for those that begin in contact.
There is no deadman: the host stops the robot. `$`
settings are never written; `$X` and `$H` only on request.
"""

import secrets
from contextlib import suppress

import numpy as np
from jaxtyping import Float

from identify.model.robot import Robot
from probe.controllers.grbl_link import GrblLink
from probe.controllers.grbl_words import (
    OFFSETS,
    SAME_PLACE,
    Probe,
    Report,
    axis_words,
    inverse_feed,
    numbers,
    offset,
    read_modes,
    read_probe,
    refusal,
    trigger,
)
from probe.line.clock import Clock
from probe.line.controller import Contact, Latch, LinkLost, NoContact, Rebooted, Refused, State
from probe.line.transcript import Transport
from probe.line.watch import Watch

NOWHERE = 0.002  # [axis units]
SLACK = 5.0  # [s] beyond the expected duration of a motion before it is stopped
HOMING = 180.0  # [s]
ARRIVED = 0.02  # [deg] or [mm]
ASKING = 5.0  # [s] for which a target that GRBL understands wrongly is told again
OFF = 0.01  # [deg] or [mm] off the commanded path: GRBL reports where it steps, and nothing trembles
LAST_OF_GRBL = 3  # of $10: grblHAL has more bits than GRBL
SHOWN = 16 + 128  # of $10: the bits of the input and of the probe
NO_OFFSETS = {"error:20", "error:37"}  # no G43.1, or for one axis only
DISTURBED = "GRBL understands another target than it was told; is the line disturbed?"
ASTRAY = 0.47  # [mm] that the tip may be off the commanded path when the robot stands again
REACH = 1000.0  # [mm], at most: with a longer arm the tip may be off by more in proportion
DIGIT = 0.8  # [axis units] that one changed digit of a motion leads astray
REACTION = 0.03  # [s] from a report to where the robot holds
OFTEN = 0.02  # [s] between two reports, at least
SLOW = 1.0  # [deg/s] where a target cannot be checked: the watch stops it within 0.1 deg


class Grbl:
    """The host's side of GRBL; `axis_unit_deg` is what one unit of a turning axis means there.

    GRBL prints three decimals: let a unit be 0.1 deg, and a touch is known to a hundredth of its scatter. `reach` [mm]
    is how far the tip comes from the axis of a joint: the nearer it stays, the faster a motion may be that is watched.
    """

    def __init__(
        self,
        transport: Transport,
        robot: Robot,
        clock: Clock,
        *,
        axis_unit_deg: float = 1.0,
        reach: float = REACH,
        unlock: bool = False,
        home: bool = False,
    ) -> None:
        self.name = f"GRBL at {transport.url}"
        self.joints = len(robot.joints)
        self.link = GrblLink(transport, clock, self.joints)
        self._unit = np.where(robot.prismatic, 1.0, np.radians(axis_unit_deg))
        self._degree = robot.joint_unit()  # [rad] or [mm]
        self._further = float(np.degrees(ASTRAY / min(reach, REACH))) - OFF  # [deg] from the first report off the path
        self._unlock, self._home, self._number = unlock, home, 0
        self._checks = True  # whether GRBL says which target it understood

    def connect(self) -> None:
        """Find GRBL and check that it can be worked with; raises LinkLost, or Refused where it cannot."""
        link = self.link
        axes = link.axes(3 * link.silence)
        if axes != self.joints:
            raise Refused("ROBOT", f"it has {axes} axes, the robot of the cell {self.joints} joints")
        link.drop_held()
        locked = not self._home and link.report().state == "Alarm"
        if self._home:
            link.unlock("$H", HOMING)
        elif locked:
            if not self._unlock:
                raise Refused("UNHOMED", "GRBL is locked by an alarm: home it, or unlock it where that is safe")
            link.unlock("$X", link.patience)
        link.settle(3 * link.silence)
        lines = link.told("$#") + link.told("$$")
        for name, values in (match.groups() for line in lines if (match := OFFSETS.fullmatch(line))):
            if name in ("G54", "G92") and np.any(numbers(values)):
                raise Refused("SYNTAX", f"{name} offsets its axes by {values}; set it to zero at the controller")
        if "$13=1" in lines:
            raise Refused("SYNTAX", "it reports inches ($13=1); set $13=0 at the controller")
        for mask in (int(line[4:]) for line in lines if line.startswith("$10=") and line[4:].isdecimal()):
            if mask > LAST_OF_GRBL and mask & SHOWN != SHOWN:
                raise Refused("SYNTAX", f"it reports no touch input or no probe ($10={mask}); set $10=511 there")
        link.adopt(anew=locked)
        self._checks = self._tells_offsets()

    @property
    def sequence(self) -> int:
        """The number that the next command will carry."""
        return self._number + 1

    def state(self) -> State:
        """How things stand now."""
        report = self.link.patiently(self.link.standing)
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
        if not probe.success and np.abs((stands.q - q) / self._degree).max() > ARRIVED:
            raise Refused("NOTREACHED", "the search ended before its target")
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
        start, end = before.q / self._degree, q / self._degree
        degrees = float(np.degrees(rate)) if self._checks else min(float(np.degrees(rate)), SLOW)
        seconds = max(float(np.abs(end - start).max()) / degrees, self._reports(0.0)[1])
        line, seconds = self._prepared(word, before.q / self._unit, q / self._unit, seconds)
        watch = Watch(start, end, degrees, self.link.clock, from_contact=before.contact, off=OFF)

        def astray(report: Report) -> str:
            stands = report.state == "Idle"
            return watch.objection(report.position * self._unit / self._degree, report.probe, stands=stands)

        try:
            lines = self.link.told(line, seconds + SLACK, astray, self._reports(seconds)[0])
        except LinkLost:
            self.link.patiently(self.link.halt)
            self.link.same_boot()
            raise Refused("NOTREACHED", "the line broke, and with it the answer") from None
        except Rebooted:  # just before the motion: the offset is forgotten, and the motion leads to zero
            with suppress(LinkLost, Refused):
                self.link.patiently(self.link.halt)
            raise
        heard = [probe.text for line in lines if (probe := read_probe(line, self.joints))]
        for line in lines:
            if (refused := refusal(line)) is not None and not (line == SAME_PLACE and heard):
                raise Refused(*refused)
        if word == "G1" or not heard:
            return None
        again = self.link.patiently(lambda: self.link.told("$#"))
        probes = [probe for line in again if (probe := read_probe(line, self.joints))]
        return probes[0] if {probe.text for probe in probes} == set(heard) else None

    def _prepared(
        self, word: str, start: Float[np.ndarray, " joints"], target: Float[np.ndarray, " joints"], seconds: float
    ) -> tuple[str, float]:
        """The line that begins a motion [axis units], once GRBL has understood its target; and how long it takes."""
        if not self._checks:
            feed = max(60.0 * float(np.linalg.norm(target - start)) / seconds, 1.0)
            return f"G90G94{word}{axis_words(target)}F{feed:.3f}", seconds
        feed = inverse_feed(seconds)
        if 60.0 / feed < seconds - 1e-6:
            raise Refused("SYNTAX", f"a motion of {seconds:.0f} s is too slow for GRBL")
        until = self.link.clock.now() + self.link.clock.at_least(ASKING, ASKING)
        while self.link.clock.now() < until:
            if self.link.patiently(lambda: self._understood(target)):
                return trigger(word, self.joints, feed, self.link.speed), 60.0 / feed
        raise Refused("LOST", DISTURBED)

    def _reports(self, seconds: float) -> tuple[float, float]:
        """How often to ask where the robot is [s] in a motion of so long, and the shortest motion that can be watched.

        A digit changed in the line leads astray by DIGIT in the course of the motion; from OFF on the robot is stopped.
        """
        degrees = DIGIT * float(np.max(self._unit / self._degree))
        react = self._further * seconds / degrees
        return float(np.clip(react - REACTION, OFTEN, self.link.poll)), degrees * (OFTEN + REACTION) / self._further

    def _tells_offsets(self) -> bool:
        """Whether GRBL says which tool offset it has understood; raises Refused where the line is too disturbed."""
        until, refused = self.link.clock.now() + self.link.clock.at_least(ASKING, ASKING), 0
        while self.link.clock.now() < until:
            lines = self.link.told(offset(np.zeros(self.joints)))
            refused = refused + 1 if NO_OFFSETS.intersection(lines) else 0
            if refused > 1:
                return False
            if self._understood(np.full(self.joints, 0.001 * (1 + secrets.randbelow(999)))):
                return True
        raise Refused("LOST", DISTURBED)

    def _understood(self, target: Float[np.ndarray, " joints"]) -> bool:
        """Write the target without a motion, and see whether GRBL has it."""
        lines = self.link.told(offset(target, f"S{self.link.speed}") + "\n$#\n$G")
        tools = [match[2] for line in lines if (match := OFFSETS.fullmatch(line)) and match[1] == "TLO"]
        same_tool = len(tools) == 1 and np.array_equal(numbers(tools[0]), np.round(target, 3) + 0.0)
        return same_tool and {"G21", "G91", "G93"} <= set(read_modes(lines))
