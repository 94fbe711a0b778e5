"""A six-axis GRBL 1.1 (grblHAL style) before the virtual robot, written from the public interface description.

What it does as the real one does, so that a host learns to live with it:

* A line is answered `ok` or `error:N`; G0 and G1 are answered when they are queued, G38 and G4 when they are done.
* G38.2 and G38.3 that begin in contact: `ALARM:4`, then `ok`. G38.2 without contact: `ALARM:5`, `[PRB:...:0]` with the
  position of the previous probe, then `ok`. G38.3 without contact: `[PRB:...:0]` with the end of the move, no alarm.
* In alarm every G-code and every message is `error:9` until `$X`, `$H` or, after a limit (`ALARM:2`), a reset.
* The probe input is not watched during G0 and G1: a robot driven into the jig goes on. There is no deadman either.
* Positions have three decimals; F counts the length of the move over all axes; axis units are chosen by the user.
* Of a line in error nothing is taken over. A motion without a feed (at the start, or F0) is one: `error:22`.
* After G80 axis words are an error, those of G43.1 too; G4 may stand beside a motion.
* `(MSG,tag)` comes back as `[MSG:tag]`. Real-time bytes `?`, `!`, `~` and Ctrl-X act at once, whatever is in the line.
* `T` names a tool, `$G` tells it, and a reset forgets it; so for `S`, the speed of a spindle that is off. G43.1 shifts
  all axes by a tool offset until G49 or a reset.
* A reset while moving stops the robot, empties the queue and ends in `ALARM:3`.

Quirks to order, as real grblHAL has them: `tool-change` (T is taken over by M6 only), `late-idle` (the first reports
of a motion still say Idle), `same-place` (G38 to where the robot stands is `error:33`), `no-offset` (no G43.1),
`error-lock` (after an error every G-code is answered by the same error, until an empty line, a `$` command or a reset),
`soft-reset` (Ctrl-X forgets neither tool nor tool offset).

Writing a `$` setting is obeyed by a real controller and ruins it; here it is counted in `settings_written`.
"""

import re

import numpy as np
from jaxtyping import Float

from probe.virtual.gcode import NO_FEED, NO_MOTION, Block, read_block
from probe.virtual.grbl_state import AXES, BANNER, LATE, LONGEST, OKAY, QUEUE, RAPID, REALTIME, GrblState, Queued, error
from probe.virtual.records import CONTACT, MOVE, NEVER, SEARCH, Outcome


