"""The controller's side of TOUCH/1 (DESIGN section 6), written from its text alone.

Where the text leaves a choice, this controller does the plain thing, and a host must live with it:

* A heartbeat or a stop without a number is answered with `hb=0`; a MOVE or SEARCH without `boot=` is executed. With
  `first_version` the controller knows neither, as programs of the first version do.
* A line that cannot be read at all (its CRC fails, it is no ASCII, it has no number) is answered `? NAK`; so is a line
  of more than 200 bytes, and a line beginning with `!` that is neither HB nor STOP. Empty lines are not answered.
* Until the first HELLO after a start, every command is answered `n ERR OLDSEQ say HELLO first`.
* The next command carries `last + 1` (1 after 65535). `last` itself is answered as before. Any other number is OLDSEQ,
  or BUSY while a motion runs. HELLO is answered at any time and changes nothing.
* A number is used up as soon as its command is read, be it refused: SYNTAX, LIMIT, ALREADY and so on are last answers.
* A motion refused before it begins is answered by its ERR alone, without ACK.
* The move back that EARLY leaves open is not watched: it may graze what was met once more.
* Inside a motion LATCH is BUSY. The latch stays until the next one, and dies with the boot.
* A motion that is stopped (STOPPED, DEADMAN) brakes first; its last answer comes when the robot stands.
"""

import binascii
import re
from collections.abc import Callable

import numpy as np

from probe.virtual.records import CONTACT, MOVE, NEVER, NOCONTACT, OK, SEARCH, Outcome
from probe.virtual.robot import VirtualRobot

LONGEST = 200  # bytes a line
HIGHEST = 65535
DEADMAN = 0.75  # [s]
URGENT = re.compile(r"(HB|STOP)(?: (\d{1,9}))?")
NUMBERED = re.compile(r"(\d{1,5}) (\S.*)")
DECIMAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)")


def crc(text: str) -> str:
    """CRC-16/CCITT of a line before its star, as the protocol writes it."""
    return f"{binascii.crc_hqx(text.encode('ascii'), 0xFFFF):04X}"


