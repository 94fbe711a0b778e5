"""A six-axis GRBL 1.1 (grblHAL style) before the virtual robot, written from the public interface description.

What it does as the real one does, so that a host learns to live with it:

* A line is answered `ok` or `error:N`; G0 and G1 are answered when they are queued, G38 and G4 when they are done.
* G38.2 and G38.3 that begin in contact: `ALARM:4`, then `ok`. G38.2 without contact: `ALARM:5`, `[PRB:...:0]` with the
  position of the previous probe, then `ok`. G38.3 without contact: `[PRB:...:0]` with the end of the move, no alarm.
* In alarm every G-code is `error:9` until `$X`, `$H` or, after a limit (`ALARM:2`), a reset.
* The probe input is not watched during G0 and G1: a robot driven into the jig goes on. There is no deadman either.
* Positions have three decimals; F counts the length of the move over all axes; axis units are chosen by the user.
* `(MSG,tag)` comes back as `[MSG:tag]`. Real-time bytes `?`, `!`, `~` and Ctrl-X act at once, whatever is in the line.
* `T` names a tool, `$G` tells it, and a reset forgets it.
* A reset while moving stops the robot, empties the queue and ends in `ALARM:3`.

Writing a `$` setting is obeyed by a real controller and ruins it; here it is counted in `settings_written`.
"""

import re
from collections import deque
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from probe.virtual.gcode import read_block
from probe.virtual.records import CONTACT, MOVE, NEVER, SEARCH, Outcome
from probe.virtual.robot import VirtualRobot

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
LONGEST = 256  # bytes a line
AXES = "XYZABCUVW"
QUEUE = 15  # moves planned ahead
RAPID = 1e6  # [rad/s], as fast as the joints go
REALTIME = b"?!~\x18"
OKAY = b"ok\r\n"


@dataclass(frozen=True, eq=False)
class Queued:
    """A motion that waits for its turn, or a dwell where there is no target."""

    word: str
    target: Float[np.ndarray, " joints"] | None = None  # [rad] or [mm]
    rate: float = 0.0  # [rad/s] of the fastest joint
    seconds: float = 0.0  # of a dwell