class GrblController(GrblState):
    """A robot controller that speaks GRBL; bytes go in and whole lines come out, at given times."""

    def restart(self, *, keeps_position: bool = True) -> list[bytes]:
        """Start anew: the banner, and what nobody asked for."""
        self.robot.restart(keeps_position=keeps_position)
        self._start()
        return [BANNER, *self.unsolicited]

    @property
    def due(self) -> float:
        """When this controller does something next by itself [s]."""
        return min(self.robot.due, self._until)

    def excuse(self, until: float) -> None:
        """GRBL does not care whether its host is alive."""

    def advance(self, now: float) -> list[bytes]:
        """Let time pass; the lines sent meanwhile."""
        answers: list[bytes] = []
        while self.due <= now:
            outcome = self.robot.advance(self.due)
            if outcome is not None:
                answers += self._ended(outcome) + self._pump()
            elif self.robot.time >= self._until:
                self._until = NEVER
                answers += self._answered() + self._pump()
        self.robot.advance(now)
        return answers

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Bytes have come; the lines that answer them."""
        answers = self.advance(now)
        for byte in data:
            if byte in REALTIME:
                answers += self._at_once(bytes([byte]))
            elif byte in b"\r\n":
                if self._line or byte == 10:
                    self._lines.append(bytes(self._line))
                self._line.clear()
                answers += self._pump()
            elif byte < 0x80:
                self._line.append(byte)
        return answers

    # --- real-time bytes -----------------------------------------------------------------------------------------

    def _at_once(self, byte: bytes) -> list[bytes]:
        if byte == b"?":
            return [self._report()]
        if byte == b"!" and self.robot.moving:
            self._held = True
            self.robot.stop("HOLD")
        elif byte == b"~" and self._held and not self.robot.moving:
            self._held = False
            return self._pump()
        elif byte == b"\x18":
            return self._reset()
        return []

    def _reset(self) -> list[bytes]:
        """Ctrl-X: a motion is cut off, and the position with it as far as GRBL knows."""
        moving, alarm = self.robot.moving, self.alarm
        self.robot.halt("STOPPED", "reset")
        probed, offsets = (self.probed, self.success), (self.tool, self.offset)
        self._start()
        self.probed, self.success = probed
        if "soft-reset" in self.quirks:
            self.tool, self.offset = offsets
        if moving or alarm:
            self.alarm = 3 if moving else 1
        locked = [b"[MSG:'$H'|'$X' to unlock]\r\n"] if self.alarm else []
        return [*([b"ALARM:3\r\n"] if moving else []), BANNER, *locked]

    # --- lines ---------------------------------------------------------------------------------------------------

    def _pump(self) -> list[bytes]:
        """Take lines while none has to wait, and start what is queued."""
        answers: list[bytes] = []
        while True:
            answers += self._next()
            if not self._lines or self._waiting or len(self._queue) >= QUEUE:
                return answers
            answers += self._read(self._lines.popleft())

    def _read(self, raw: bytes) -> list[bytes]:
        if len(raw) > LONGEST:
            return [error(11)]
        text = raw.decode("ascii", "replace")
        messages = [f"[MSG:{m}]\r\n".encode() for m in re.findall(r"\(MSG,\s*([^)]*)\)", text, re.IGNORECASE)]
        code = re.sub(r"\([^)]*\)|;.*|\s", "", text).upper()
        if self.alarm == 2:
            return []  # a limit: nothing is heard but the reset
        if not text or code.startswith("$"):
            self._lock = b""
            return self._dollar(code) if text else [OKAY]
        if self.alarm or self._lock:
            return [error(9) if self.alarm else self._lock]
        answers = self._block(code) if code else [OKAY]
        if failed := next((answer for answer in answers if answer.startswith(b"error")), b""):
            self._lock = failed if "error-lock" in self.quirks else b""
            return answers
        return messages + answers

    def _block(self, code: str) -> list[bytes]:
        block = read_block(code, AXES[: len(self.unit)])
        if isinstance(block, int):
            return [error(block)]
        motion = block.motion or self.motion
        if block.axes and motion == "G80":
            return [error(NO_MOTION)]
        before, modes = self.modes["feed"], self.modes.copy()
        for g in block.modes:
            modes |= {"distance": g} if g in ("G90", "G91") else {"feed": g} if g in ("G93", "G94") else {}
        feed = block.values.get("F", self.feed_rate if before == modes["feed"] == "G94" else 0.0)
        moves = block.motion or (block.axes and not block.offset)
        if moves and motion not in ("G0", "G80") and feed <= 0:
            return [error(NO_FEED)]
        self.modes, self.feed_rate = modes, feed
        self.tool = self.tool if "tool-change" in self.quirks else int(block.values.get("T", self.tool))
        self.speed = int(block.values.get("S", self.speed))
        self.motion = motion
        self.commands.append(code)
        if block.offset:
            return self._shift(block)
        if block.dwell and not block.axes:  # beside a motion, so short a wait makes no difference
            return self._push(Queued("G4", seconds=block.values.get("P", 0.0)))
        if not block.axes:
            return [OKAY]
        return self._move(np.array([block.axes.get(axis, np.nan) for axis in AXES[: len(self.unit)]]))

    def _shift(self, block: Block) -> list[bytes]:
        """Take or clear a tool offset."""
        if "no-offset" in self.quirks:
            return [error(20)]
        offset = self.offset if block.offset == "G43.1" else np.zeros(len(self.unit))
        self.offset = np.array([block.axes.get(a, k) for a, k in zip(AXES, offset, strict=False)])
        return [OKAY]

    def _move(self, axes: Float[np.ndarray, " joints"]) -> list[bytes]:
        robot = self.robot.cell.robot
        here = robot.to_controller(self._planned) / self.unit
        goal = (
            here + np.nan_to_num(axes)
            if self.modes["distance"] == "G91"
            else np.where(np.isnan(axes), here, axes + self.offset)
        )
        if "same-place" in self.quirks and self.motion.startswith("G38") and np.allclose(goal, here, atol=1e-6):
            return [error(33)]
        target = robot.from_controller(goal * self.unit)
        if ((target < robot.lower) | (target > robot.upper)).any():
            self.alarm = 2
            self._queue.clear()
            self.robot.stop("LIMIT")
            return [b"ALARM:2\r\n", b"[MSG:Reset to continue]\r\n"]
        lengths = 1.0 if self.modes["feed"] == "G93" else float(np.linalg.norm(goal - here))
        seconds = 60 / self.feed_rate * lengths if self.motion != "G0" else 0.0
        farthest = float(np.max(np.abs(goal - here) * self.unit))
        return self._push(Queued(self.motion, target, np.radians(farthest / seconds) if seconds else RAPID))

    def _push(self, queued: Queued) -> list[bytes]:
        """Queue a motion: answered now, or when it is done."""
        self._queue.append(queued)
        if queued.target is not None:
            self._planned = queued.target
        self._waiting = queued.word == "G4" or queued.word.startswith("G38")
        return [] if self._waiting else [OKAY]

    # --- motions -------------------------------------------------------------------------------------------------

    def _next(self) -> list[bytes]:
        """Begin the next motion of the queue."""
        answers: list[bytes] = []
        while self._queue and not self.robot.moving and self._until == NEVER and not self._held and not self.alarm:
            answers += self._begin(self._queue.popleft())
        return answers

    def _begin(self, queued: Queued) -> list[bytes]:
        if queued.target is None:
            self._until = self.robot.time + queued.seconds if queued.seconds else NEVER
            return [] if queued.seconds else self._answered()
        probing = queued.word.startswith("G38")
        self._running = queued
        self._idle_until = self.robot.time + LATE if "late-idle" in self.quirks else 0.0
        refusal = self.robot.begin(SEARCH if probing else MOVE, queued.target, queued.rate, watch=probing)
        if refusal is None:
            return []
        self._running, self.alarm = None, {"ALREADY": 4, "ESTOP": 10, "UNHOMED": 1}.get(refusal.kind, 2)
        self._queue.clear()
        self._planned = self.robot.q
        return [f"ALARM:{self.alarm}\r\n".encode(), *self._answered()]

    def _answered(self) -> list[bytes]:
        waited, self._waiting = self._waiting, False
        return [OKAY] if waited else []

    def _ended(self, outcome: Outcome) -> list[bytes]:
        queued, self._running = self._running, None
        if queued is None:
            return []
        if outcome.kind == "HOLD":
            self._queue.appendleft(queued)
            return []
        if outcome.kind in ("ESTOP", "NOTREACHED"):
            self.alarm = 10 if outcome.kind == "ESTOP" else 1
            self._queue.clear()
            self._planned = self.robot.q
            return [f"ALARM:{self.alarm}\r\n".encode(), *self._answered()]
        if not queued.word.startswith("G38"):
            return []
        return self._probe_ended(queued, outcome)

    def _probe_ended(self, queued: Queued, outcome: Outcome) -> list[bytes]:
        self._planned, self.success = outcome.stop, outcome.kind == CONTACT
        failed = queued.word == "G38.2" and not self.success
        if not failed:
            self.probed = outcome.q
        self.alarm = 5 if failed else self.alarm
        alarm = [b"ALARM:5\r\n"] if failed else []
        return [*alarm, self._probe_line().encode(), *self._answered()]
