"""Lines to and from a GRBL that echoes messages: what it said to a command, and whether it is still the same start."""

import secrets
from collections.abc import Callable, Iterator
from typing import NoReturn

import numpy as np

from probe.controllers.grbl_words import SAID, Report, numbers, offset, read_modes, read_report, refusal
from probe.line.clock import Clock
from probe.line.controller import LinkLost, Rebooted, Refused
from probe.line.framing import Lines
from probe.line.retry import T, patiently
from probe.line.transcript import Transport

LONGEST = 500  # [bytes] of a line of GRBL
IDENTITY, HIGHEST = "TS", 255  # words that may keep the boot; the highest tool number of GRBL 1.1
HOLDS = 3  # bytes that ask for a feed hold, so that one is not lost
BEGUN = 2.0  # [s] after which a report that says Idle is no longer one from before the motion
REPEATS = 20  # reports of a robot that stands, of which two in a row must agree
STOPPING = 0.02  # [s] between two orders to hold
RESET = b"\x18"
STILL = ("Idle", "Alarm", "Hold")


class GrblLink:
    """A line to GRBL.

    The boot is kept in a word of its parser that nothing else uses and every restart forgets: the tool number, or,
    where a tool is taken over by M6 only, the speed of a spindle that is off.
    """

    def __init__(self, transport: Transport, clock: Clock, joints: int) -> None:
        self.transport, self.clock, self.joints = transport, clock, joints
        self.poll = clock.at_least(0.05, 0.01)
        self.silence = clock.at_least(1.0, 0.5)
        self.patience = clock.at_least(3.0, 3.0)
        self.boot = ""
        self._kept = False  # whether GRBL keeps the boot
        self._lines = Lines(LONGEST)

    def told(
        self, line: str, seconds: float = 0.0, watch: Callable[[Report], str] | None = None, poll: float = 0.0
    ) -> list[str]:
        """What GRBL says to a line, up to the echo of a message sent behind it.

        With a `watch`, that is when the robot stands again; GRBL is asked for a report every `poll` [s], and what the
        watch says against a report stops the robot. Raises LinkLost, Rebooted, or Refused where the echo does not come
        or takes longer than `seconds`.
        """
        tag, poll = f"t{secrets.token_hex(3)}", poll or self.poll
        wait = "G4P.0\n" if watch else ""  # G1 is answered when it is queued: wait until the queue is empty
        # after an error grblHAL takes no G-code, a message neither, until an empty line
        self._send(f"{line}\n{wait}\n(MSG,{tag})\n".encode())
        lines, still, against, echoed, waited = list[str](), 0.0, 0, False, False
        began = question = heard = self.clock.now()
        until = began + max(seconds, self.silence) + self.silence
        while True:
            for text in filter(SAID.fullmatch, self._listen(poll)):  # anything else is noise
                heard = self.clock.now()
                if text == f"[MSG:{tag}]":
                    echoed, waited = True, lines.count("ok") > 2  # all three lines: also that which waits for the end
                    if watch is None:
                        return lines
                    self._send(b"?")  # the wait may have been lost: see that the robot stands
                elif (report := read_report(text, self.joints)) is None:
                    lines.append(text)
                else:
                    late = report.state == "Idle" and heard < began + min(seconds, BEGUN)  # said before it began
                    rests = report.state in STILL
                    if echoed and rests and (waited or not late):
                        return lines
                    still = 0.0 if late or not rests else still or heard
                    astray = watch(report) if watch and report.state in ("Run", "Idle") else ""  # Idle, late
                    against = against + 1 if astray else 0
                    if against == 1:
                        self._send(b"?")  # a report has no checksum: one alone stops nothing
                    elif against > 1:
                        self.halt()
                        raise Refused("ASTRAY", astray)
            now = self.clock.now()
            if now - heard > self.silence * 2:
                raise self._silent()
            if still and now - still > self.silence / 2:
                self._no_echo(lines)
                return lines
            if now > until:
                self.halt()
                raise Refused("NOTREACHED", f"stopped after {seconds:.0f} s")
            if now - question >= poll:
                self._send(b"?")
                question = now

    def _no_echo(self, lines: list[str]) -> None:
        """GRBL stands still and the echo does not come: an alarm, a hold, a restart, or a line was spoiled."""
        refused = next((r for line in lines if (r := refusal(line))), None)
        if refused is not None:
            raise Refused(*refused)
        if self.report().state == "Hold":
            raise Refused("STOPPED", "feed hold")
        self.settle(self.patience)
        self.same_boot()
        if not any(line == "ok" for line in lines):
            raise Refused("NOTREACHED", "the command or its answer was lost")

    def halt(self) -> None:
        """Hold, then reset where something is held; GRBL keeps the position of a robot that stands when it is reset.

        Bytes may be lost: several are sent, and again as long as the robot moves.
        """
        until = self.clock.now() + self.patience
        while True:
            for _ in range(HOLDS):
                self._send(b"!")
            if self.report().state not in ("Run", "Jog", "Home") or self.clock.now() > until:
                break
            self.clock.sleep(STOPPING)
        self.drop_held()
        if self.report().state != "Alarm":
            self.settle(self.patience)
            self._keep_boot()

    def drop_held(self) -> None:
        """Reset where a motion is held, so that it never goes on; again, as long as it is held."""
        until = self.clock.now() + self.patience
        while self.report().state == "Hold" and self.clock.now() < until:
            self.clock.sleep(self.poll)
            self._reset()

    def settle(self, patience: float) -> None:
        """Wait until GRBL stands still and has said everything: a fresh message comes back."""
        deadline = self.clock.now() + patience
        while True:
            tag = f"s{secrets.token_hex(3)}"
            self._send(f"\n(MSG,{tag})\n".encode())
            until = self.clock.now() + self.silence
            while self.clock.now() < until:
                if f"[MSG:{tag}]" in self._listen(self.poll) and self.report().state != "Run":
                    return
            if self.clock.now() > deadline:
                raise LinkLost(f"no GRBL that echoes messages, as grblHAL does, answers at {self.transport.url}")

    def report(self) -> Report:
        """A fresh status report; raises LinkLost."""
        for _ in self._listen(0.0):
            pass
        until = self.clock.now() + self.silence * 2
        while self.clock.now() < until:
            self._send(b"?")
            for text in self._listen(self.poll * 2):
                if report := read_report(text, self.joints):
                    return report
        raise self._silent()

    def standing(self) -> Report:
        """A report that says the same as the one before it, while the robot stands: reports have no checksum."""
        report = self.report()
        for _ in range(REPEATS):
            again = self.report()
            same = np.array_equal(again.position, report.position) and again.probe == report.probe
            if (same and again.state == report.state) or again.state in ("Run", "Jog", "Home"):
                return again
            report = again
        raise self._silent()

    def axes(self, patience: float) -> int:
        """How many axes GRBL reports; raises LinkLost where nobody reports, Refused where positions are missing."""
        until = self.clock.now() + patience
        while self.clock.now() < until:
            self._send(b"\n?")
            for text in self._listen(self.silence / 2):
                if text.startswith("<") and text.endswith(">"):
                    fields = dict(part.partition(":")[::2] for part in text.strip("<>").split("|")[1:])
                    if "MPos" not in fields:
                        raise Refused("SYNTAX", "it reports no machine position; set $10 at the controller")
                    return len(numbers(fields["MPos"]))
        raise self._silent()

    def unlock(self, command: str, seconds: float) -> None:
        """Send $X or $H, which a locked GRBL obeys without echoing messages; after a limit it obeys a reset only."""
        if self.report().state == "Alarm":
            self._reset()
        self._send(command.encode() + b"\n")
        until = self.clock.now() + seconds
        while self.clock.now() < until:
            for text in self._listen(self.poll):
                if (refused := refusal(text)) is not None:
                    raise Refused(*refused)
                if text == "ok":
                    return
        raise Refused("UNHOMED", f"{command} was not answered within {seconds:.0f} s")

    def adopt(self, *, anew: bool) -> None:
        """Learn the boot, or draw one and leave it with GRBL; `anew` after an alarm, which grblHAL's tool outlives."""
        for word in IDENTITY:
            value = 0 if anew else self._held(word)
            self.boot = f"{word}{value or 1 + secrets.randbelow(HIGHEST)}"
            self._kept = True
            if not value:
                self._keep_boot()
            self._kept = f"{word}{self._held(word)}" == self.boot
            if self._kept:
                return
        self.boot = f"t{secrets.token_hex(4)}"  # this GRBL keeps neither: good for this connection only

    def same_boot(self) -> None:
        """Raise Rebooted where GRBL has forgotten the boot."""
        if self._kept and f"{self.boot[0]}{self._held(self.boot[0])}" != self.boot:
            self._started_anew()

    @property
    def speed(self) -> int:
        """The spindle speed that keeps the boot; 0 where something else keeps it."""
        return int(self.boot[1:]) if self._kept and self.boot.startswith("S") else 0

    def patiently(self, call: Callable[[], T]) -> T:
        """Call, and where the line is silent or gone open it anew and call again; raises LinkLost in the end."""
        return patiently(call, self._reopen, self.clock, self.patience)

    def _reopen(self) -> None:
        self._lines = Lines(LONGEST)
        try:
            self.transport.reopen()
            self.settle(self.silence)
            self.same_boot()
        except LinkLost:
            self.clock.sleep(self.poll)

    def _reset(self) -> None:
        self._send(RESET)
        for _ in self._listen(self.silence, greeting=True):
            pass

    def _keep_boot(self) -> None:
        if self._kept:
            self.told(offset(np.zeros(self.joints), self.boot))

    def _held(self, word: str) -> int:
        values = [mode[1:] for mode in read_modes(self.told("$G")) if mode.startswith(word)]
        return int(float(values[0])) if values and values[0].replace(".", "", 1).isdecimal() else 0

    def _started_anew(self) -> NoReturn:
        self.boot, self._kept = f"t{secrets.token_hex(4)}", False
        raise Rebooted(
            f"the GRBL at {self.transport.url} has started anew: its position is not trusted any more; check that "
            "it is homed and shows where the robot stands, then go on with --resume --trust-position"
        )

    def _silent(self) -> LinkLost:
        return LinkLost(f"nothing answers at {self.transport.url}; is the controller on, with {self.joints} axes?")

    def _send(self, data: bytes) -> None:
        self.transport.write(data)

    def _listen(self, seconds: float, *, greeting: bool = False) -> Iterator[str]:
        """Lines as they come, for so long; raises Rebooted where GRBL greets, unless its greeting is expected."""
        until = self.clock.now() + seconds
        while True:
            data = self.transport.read(self.clock.real(until - self.clock.now()))
            texts = [line.decode("latin-1").strip() for line in self._lines.feed(data)]
            if self.boot and not greeting and any(text.lower().startswith("grbl") for text in texts):
                self._started_anew()  # whoever waits for an earlier line would not come to the greeting
            yield from texts
            if self.clock.now() >= until:
                return
