"""What a virtual GRBL remembers, and what it says of that: reports, offsets, parser state."""

import re
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from probe.virtual.records import NEVER
from probe.virtual.robot import VirtualRobot

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
LONGEST = 256  # bytes a line
AXES = "XYZABCUVW"
LATE = 0.8  # [s] for which the reports of a motion may still say Idle
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


def error(number: int) -> bytes:
    """The answer to a line that GRBL does not take."""
    return f"error:{number}\r\n".encode()


class GrblState:
    """What GRBL remembers between two lines."""

    def __init__(
        self,
        robot: VirtualRobot,
        *,
        axis_unit_deg: float = 1.0,
        unsolicited: tuple[bytes, ...] = (),
        quirks: Iterable[str] = (),
    ) -> None:
        self.robot, self.quirks = robot, frozenset(quirks)
        self.unit = np.where(robot.cell.robot.prismatic, 1.0, axis_unit_deg)  # [deg] or [mm] an axis unit
        self.unsolicited = unsolicited  # lines that nobody asked for, after the banner
        self.commands: list[str] = []  # lines executed, for the judge
        self.settings_written = 0
        self._start()

    def _start(self) -> None:
        self.alarm = 0 if self.robot.health.homed else 1
        self.probed, self.success = np.zeros(len(self.unit)), False
        self.modes = {"distance": "G90", "feed": "G94"}
        self.motion, self.feed_rate, self.tool, self.speed = "G0", 0.0, 0, 0
        self.offset, self._idle_until = np.zeros(len(self.unit)), 0.0
        self._queue: deque[Queued] = deque()
        self._running: Queued | None = None
        self._lock = b""  # the error that the next lines are answered with
        self._held = self._waiting = False  # feed hold; a line that is answered only when the queue is empty
        self._until = NEVER  # [s], the end of a dwell
        self._line, self._lines = bytearray(), deque[bytes]()
        self._planned = self.robot.q

    def _report(self) -> bytes:
        moving = self.robot.moving
        report = "Hold:1" if moving else "Hold:0"
        moving &= self.robot.time >= self._idle_until
        state = "Alarm" if self.alarm else report if self._held else "Run" if moving else "Idle"
        pin = "|Pn:P" if self.robot.contact else ""
        return f"<{state}|MPos:{self._position(self.robot.q)}|FS:{self.feed_rate:.0f},0{pin}>\r\n".encode()

    def _position(self, q: Float[np.ndarray, " joints"]) -> str:
        return ",".join(f"{value:.3f}" for value in self.robot.cell.robot.to_controller(q) / self.unit)

    def _dollar(self, code: str) -> list[bytes]:
        axes = AXES[: len(self.unit)]
        if code == "$I":
            info = f"[VER:1.1h.20240101:]\r\n[OPT:VNMH,{QUEUE},{LONGEST}]\r\n[AXS:{len(axes)}:{axes}]\r\n"
            return [info.encode(), OKAY]
        if code in ("$X", "$H") and self.robot.health.estop:
            return [error(79)]
        if code in ("$X", "$H"):
            self.alarm = 0
            if code == "$H":
                self.robot.home()
                self._planned = self.robot.q
            return [OKAY] if code == "$H" else [b"[MSG:Caution: Unlocked]\r\n", OKAY]
        if code == "$#":
            zero = ",".join("0.000" for _ in axes)
            offset = f"[TLO:{','.join(f'{value:.3f}' for value in self.offset)}]\r\n"
            return [f"[G54:{zero}]\r\n[G92:{zero}]\r\n{offset}{self._probe_line()}".encode(), OKAY]
        if code == "$G":
            modes = f"{self.motion} G54 G17 G21 {self.modes['distance']} {self.modes['feed']}"
            return [f"[GC:{modes} M5 M9 T{self.tool} F{self.feed_rate:g} S{self.speed}]\r\n".encode(), OKAY]
        if code == "$$":
            return [b"$10=1\r\n$13=0\r\n$20=1\r\n$22=0\r\n", OKAY]
        if re.fullmatch(r"\$\d+=-?[\d.]+", code):
            self.settings_written += 1
            return [OKAY]
        return [error(3)]

    def _probe_line(self) -> str:
        return f"[PRB:{self._position(self.probed)}:{int(self.success)}]\r\n"
