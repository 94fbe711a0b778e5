"""Stop-and-wait over a line that spoils, loses and repeats: one numbered command, one answer, a fed deadman."""

import math
import re
import secrets
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass

from probe.line.clock import Clock
from probe.line.controller import LinkLost, Rebooted, Refused
from probe.line.framing import Lines, seal, unseal
from probe.line.patience import T, patiently
from probe.line.transcript import Transport

LAST_NUMBER = 65535
GREETING = re.compile(r"0 OK TOUCH/1 boot=(\S+) joints=(\d+) last=(\d+) nonce=(\S+)")
STATUS = re.compile(r"! ST boot=(\S+) (RUN|IDLE) seq=(\d+) probe=([01]) q=(\S+)")
ANSWER = re.compile(r"(\d+) (ACK|OK|CONTACT|NOCONTACT|ERR)(?: (.*))?")


@dataclass(frozen=True)
class Timing:
    """How patient the host is [s of the controller]."""

    heartbeat: float = 0.2  # between two `! HB`; the controller's deadman is 0.75 s
    resend: float = 0.4  # without a sign of life before a line is sent again
    silence: float = 3.0  # without a valid line before the port is opened anew
    patience: float = 20.0  # before the controller is given up
    slack: float = 10.0  # beyond the expected duration of a motion before it is stopped

    @classmethod
    def of(cls, clock: Clock) -> "Timing":
        """The usual patience, but never shorter than an operating system under load needs on the wall."""
        return cls(
            heartbeat=clock.at_least(cls.heartbeat, 0.005),
            resend=clock.at_least(cls.resend, 0.05),
            silence=clock.at_least(cls.silence, 1.0),
            patience=clock.at_least(cls.patience, 5.0),
            slack=clock.at_least(cls.slack, 5.0),
        )


@dataclass(frozen=True)
class Status:
    """One `! ST` line."""

    boot: str
    running: bool
    sequence: int
    closed: bool
    joints: str


@dataclass(frozen=True)
class Answer:
    """The last word of the controller on a command."""

    kind: str  # OK, CONTACT or NOCONTACT
    text: str


def following(sequence: int) -> int:
    """The number after this one."""
    return sequence % LAST_NUMBER + 1


@dataclass
class Pending:
    """A command under way: when what was sent and heard last, and whether the controller has it."""

    number: int
    frame: bytes
    until: float  # [s], when it should be done
    moves: bool
    heard: float
    beat: float
    sent: float = -math.inf
    acknowledged: bool = False
    again: bool = True  # the frame is due


