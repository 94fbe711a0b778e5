"""Six-axis GRBL 1.1 and grblHAL whose axes are the joints of the robot: G38.3, [PRB:...], (MSG,tag) as a barrier.

GRBL counts its answers by nothing but their order, and one line too many shifts them all: so no answer is believed by
its place. Every command is followed by a message that GRBL echoes when it gets there, and a touch is what GRBL printed
between and prints again when asked. Moves are guarded like searches, but for those that begin in contact. GRBL has no
deadman and no checksums: a motion goes on to its end, or to the contact, where the line breaks, and a spoiled command
is noticed by where it leads. `$` settings are never written; `$X` and `$H` only on request. The boot is kept in the
tool number, which nothing else uses and every reset forgets.
"""

import secrets
from collections.abc import Callable, Iterator
from typing import NoReturn, TypeVar

import numpy as np
from jaxtyping import Float

from identify.model.robot import Robot
from probe.clock import Clock
from probe.controller import Contact, Latch, LinkLost, NoContact, Rebooted, Refused, State
from probe.controllers.grbl_words import OFFSETS, Probe, Report, motion, numbers, read_probe, read_report, refusal
from probe.framing import Lines
from probe.transcript import Transport

T = TypeVar("T")
LONGEST = 500  # [bytes] of a line of GRBL
HIGHEST_TOOL = 255  # of GRBL 1.1
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
        self._transport, self._clock = transport, clock
        self._unit = np.where(robot.prismatic, 1.0, np.radians(axis_unit_deg))
        self._degrees = robot.joint_unit() / self._unit  # axis units a degree (or mm)
        self._unlock, self._home = unlock, home
        self._poll = clock.at_least(0.1, 0.01)
        self._silence = clock.at_least(1.0, 0.5)
        self._patience = clock.at_least(20.0, 5.0)
        self._lines = Lines(LONGEST)
        self._boot, self._kept, self._number = "", False, 0

    def connect(self) -> None:
        """Find GRBL and check that it can be worked with; raises LinkLost, or Refused where it cannot."""
        self._settle(self._silence * 4)
        said = self._told("$I") + self._told("$#") + self._told("$$")
        axes = len(self._report_fields())
        if axes != self.joints:
            raise Refused("ROBOT", f"it has {axes} axes, the robot of the cell {self.joints} joints")
        for name, values in (found.groups() for line in said if (found := OFFSETS.fullmatch(line))):
            if name in ("G54", "G92", "TLO") and np.any(numbers(values)):
                raise Refused("SYNTAX", f"{name} offsets its axes by {values}; set it to zero at the controller")
        if "$13=1" in said:
            raise Refused("SYNTAX", "it reports inches ($13=1); set $13=0 at the controller")
        if self._state().state == "Alarm" and (self._unlock or self._home):
            self._told("$H" if self._home else "$X", HOMING)
        elif self._home:
            self._told("$H", HOMING)
        self._adopt()

    @property
    def sequence(self) -> int:
        """The number that the next command will carry."""
        return self._number + 1

    def state(self) -> State:
        """How things stand now."""
        report = self._patiently(self._state)
        q = report.position * self._unit
        return State(self._boot, report.state not in ("Idle", "Alarm"), report.probe, q, self._number,
                     report.state != "Alarm")  # fmt: skip

    def move(self, q: Float[np.ndarray, " joints"], rate: float) -> Float[np.ndarray, " joints"]:
        """Move straight to `q`, guarded unless the wire touches already; where the robot stands afterwards."""
        before = self.state()
        if np.abs((q - before.q) / self._unit).max() < NOWHERE:
            return before.q  # GRBL calls a probing motion to where it stands an error
        if before.contact:
            self._execute("G1", q, rate, before)
            return self.state().q
        probe = self._execute("G38.3", q, rate, before)
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
        return Contact(probe.position * self._unit, stands.q, self._boot, self._number)

    def latch(self) -> Latch | None:
        """Nothing: GRBL remembers a probe, but not of which search."""
        return None

    def stop(self) -> None:
        """Hold, and drop what is left of the motion; the position is kept, as the robot stands when GRBL is reset."""

        def halt() -> None:
            self._send(b"!")
            until = self._clock.now() + self._patience
            while self._state().state in ("Run", "Jog", "Home") and self._clock.now() < until:
                self._clock.sleep(self._poll)
            if self._state().state != "Idle":
                self._clock.sleep(self._poll)
                self._send(b"\x18")
            self._settle(self._patience, banner=True)
            self._keep_boot()

        self._patiently(halt)

    def close(self) -> None:
        """Give the port back."""
        self._transport.close()

    # --- one motion ----------------------------------------------------------------------------------------------

    def _execute(self, word: str, q: Float[np.ndarray, " joints"], rate: float, before: State) -> Probe | None:
        """A motion from its command to standing still; the probe result, where it is one and was heard twice."""
        if before.moving:
            raise Refused("BUSY")
        if not before.homed:
            raise Refused("UNHOMED", "GRBL is locked by an alarm")
        self._number += 1
        target = q / self._unit
        seconds = max(float(np.max(np.abs(q - before.q) / self._unit / self._degrees)) / np.degrees(rate), 0.01)
        try:
            said = self._told(motion(word, target, seconds), seconds + SLACK, still=True)
        except LinkLost:
            self._patiently(lambda: self._settle(seconds + self._patience))
            self._same_boot()
            raise Refused("NOTREACHED", "the line broke, and with it the answer") from None
        for line in said:
            if (refused := refusal(line)) is not None:
                raise Refused(*refused)
        heard = [probe for line in said if (probe := read_probe(line, self.joints))]
        if word == "G1" or not heard:
            return None
        again = [
            probe for line in self._patiently(lambda: self._told("$#")) if (probe := read_probe(line, self.joints))
        ]
        return heard[0] if [p.text for p in heard] == [p.text for p in again] else None

    def _told(self, line: str, seconds: float = 0.0, *, still: bool = False) -> list[str]:
        """What GRBL says to a line, up to the echo of a message sent behind it; raises LinkLost, Rebooted, Refused."""
        tag = f"t{secrets.token_hex(3)}"
        wait = b"G4 P0.01\n" if still else b""  # G1 is answered when it is queued: wait until the queue is empty
        self._send(line.encode() + b"\n" + wait + f"(MSG,{tag})\n".encode())
        said, idle = list[str](), 0
        until = self._clock.now() + max(seconds, self._silence) + self._silence
        asked = heard = self._clock.now()
        while True:
            for text in self._listen(self._poll):
                heard = self._clock.now()
                if text == f"[MSG:{tag}]":
                    return said
                report = read_report(text, self.joints)
                idle = idle + 1 if report and report.state in ("Idle", "Alarm", "Hold") else 0 if report else idle
                if report is None:
                    said.append(text)
            now = self._clock.now()
            if now - heard > self._silence * 2:
                raise LinkLost(f"nothing answers at {self._transport.url}; is the controller on?")
            if idle * self._poll > self._silence / 2:
                self._no_echo(said, tag)
                return said
            if now > until:
                self.stop()
                raise Refused("NOTREACHED", f"stopped from here after {seconds:.0f} s")
            if now - asked >= self._poll:
                self._send(b"?")
                asked = now

    def _no_echo(self, said: list[str], tag: str) -> None:
        """GRBL stands still and the echo does not come: an alarm, a hold, a restart, or a line was spoiled."""
        refused = next((r for line in said if (r := refusal(line))), None)
        if refused is not None:
            raise Refused(*refused)
        if self._state().state == "Hold":
            raise Refused("STOPPED", "feed hold")
        self._settle(self._patience)
        self._same_boot()
        if not any(line == "ok" for line in said):
            raise Refused("NOTREACHED", "the command or its answer was lost")

    # --- the line ------------------------------------------------------------------------------------------------

    def _settle(self, patience: float, *, banner: bool = False) -> None:
        """Wait until GRBL stands still and has said everything: a fresh message comes back."""
        deadline = self._clock.now() + patience
        while True:
            tag = f"s{secrets.token_hex(3)}"
            self._send(f"\n(MSG,{tag})\n".encode())
            until = self._clock.now() + self._silence
            while self._clock.now() < until:
                for text in self._listen(self._poll, banner=banner):
                    if text == f"[MSG:{tag}]" and self._state().state != "Run":
                        return
            if self._clock.now() > deadline:
                raise LinkLost(f"no GRBL that echoes messages, as grblHAL does, answers at {self._transport.url}")

    def _state(self) -> Report:
        """A fresh status report; raises LinkLost."""
        for _ in self._listen(0.0):
            pass
        until = self._clock.now() + self._silence * 2
        while self._clock.now() < until:
            self._send(b"?")
            for text in self._listen(self._poll * 2):
                if report := read_report(text, self.joints):
                    return report
        raise LinkLost(
            f"nothing answers at {self._transport.url}; is the controller on, and has it {self.joints} axes?"
        )

    def _report_fields(self) -> Float[np.ndarray, " axes"]:
        """The machine positions of a status report, however many axes it has."""
        self._send(b"?")
        for text in self._listen(self._silence):
            fields = dict(part.partition(":")[::2] for part in text.strip("<>").split("|")[1:])
            if "MPos" in fields:
                return numbers(fields["MPos"])
        raise Refused("SYNTAX", "it reports no machine position; set $10 at the controller so that it does")

    def _adopt(self) -> None:
        """Learn the boot, or draw one: it lives in the tool number."""
        tool = self._tool()
        if tool:
            self._boot, self._kept = f"T{tool}", True
            return
        drawn = 1 + secrets.randbelow(HIGHEST_TOOL)
        self._boot = f"T{drawn}"
        self._keep_boot()
        self._kept = self._tool() == drawn
        if not self._kept:
            self._boot = f"t{secrets.token_hex(4)}"  # this GRBL keeps no tool number: good for this connection only

    def _keep_boot(self) -> None:
        if self._boot.startswith("T"):
            self._told(self._boot)

    def _tool(self) -> int:
        said = " ".join(line for line in self._told("$G") if line.startswith("[GC:"))
        words = [word[1:] for word in said.strip("[]").split() if word.startswith("T")]
        return int(words[0]) if words and words[0].isdecimal() else 0

    def _same_boot(self) -> None:
        if self._kept and f"T{self._tool()}" != self._boot:
            self._started_anew()

    def _started_anew(self) -> NoReturn:
        self._boot = f"t{secrets.token_hex(4)}"
        self._kept = False
        raise Rebooted(
            f"the GRBL at {self._transport.url} has started anew: its position is not trusted any more; check that "
            "it is homed and shows where the robot stands, then go on with --resume --trust-position"
        )

    def _patiently(self, call: Callable[[], T]) -> T:
        """Call, and where the line is silent or gone open it anew and call again; raises LinkLost in the end."""
        deadline = self._clock.now() + self._patience
        while True:
            try:
                return call()
            except LinkLost:
                if self._clock.now() > deadline:
                    raise
            self._lines = Lines(LONGEST)
            try:
                self._transport.reopen()
                self._settle(self._patience)
                self._same_boot()
            except LinkLost:
                self._clock.sleep(self._poll)

    def _send(self, data: bytes) -> None:
        self._transport.write(data)

    def _listen(self, seconds: float, *, banner: bool = False) -> Iterator[str]:
        """Lines as they come, for so long; raises Rebooted where GRBL greets, unless its greeting is expected."""
        until = self._clock.now() + seconds
        while True:
            data = self._transport.read(self._clock.real(until - self._clock.now()))
            for line in self._lines.feed(data):
                text = line.decode("latin-1").strip()
                if text.lower().startswith("grbl") and not banner and self._boot:
                    self._started_anew()
                yield text
            if self._clock.now() >= until:
                return
