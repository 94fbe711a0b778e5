"""Stop-and-wait over a line that spoils, loses and repeats: one numbered command, one answer, a fed deadman."""

import math
import secrets
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass

from probe.line.clock import Clock
from probe.line.controller import LinkLost, Rebooted, Refused
from probe.line.framing import Lines, seal, unseal
from probe.line.messages import ANSWER, GREETING, LAST_NUMBER, Answer, Status, following, read_status
from probe.line.retry import T, Timing, patiently
from probe.line.transcript import Transport


@dataclass
class Pending:
    """A command under way: when what was sent and heard last, and whether the controller has it."""

    number: int
    frame: bytes
    until: float  # [s], when it should be done
    moves: bool
    heard: float
    beat: float
    watch: Callable[[Status], str]  # what is wrong with a status of the robot while it moves
    astray: str = ""  # what was wrong: the robot is being stopped
    sent: float = -math.inf
    acknowledged: bool = False
    again: bool = True  # the frame is due


class Link:
    """TOUCH/1 as the host speaks it: numbers, checksums, repeats, heartbeats, and a boot that must stay the same.

    A status counts only if its boot is this one, it answers one of the newest heartbeats, none older than one heard
    already, and its number is that of the last command: a line that comes late or twice is believed by nobody. A
    controller of the first version says no `hb=`; it is driven all the same, `bound` is then False.
    """

    def __init__(self, transport: Transport, clock: Clock, timing: Timing | None = None) -> None:
        self.transport = transport
        self.clock = clock
        self.timing = timing or Timing.of(clock)
        self.boot = ""
        self.joints = 0
        self.bound = True  # whether status and commands carry what binds them
        self._asked = self._answered = secrets.randbelow(LAST_NUMBER)  # heartbeats sent, and the newest one answered
        self._lines = Lines()
        self._last = 0  # number of the last command that the controller has begun
        self._in_step = False  # whether both sides count alike

    @property
    def sequence(self) -> int:
        """The number that the next command will carry; raises Rebooted or LinkLost where both sides must count anew."""
        if not self._in_step:
            self._settle()
        if following(self._last) == 1:  # the number that a controller started anew would take for the next one, too
            self._use_up()
            self.patiently(self.status)
        return following(self._last)

    def greet(self, patience: float) -> None:
        """Say hello, and learn the boot and the last number; raises LinkLost, or Rebooted where the boot is new."""
        deadline = self.clock.now() + patience
        while True:
            nonce = secrets.token_hex(3)
            self._send(seal(f"0 HELLO {nonce}"))
            for line in self._listen(self.timing.resend):
                match = GREETING.fullmatch(line)
                if match and match[4] == nonce:
                    self.joints, self._last, self._in_step = int(match[2]), int(match[3]), True
                    return self._expect_boot(match[1])
            if self.clock.now() > deadline:
                raise self._silent()

    def learn_version(self) -> None:
        """Learn whether the controller binds its status to what was asked; raises LinkLost."""
        deadline, spoiled = self.clock.now() + self.timing.patience, 0
        while self.clock.now() < deadline:
            number = self._beat()
            for line in self._listen(self.timing.resend / 2):
                status = read_status(line)
                if status and status.beat and self._ordinal(status.beat) >= number:
                    self.bound = True
                    return
                if status and not status.beat and spoiled > 2:  # it refuses numbered ones
                    self.bound = False
                    return
                spoiled += line == "? NAK"
            if spoiled > 2:
                self._send(b"! HB\n")
        raise self._silent()

    def ask(self, body: str, seconds: float = 0.0, watch: Callable[[Status], str] = lambda status: "") -> Answer:
        """Have a command executed, once; a motion that should last `seconds` is stopped when it lasts much longer.

        `watch` says what is wrong with a status while the robot moves: it is stopped then. Raises Refused with the
        controller's code, or ASTRAY; Rebooted, or LinkLost.
        """
        return self._ask(self.sequence, body, seconds, watch)

    def _ask(
        self, number: int, body: str, seconds: float = 0.0, watch: Callable[[Status], str] = lambda status: ""
    ) -> Answer:
        self._in_step = False  # until the answer is here
        now, moves = self.clock.now(), seconds > 0
        until = now + (seconds + self.timing.slack if moves else 0.0)
        pending = Pending(number, seal(f"{number} {body}"), until, moves, now, now, watch)
        answer = self._exchange(pending)
        if pending.astray:
            raise Refused("ASTRAY", pending.astray)
        if answer.kind == "ERR":
            code, _, text = answer.text.partition(" ")
            if code == "STOPPED" and self.clock.now() > until:
                code, text = "NOTREACHED", f"stopped from here after {self.clock.now() - now:.0f} s"
            if code in ("OLDSEQ", "BOOT"):
                self.status()  # a new boot explains it
            raise Refused(code, text)  # whether it was counted depends on the code: greet before the next command
        self._last, self._in_step = number, True
        return answer

    def status(self, word: str = "HB") -> Status:
        """How things stand now; raises Rebooted or LinkLost."""
        for _ in self._listen(0.0):
            pass  # an answer to an earlier heartbeat would be old
        deadline, first = self.clock.now() + self.timing.silence, 0
        while self.clock.now() < deadline:
            first = first or self._asked + 1
            self._beat(word)
            for line in self._listen(self.timing.resend / 2):
                status = self._valid(line, first)
                if status is not None and not (self._in_step and status.sequence != self._last):
                    return status
        raise self._silent()

    def _beat(self, word: str = "HB") -> int:
        """Send a heartbeat or a stop with the next number; the count of such lines."""
        self._asked += 1
        self._send(f"! {word} {self._asked % LAST_NUMBER + 1}\n".encode() if self.bound else f"! {word}\n".encode())
        return self._asked

    def _ordinal(self, beat: int) -> int:
        """Which of the lines sent carried a number: the newest that did."""
        return self._asked - (self._asked % LAST_NUMBER + 1 - beat) % LAST_NUMBER

    def _valid(self, line: str, first: int) -> Status | None:
        """A status that answers a heartbeat not before the `first`, nor before one answered already."""
        status = read_status(line)
        if status is None:
            return None
        if self.bound:
            answered = self._ordinal(status.beat) if status.beat else -1
            if answered < max(first, self._answered):
                return None
            self._answered = answered
        self._expect_boot(status.boot)
        return status

    def halt(self) -> None:
        """Stop whatever moves, and return when it stands still; raises LinkLost where nobody answers.

        The next number is used up: a command that is still on its way will not be executed after this.
        """
        self._in_step = False
        self._settle("STOP")
        with suppress(LinkLost):
            self._use_up()

    def _use_up(self) -> None:
        """Use up the next number by a question that moves nothing."""
        number = following(self._last)
        with suppress(Refused):
            if "seq=" not in self._ask(number, "LATCH").text:
                self._settle("STOP")  # an old command of that number was faster
        self._last, self._in_step = number, True

    def patiently(self, call: Callable[[], T]) -> T:
        """Call, and where the line is silent or gone open it anew and call again; raises LinkLost in the end."""
        return patiently(call, self._reopen, self.clock, self.timing.patience)

    def _settle(self, word: str = "HB", pending: Pending | None = None) -> None:
        """Wait until the robot stands still, then count as the controller counts.

        A robot that is not expected to move any more is stopped; LinkLost where it does not obey.
        """
        until = self.clock.now() if pending is None else pending.until
        deadline = max(until, self.clock.now()) + self.timing.patience

        def settle() -> None:
            expected_word = word
            while (status := self.status(expected_word)).running:
                if pending is not None and (astray := pending.watch(status)):
                    pending.astray = pending.astray or astray
                if self.clock.now() > until or (pending is not None and pending.astray):
                    expected_word = "STOP"
                if self.clock.now() > deadline:
                    raise Refused("ASTRAY", "and it does not obey a stop: press the emergency stop")
                self.clock.sleep(self.timing.heartbeat / 2)
            self.greet(self.timing.silence)

        self.patiently(settle)

    def _exchange(self, pending: Pending) -> Answer:
        """Send a command until its answer is here; the heartbeat goes on meanwhile."""
        while self.clock.now() < pending.until + self.timing.patience:
            try:
                self._tend(pending)
                for line in self._listen(self.timing.heartbeat / 4):
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
        if (match := ANSWER.fullmatch(line)) and int(match[1]) == pending.number:
            pending.acknowledged, pending.heard = True, self.clock.now()
            return None if match[2] == "ACK" else Answer(match[2], match[3] or "")
        if (status := self._valid(line, 0)) and status.sequence in (pending.number, self._last):
            pending.heard = self.clock.now()
            pending.again |= not status.running  # done, and the answer was lost; or the command never arrived
            if pending.moves and status.running and not pending.astray:
                pending.astray = pending.watch(status)
                pending.beat = -math.inf if pending.astray else pending.beat  # a stop is due at once
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
            self._beat("STOP" if pending.moves and (now > pending.until or pending.astray) else "HB")
            pending.beat = now

    def _revive(self, pending: Pending) -> None:
        """Open the port anew under a command; raises Refused LOST where the controller never began it."""
        self._reopen()
        self._settle(pending=pending)
        if following(self._last) == pending.number:
            self._use_up()  # it may still be on its way
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