class GrblController:
    """A robot controller that speaks GRBL; bytes go in and whole lines come out, at given times."""

    def __init__(self, robot: VirtualRobot, *, axis_unit_deg: float = 1.0, unsolicited: tuple[bytes, ...] = ()) -> None:
        self.robot = robot
        self.unit = np.where(robot.cell.robot.prismatic, 1.0, axis_unit_deg)  # [deg] or [mm] an axis unit
        self.unsolicited = unsolicited  # lines that nobody asked for, after the banner
        self.commands: list[str] = []  # lines executed, for the judge
        self.settings_written = 0
        self._start()

    def _start(self) -> None:
        self.alarm = 0 if self.robot.health.homed else 1
        self.probed, self.success = np.zeros(len(self.unit)), False
        self.modes = {"distance": "G90", "feed": "G94"}
        self.motion, self.feed_rate, self.tool = "G0", 0.0, 0
        self._queue: deque[Queued] = deque()
        self._running: Queued | None = None
        self._held = self._waiting = False  # feed hold; a line that is answered only when the queue is empty
        self._until = NEVER  # [s], the end of a dwell
        self._line, self._lines = bytearray(), deque[bytes]()
        self._planned = self.robot.q

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
        probed = self.probed, self.success
        self._start()
        self.probed, self.success = probed
        if moving or alarm:
            self.alarm = 3 if moving else 1
        locked = [b"[MSG:'$H'|'$X' to unlock]\r\n"] if self.alarm else []
        return [*([b"ALARM:3\r\n"] if moving else []), BANNER, *locked]

    def _report(self) -> bytes:
        moving = self.robot.moving
        held = "Hold:1" if moving else "Hold:0"
        state = "Alarm" if self.alarm else held if self._held else "Run" if moving else "Idle"
        pin = "|Pn:P" if self.robot.contact else ""
        return f"<{state}|MPos:{self._position(self.robot.q)}|FS:{self.feed_rate:.0f},0{pin}>\r\n".encode()

    def _position(self, q: Float[np.ndarray, " joints"]) -> str:
        return ",".join(f"{value:.3f}" for value in self.robot.cell.robot.to_controller(q) / self.unit)

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
            return [_error(11)]
        text = raw.decode("ascii", "replace")
        messages = [f"[MSG:{m}]\r\n".encode() for m in re.findall(r"\(MSG,\s*([^)]*)\)", text, re.IGNORECASE)]
        code = re.sub(r"\([^)]*\)|;.*|\s", "", text).upper()
        if self.alarm == 2:
            return []  # a limit: nothing is heard but the reset
        if code.startswith("$"):
            return messages + self._dollar(code)
        if not code:
            return [*messages, OKAY]
        return messages + ([_error(9)] if self.alarm else self._block(code))

    def _dollar(self, code: str) -> list[bytes]:
        axes = AXES[: len(self.unit)]
        if code == "$I":
            info = f"[VER:1.1h.20240101:]\r\n[OPT:VNMH,{QUEUE},{LONGEST}]\r\n[AXS:{len(axes)}:{axes}]\r\n"
            return [info.encode(), OKAY]
        if code in ("$X", "$H") and self.robot.health.estop:
            return [_error(79)]
        if code in ("$X", "$H"):
            self.alarm = 0
            if code == "$H":
                self.robot.home()
                self._planned = self.robot.q
            return [OKAY] if code == "$H" else [b"[MSG:Caution: Unlocked]\r\n", OKAY]
        if code == "$#":
            zero = ",".join("0.000" for _ in axes)
            return [f"[G54:{zero}]\r\n[G92:{zero}]\r\n{self._probe_line()}".encode(), OKAY]
        if code == "$G":
            modes = f"{self.motion} G54 G17 G21 {self.modes['distance']} {self.modes['feed']}"
            return [f"[GC:{modes} M5 M9 T{self.tool} F{self.feed_rate:g} S0]\r\n".encode(), OKAY]
        if code == "$$":
            return [b"$10=1\r\n$13=0\r\n$20=1\r\n$22=0\r\n", OKAY]
        if re.fullmatch(r"\$\d+=-?[\d.]+", code):
            self.settings_written += 1
            return [OKAY]
        return [_error(3)]

    def _probe_line(self) -> str:
        return f"[PRB:{self._position(self.probed)}:{int(self.success)}]\r\n"

    def _block(self, code: str) -> list[bytes]:
        block = read_block(code, AXES[: len(self.unit)])
        if isinstance(block, int):
            return [_error(block)]
        for g in block.modes:
            self.modes |= {"distance": g} if g in ("G90", "G91") else {"feed": g} if g in ("G93", "G94") else {}
        if self.modes["feed"] == "G94":
            self.feed_rate = block.values.get("F", self.feed_rate)
        self.tool = int(block.values.get("T", self.tool))
        self.commands.append(code)
        if block.motion == "G4":
            return self._push(Queued("G4", seconds=block.values.get("P", 0.0)))
        self.motion = block.motion or self.motion
        if not block.axes:
            return [OKAY]
        return self._move(np.array([block.axes.get(axis, np.nan) for axis in AXES[: len(self.unit)]]), block.values)

    def _move(self, axes: Float[np.ndarray, " joints"], values: dict[str, float]) -> list[bytes]:
        robot = self.robot.cell.robot
        here = robot.to_controller(self._planned) / self.unit
        wanted = here + np.nan_to_num(axes) if self.modes["distance"] == "G91" else np.where(np.isnan(axes), here, axes)
        inverse = self.modes["feed"] == "G93"
        feed = values.get("F", 0.0) if inverse else self.feed_rate
        if self.motion != "G0" and feed <= 0:
            return [_error(22)]
        target = robot.from_controller(wanted * self.unit)
        if ((target < robot.lower) | (target > robot.upper)).any():
            self.alarm = 2
            self._queue.clear()
            self.robot.stop("LIMIT")
            return [b"ALARM:2\r\n", b"[MSG:Reset to continue]\r\n"]
        seconds = 60 / feed * (1.0 if inverse else float(np.linalg.norm(wanted - here))) if self.motion != "G0" else 0.0
        farthest = float(np.max(np.abs(wanted - here) * self.unit))
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


def _error(number: int) -> bytes:
    return f"error:{number}\r\n".encode()