class Link:
    """TOUCH/1 as the host speaks it: numbers, checksums, repeats, heartbeats, and a boot that must stay the same."""

    def __init__(self, transport: Transport, clock: Clock, timing: Timing | None = None) -> None:
        self.transport = transport
        self.clock = clock
        self.timing = timing or Timing.of(clock)
        self.boot = ""
        self.joints = 0
        self._lines = Lines()
        self._last = 0  # number of the last command that the controller has begun
        self._in_step = False  # whether both sides count alike

    @property
    def sequence(self) -> int:
        """The number that the next command will carry; raises Rebooted or LinkLost where both sides must count anew."""
        if not self._in_step:
            self._settle()
        if following(self._last) == 1:  # the number that a controller started anew would take for the next one, too
            with suppress(Refused):
                self._ask(1, "LATCH")
            self._last, self._in_step = 1, True
            self.patiently(self.status)
        return following(self._last)

    def greet(self, patience: float) -> None:
        """Say hello, and learn the boot and the last number; raises LinkLost, or Rebooted where the boot is new."""
        deadline = self.clock.now() + patience
        while True:
            nonce = secrets.token_hex(3)
            self._send(seal(f"0 HELLO {nonce}"))
            for line in self._listen(self.timing.resend):
                found = GREETING.fullmatch(line)
                if found and found[4] == nonce:
                    self.joints, self._last, self._in_step = int(found[2]), int(found[3]), True
                    return self._expect_boot(found[1])
            if self.clock.now() > deadline:
                raise self._silent()

    def ask(self, body: str, seconds: float = 0.0) -> Answer:
        """Have a command executed, once; a motion that should last `seconds` is stopped when it lasts much longer.

        Raises Refused with the controller's code, Rebooted, or LinkLost.
        """
        return self._ask(self.sequence, body, seconds)

    def _ask(self, number: int, body: str, seconds: float = 0.0) -> Answer:
        self._in_step = False  # until the answer is here
        now = self.clock.now()
        frame = seal(f"{number} {body}")
        answer = self._exchange(Pending(number, frame, now + seconds + self.timing.slack, seconds > 0, now, now))
        if answer.kind == "ERR":
            code, _, text = answer.text.partition(" ")
            if code == "STOPPED" and self.clock.now() > now + seconds + self.timing.slack:
                code, text = "NOTREACHED", f"stopped from here after {self.clock.now() - now:.0f} s"
            if code == "OLDSEQ":
                self.status()  # a new boot explains it
            raise Refused(code, text)  # whether it was counted depends on the code: greet before the next command
        self._last, self._in_step = number, True
        return answer

    def status(self, request: bytes = b"! HB\n") -> Status:
        """How things stand now; raises Rebooted or LinkLost."""
        for _ in self._listen(0.0):
            pass  # an answer to an earlier heartbeat would be old
        deadline = self.clock.now() + self.timing.silence
        while self.clock.now() < deadline:
            self._send(request)
            for line in self._listen(self.timing.resend / 2):
                if found := STATUS.fullmatch(line):
                    self._expect_boot(found[1])
                    return Status(found[1], found[2] == "RUN", int(found[3]), found[4] == "1", found[5])
        raise self._silent()

    def halt(self) -> None:
        """Stop whatever moves, and return when it stands still; raises LinkLost where nobody answers."""
        self._in_step = False
        self._settle(b"! STOP\n")

    def patiently(self, call: Callable[[], T]) -> T:
        """Call, and where the line is silent or gone open it anew and call again; raises LinkLost in the end."""
        return patiently(call, self._reopen, self.clock, self.timing.patience)

    def _settle(self, request: bytes = b"! HB\n") -> None:
        """Wait until the robot stands still, then count as the controller counts."""

        def settle() -> None:
            while self.status(request).running:
                self.clock.sleep(self.timing.heartbeat / 2)
            self.greet(self.timing.silence)

        self.patiently(settle)

    def _exchange(self, pending: Pending) -> Answer:
        """Send a command until its answer is here; the heartbeat goes on meanwhile."""
        while self.clock.now() < pending.until + self.timing.patience:
            try:
                self._tend(pending)
                for line in self._listen(self.timing.heartbeat / 4):
                    pending.heard = self.clock.now()
                    if answer := self._hear(line, pending):
                        return answer
                if self.clock.now() - pending.heard > self.timing.silence:
                    raise self._silent()
            except LinkLost:
                self._revive(pending)
        raise LinkLost(
            f"command {pending.number} was heard at {self.transport.url}, but never answered; stop the robot"
        )

    def _hear(self, line: str, pending: Pending) -> Answer | None:
        if (found := ANSWER.fullmatch(line)) and int(found[1]) == pending.number:
            pending.acknowledged = True
            return None if found[2] == "ACK" else Answer(found[2], found[3] or "")
        if found := STATUS.fullmatch(line):
            self._expect_boot(found[1])
            pending.again |= found[2] == "IDLE"  # done, and the answer was lost; or the command never arrived
        pending.again |= line == "? NAK"
        return None

    def _tend(self, pending: Pending) -> None:
        """Send what is due: the command again, a heartbeat, or a stop where the motion does not end."""
        now, timing = self.clock.now(), self.timing
        waited = now - pending.sent
        if (pending.again and waited > timing.heartbeat / 4) or (not pending.acknowledged and waited > timing.resend):
            self._send(pending.frame)
            pending.sent, pending.again = now, False
        if now - pending.beat > timing.heartbeat:
            self._send(b"! STOP\n" if pending.moves and now > pending.until else b"! HB\n")
            pending.beat = now

    def _revive(self, pending: Pending) -> None:
        """Open the port anew under a command; raises Refused LOST where the controller never began it."""
        self._reopen()
        self._settle()
        if following(self._last) == pending.number:
            raise Refused("LOST")
        if self._last != pending.number:
            raise LinkLost(
                f"the controller counts {self._last} where {pending.number} was sent; is another program at the line?"
            )
        self._in_step, pending.again, pending.heard = False, True, self.clock.now()

    def _reopen(self) -> None:
        """Open the port anew, once; where that fails, wait a little."""
        self._lines, self._in_step = Lines(), False
        try:
            self.transport.reopen()
        except LinkLost:
            self.clock.sleep(self.timing.resend)

    def _expect_boot(self, boot: str) -> None:
        before, self.boot = self.boot, boot
        if before not in ("", boot):
            self._in_step = False
            raise Rebooted(
                f"the controller at {self.transport.url} has started anew: its position is not trusted any more; check "
                "that it is homed and shows where the robot stands, then go on with --resume --trust-position"
            )

    def _silent(self) -> LinkLost:
        return LinkLost(
            f"nothing answers at {self.transport.url}; is the controller on, and its touch program running?"
        )

    def _send(self, data: bytes) -> None:
        self.transport.write(data)

    def _listen(self, seconds: float) -> Iterator[str]:
        """Valid lines as they come, for so long, or for what has come already where that is 0."""
        until = self.clock.now() + seconds
        while True:
            data = self.transport.read(self.clock.real(until - self.clock.now()))
            yield from filter(None, map(unseal, self._lines.feed(data)))
            if self.clock.now() >= until:
                return