class LineController:
    """A robot controller that speaks TOUCH/1; bytes go in and whole lines come out, at given times."""

    def __init__(
        self, robot: VirtualRobot, rng: np.random.Generator, *, deadman: float = DEADMAN, first_version: bool = False
    ) -> None:
        self.robot, self.rng, self.deadman, self.first_version = robot, rng, deadman, first_version
        self.commands: list[tuple[str, int, str]] = []  # boot, number and text of what was executed, for the judge
        self.boot = ""
        self._start()

    def _start(self) -> None:
        old = self.boot
        while self.boot == old:
            self.boot = f"{self.rng.integers(1 << 16):04X}"
        self.last, self.answer, self.running = 0, "", False
        self.greeted, self.dead, self.heard = False, False, self.robot.time
        self.latch: tuple[int, np.ndarray] | None = None
        self._buffer, self._touches = b"", len(self.robot.touches)

    def restart(self, *, keeps_position: bool = True) -> list[bytes]:
        """Start anew with another boot number; nothing is remembered."""
        self.robot.restart(keeps_position=keeps_position)
        self._start()
        return []

    @property
    def due(self) -> float:
        """When this controller does something next by itself [s]."""
        if not self.robot.moving:
            return NEVER
        return min(self.robot.due, NEVER if self.dead else self.heard + self.deadman)

    def excuse(self, until: float) -> None:
        """Forgive the host its silence until a time: that time is jumped over, nobody had a chance to speak."""
        self.heard = max(self.heard, until)

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Bytes have come; the lines that answer them."""
        answers = self.advance(now)
        self._buffer += data
        *lines, self._buffer = self._buffer.split(b"\n")
        self._buffer = self._buffer[: LONGEST + 1]  # what is too long already stays too long
        for line in lines:
            answers += self._read(line.removesuffix(b"\r"))
        return answers

    def advance(self, now: float) -> list[bytes]:
        """Let time pass; the lines sent meanwhile."""
        answers = []
        while self.due <= now:
            outcome = self.robot.advance(self.due)
            if outcome is not None:
                answers.append(self._finish(outcome))
            elif not self.dead and self.robot.time >= self.heard + self.deadman:
                self.dead = True
                self.robot.stop("DEADMAN", f"nothing heard for {self.deadman:g} s")
        self.robot.advance(now)
        return answers

    def _finish(self, outcome: Outcome) -> bytes:
        self.running = False
        if len(self.robot.touches) > self._touches:
            self.latch = self.last, self.robot.touches[-1].latch
        self.answer = self._ended(outcome)
        return self._line(f"{self.last} {self.answer}")

    def _ended(self, outcome: Outcome) -> str:
        if outcome.kind == CONTACT:
            for decimals in (6, 5, 3, 1):  # of a robot with many joints, the place of rest is told less exactly
                where = f"q={self._joints(outcome.q)} stop={self._joints(outcome.stop, decimals)}"
                text = f"CONTACT boot={self.boot} seq={self.last} {where}"
                if len(self._line(f"{self.last} {text}")) <= LONGEST:
                    break
            return text
        if outcome.kind in (OK, NOCONTACT):
            return f"{outcome.kind} q={self._joints(outcome.q)}"
        return f"ERR {outcome.kind} {outcome.text}".rstrip()

    def _line(self, text: str) -> bytes:
        return f"{text}*{crc(text)}\n".encode("ascii")

    def _joints(self, q: np.ndarray, decimals: int = 6) -> str:
        decimals = min(decimals, 6 if len(q) <= 6 else 5)  # two sets of joints fit into one line
        return ",".join(f"{value:.{decimals}f}" for value in self.robot.cell.robot.to_controller(q))

    def _read(self, raw: bytes) -> list[bytes]:
        text = _readable(raw)
        if text == "":
            return []
        if text is None:
            return [self._line("? NAK")]
        if text.startswith("!"):
            return self._at_once(text[1:].strip())
        numbered = NUMBERED.fullmatch(text)
        if numbered is None or int(numbered[1]) > HIGHEST:
            return [self._line("? NAK")]
        self.heard = self.robot.time
        number, body = int(numbered[1]), numbered[2].split()
        answer = self._hello(body) if number == 0 else self._numbered(number, body)
        return [self._line(f"{number} {answer}")]

    def _at_once(self, word: str) -> list[bytes]:
        urgent = URGENT.fullmatch(word)
        if urgent is None or (self.first_version and urgent[2]):
            return [self._line("? NAK")]
        self.heard = self.robot.time
        if urgent[1] == "STOP":
            self.robot.stop("STOPPED", "the host said STOP")
        state, probe = "RUN" if self.robot.moving else "IDLE", int(self.robot.contact)
        beat = "" if self.first_version else f" hb={urgent[2] or 0}"
        where = f"seq={self.last}{beat} probe={probe} q={self._joints(self.robot.q)}"
        return [self._line(f"! ST boot={self.boot} {state} {where}")]

    def _hello(self, body: list[str]) -> str:
        if len(body) != 2 or body[0] != "HELLO":
            return "ERR SYNTAX number 0 is for HELLO and a nonce"
        self.greeted = True
        joints = len(self.robot.cell.robot.joints)
        return f"OK TOUCH/1 boot={self.boot} joints={joints} last={self.last} nonce={body[1]}"

    def _numbered(self, number: int, body: list[str]) -> str:
        if not self.greeted:
            return "ERR OLDSEQ say HELLO first"
        if self.running:
            return "ACK" if number == self.last else f"ERR BUSY {self.last} is running"
        if number == self.last:
            return self.answer
        if number != self.last % HIGHEST + 1:
            return f"ERR OLDSEQ expected {self.last % HIGHEST + 1}"
        self.last = number
        self.commands.append((self.boot, number, " ".join(body)))
        execute: dict[str, Callable[[list[str]], str]] = {
            MOVE: self._motion,
            SEARCH: self._motion,
            "LATCH": self._latch,
        }
        self.answer = execute.get(body[0], self._unknown)(body)
        return self.answer

    def _unknown(self, body: list[str]) -> str:
        return "ERR SYNTAX expected MOVE, SEARCH or LATCH"

    def _latch(self, body: list[str]) -> str:
        if len(body) != 1:
            return "ERR SYNTAX LATCH stands alone"
        if self.latch is None:
            return "ERR NOLATCH nothing latched since the start"
        return f"OK boot={self.boot} seq={self.latch[0]} q={self._joints(self.latch[1])}"

    def _motion(self, body: list[str]) -> str:
        robot = self.robot.cell.robot
        if len(body) == 4 and body[3].startswith("boot=") and not self.first_version:
            if body[3] != f"boot={self.boot}":
                return f"ERR BOOT this start is {self.boot}"
            body = body[:3]
        values = [*body[1].split(","), body[2]] if len(body) == 3 else []
        if len(values) != len(robot.joints) + 1 or not all(DECIMAL.fullmatch(value) for value in values):
            return f"ERR SYNTAX expected {body[0]}, {len(robot.joints)} joints between commas, and a rate"
        *q, rate = (float(value) for value in values)
        self._touches = len(self.robot.touches)
        refusal = self.robot.begin(body[0], robot.from_controller(np.array(q)), np.radians(rate))
        if refusal is not None:
            return self._ended(refusal)
        self.running, self.dead = True, False
        return "ACK"


def _readable(raw: bytes) -> str | None:
    """The text of a line before its star; None where it is spoiled. Lines beginning with `!` need no CRC."""
    if len(raw) > LONGEST or not raw.isascii():
        return None
    text, star, check = raw.decode("ascii").rpartition("*")
    if not star:
        return check if not check or check.startswith("!") else None
    return text if check == crc(text) else None
