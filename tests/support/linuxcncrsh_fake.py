"""linuxcncrsh and the LinuxCNC behind it, as seen from a socket, in time that passes only where somebody waits.

Written from what the real one was seen to do (tests/probe/controllers/test_linuxcnc.py runs against that), with
failures to order.
"""

import re
from collections.abc import Callable

import numpy as np
from touching import Ticks

from probe.line.controller import LinkLost

AXES = "XYZABC"
NEVER_RAN = "never ran"


class FakeLinuxCNC:
    """A transport to a LinuxCNC with six joints in degrees."""

    def __init__(self, clock: Ticks, homed: bool = True) -> None:
        self.url, self.clock = "socket://robot:5007", clock
        self.estop, self.machine, self.mode, self.homed = "OFF", "ON", "MDI", homed
        self.units, self.running_program = ["DEG"] * 6, False
        self.parameters: dict[str, float] = {f"#{n}": 0.0 for n in (5070, 5230, *range(5061, 5067))} | {"#5220": 1.0}
        self.offset = np.zeros(6)
        self.contact_at: float | None = None  # fraction of the next search where the wire touches
        self.closed = False
        self.fail: list[object] = []  # for the next motions: NEVER_RAN, a message that refuses it, or a function
        self.errors: list[str] = []
        self.display: list[str] = []
        self.stolen = 0  # messages that another screen takes
        self.requests: list[str] = []
        self.motions: list[tuple[str, np.ndarray, np.ndarray, float]] = []  # code, start, end, seconds
        self.cut: Callable[[str], bool] = lambda request: False  # after which request the line breaks
        self.on_read: Callable[[], None] = lambda: None
        self.open, self.enabled, self.echo, self.verbose, self.linked = True, False, True, False, False
        self._out, self._in = b"", b""
        self._motion: tuple[np.ndarray, np.ndarray, float, float] | None = None
        self._rest = np.zeros(6)

    # the transport

    def write(self, data: bytes) -> None:
        if not self.open:
            raise LinkLost(f"port {self.url} is gone")
        *lines, self._in = (self._in + data).split(b"\r\n")
        for line in (raw.decode() for raw in lines if raw):
            self.requests.append(line)
            self._hear(line)
            if self.cut(line):
                self.open, self._out = False, b""
                raise LinkLost(f"port {self.url} is gone")

    def read(self, timeout: float) -> bytes:
        if not self.open:
            raise LinkLost(f"port {self.url} is gone")
        self.on_read()
        data, self._out = self._out, b""
        self.clock.sleep(0.0 if data else timeout)
        return data

    def reopen(self) -> None:
        self.open, self.linked, self.enabled, self.echo, self.verbose = True, False, False, True, False
        self._out = self._in = b""

    def close(self) -> None:
        self.open = False

    # the server

    def _say(self, text: str, end: str = "\r\n") -> None:
        self._out += (text + end).encode()

    def _hear(self, line: str) -> None:
        verb, _, rest = line.partition(" ")
        if verb == "hello":
            self.linked = rest.split()[0] == "EMC"
            return self._say("HELLO ACK EMCNETSVR 1.1" if self.linked else "HELLO NAK")
        if not self.linked:
            return None
        if self.echo:
            self._say(line)
        name, _, value = rest.partition(" ")
        if verb == "get":
            found = self._value(name)
            return self._say(f"GET {name.upper()} NAK\r\n" if found is None else f"{name.upper()} {found}")
        if verb != "set":
            return None
        done = self._set(name, value)
        if self.verbose or not done:
            self._say(f"SET {name.upper()} {'ACK' if done else 'NAK'}", "\n\r")
        return None

    def _value(self, name: str) -> str | None:
        if name in ("error", "operator_display", "operator_text"):
            queue = {"error": self.errors, "operator_display": self.display}.get(name, [])
            return queue.pop(0) if queue else "OK"
        match name:
            case "estop" | "machine" | "mode":
                return str(getattr(self, name))
            case "joint_units":
                return " ".join(self.units)
            case "joint_homed":
                return " ".join(["YES" if self.homed else "NO"] * 6)
            case "probe_value":
                return f"{not self._moves() and self.closed:d}"
            case "program_status":
                return "RUNNING" if self.running_program or self._moves() else "IDLE"
            case "joint_pos" | "abs_cmd_pos":
                return " ".join([f"{v:.6f}" for v in self.position().tolist()])
        return None

    def _set(self, name: str, value: str) -> bool:
        if name == "enable":
            self.enabled = value == "EMCTOO"
        elif name in ("echo", "verbose"):
            setattr(self, name, value == "on")
        elif name == "set_wait":
            return self.linked and self.enabled
        elif not self.enabled or name.startswith("SYNC"):
            return False
        elif name in ("estop", "machine", "mode"):
            setattr(self, name, value.upper())
        elif name == "home":
            self.homed = True
        elif name == "abort":
            self._stop()
        elif name == "mdi":
            return self.estop == "OFF" and self.machine == "ON" and self._execute(value)
        return True

    # the machine

    def position(self) -> np.ndarray:
        if self._motion is None:
            return self._rest
        start, end, begun, seconds = self._motion
        return start + min(1.0, (self.clock.now() - begun) / max(seconds, 1e-9)) * (end - start)

    def _moves(self) -> bool:
        return self._motion is not None and self.clock.now() < self._motion[2] + self._motion[3]

    def _stop(self) -> None:
        self.running_program = False
        self._rest, self._motion = self.position(), None

    def _execute(self, line: str) -> bool:
        if not self.homed:
            self.errors.append("Can't issue MDI command when not homed")
            return True
        if line.count("(") != line.count(")"):
            self.errors.append("Unclosed comment found")
            return True
        if found := re.fullmatch(r"\(DEBUG,(touchcal \w+) (.*)\)", line):
            self._show(found[1], found[2].split())
            return True
        failure = self.fail.pop(0) if self.fail and " G" in f" {line}" else None
        if failure == NEVER_RAN:
            return True
        for name, value in re.findall(r"(#<\w+>|#\d+)=(\S+)", line):
            self.parameters[name] = float(value)
        if isinstance(failure, str):
            self.errors.append(failure)
        elif code := re.search(r"G38\.3|G1\b", line):
            self._stop()
            self._move(code[0], dict(re.findall(r"([XYZABCF])(-?[\d.]+)", line)))
            if callable(failure):
                failure()
        self.clock.sleep(0.1)
        return True

    def _move(self, code: str, words: dict[str, str]) -> None:
        start = self._rest
        end = np.array([float(words.get(axis, start[i])) for i, axis in enumerate(AXES)])
        seconds = fed(start, end, float(words["F"]))
        self.motions.append((code, start, end, seconds))
        reached = 1.0
        if code == "G38.3":
            touched = self.contact_at is not None
            reached = self.contact_at if self.contact_at is not None else 1.0
            latched = start + reached * (end - start)
            self.parameters |= {f"#{5061 + i}": v for i, v in enumerate(latched)} | {"#5070": float(touched)}
            self.closed, self.contact_at = touched, None
        elif self.closed:
            self.closed = False
        self._motion = start, start + reached * (end - start), self.clock.now(), reached * seconds

    def trip(self, fraction: float) -> None:
        """The wire touches where no search is: the motion just begun ends there."""
        assert self._motion is not None
        start, end, begun, seconds = self._motion
        self._motion = start, start + fraction * (end - start), begun, fraction * seconds
        self.closed = True
        self.errors.append("Probe tripped during non-probe move.")

    def hold(self) -> None:
        """Feed hold: the motion just begun goes nowhere, and does not end before an abort."""
        self._stop()
        self.running_program = True

    def _show(self, tag: str, names: list[str]) -> None:
        if self._motion is not None:  # heard only behind the motion
            self.clock.t = max(self.clock.t, self._motion[2] + self._motion[3])
        at = {f"#{5420 + i}": v for i, v in enumerate(self.position() - self.offset)}
        known = self.parameters | at
        text = " ".join(f"{known[name]:.6f}" if name in known else "######" for name in names)
        if self.stolen:
            self.stolen -= 1
        else:
            self.display.append(f"{tag} {text}")

    def restart(self) -> None:
        """Power off and on."""
        self._stop()
        self.parameters = {
            k: 0.0 if "507" in k or "506" in k else v for k, v in self.parameters.items() if "<" not in k
        }
        self.estop, self.machine, self.homed, self.open = "ON", "OFF", False, False


def fed(start: np.ndarray, end: np.ndarray, feed: float) -> float:
    """How long LinuxCNC takes [s] at a feed [1/min]: it counts X, Y and Z, and A, B and C where none of those moves."""
    way = end - start
    counted = way[:3] if np.abs(way[:3]).max() > 1e-9 else way[3:]
    return float(np.linalg.norm(counted) / feed * 60)
