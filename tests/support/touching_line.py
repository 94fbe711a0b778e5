"""The controller's side of TOUCH/1 before the robot of `touching`, with every fault to order, in ticking time."""

import binascii
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from touching import SERVO, Ticks, World

from probe.line.controller import LinkLost

DEADMAN = 0.75  # [s]
LATENCY = 0.002  # [s]
Spoil = Callable[[bytes], list[bytes]]


def crc(body: str) -> str:
    return f"{body}*{binascii.crc_hqx(body.encode(), 0xFFFF):04X}\n"


@dataclass
class Running:
    seq: int
    verb: str
    start: np.ndarray
    end: np.ndarray
    began: float
    duration: float
    hit: float | None  # fraction
    stop: float  # fraction at which it comes to rest
    latched: float


@dataclass
class LineServer:
    """A transport with the controller at its other end."""

    world: World
    clock: Ticks
    spoil_in: Spoil = lambda line: [line]
    spoil_out: Spoil = lambda line: [line]
    url: str = "test://line"
    executed: list[tuple[str, int, str]] = field(default_factory=list)  # boot, number and verb
    deaf_until: float = -1.0
    gone_until: float = -1.0
    unplug_after: int = -1  # lines of the host until the cable is pulled
    reboot_after: int = -1
    hang_after: int = -1
    outage: float = 2.0
    estop: bool = False
    homed: bool = True

    def __post_init__(self) -> None:
        self.inbox = b""
        self.outbox = b""
        self.plugged = True
        self.reset()
        self.lines = 0

    def reset(self) -> None:
        self.last, self.answer, self.running = 0, "", None
        self.latch, self.early_back, self.heard = None, None, self.clock.t

    def reboot(self) -> None:
        self._settle_at(self.clock.t)
        self.world.boot = f"{int(self.world.boot, 16) + 1:04X}"
        self.reset()

    # the host's end

    def write(self, data: bytes) -> None:
        self._alive()
        self.inbox += data
        while b"\n" in self.inbox:
            line, self.inbox = self.inbox.split(b"\n", 1)
            self.lines += 1
            if self.lines == self.unplug_after:
                self.plugged, self.gone_until = False, self.clock.t + self.outage
                self.inbox = self.outbox = b""
                self._alive()
            if self.lines == self.reboot_after:
                self.reboot()
            if self.lines == self.hang_after:
                self.deaf_until = self.clock.t + self.outage
            for heard in self.spoil_in(line + b"\n"):
                for piece in heard.split(b"\n"):
                    if piece and self.clock.t >= self.deaf_until:
                        self._hear(piece)

    def read(self, timeout: float) -> bytes:
        self._alive()
        until = self.clock.t + timeout
        while True:
            if self.outbox and self.clock.t >= self.deaf_until:
                self.clock.t += LATENCY
                out, self.outbox = self.outbox, b""
                return out
            event = min([until, *([self._next_event()] if self.running else [])])
            self.clock.t = max(self.clock.t, event)
            self._pass_time()
            if self.clock.t >= until and (not self.outbox or self.clock.t < self.deaf_until):
                return b""

    def reopen(self) -> None:
        if self.clock.t < self.gone_until:
            raise LinkLost("the cable is off")
        self.plugged, self.inbox, self.outbox = True, b"", b""

    def close(self) -> None:
        self.plugged = False

    def _alive(self) -> None:
        self._pass_time()
        if not self.plugged:
            raise LinkLost("the cable is off")

    # the robot's end

    def _next_event(self) -> float:
        run = self.running
        assert run is not None
        return min(run.began + run.stop * run.duration, self.heard + DEADMAN)

    def _pass_time(self) -> None:
        while self.running and self.clock.t >= self._next_event():
            run, at = self.running, self._next_event()
            if at < run.began + run.stop * run.duration:
                self._interrupted(at, "DEADMAN")
            else:
                self._finish(run)

    def _interrupted(self, at: float, code: str) -> None:
        run = self._settle_at(at)
        if run is not None:
            self._answer(run.seq, f"ERR {code}")

    def _settle_at(self, at: float) -> Running | None:
        run, self.running = self.running, None
        if run is not None:
            fraction = min(max((at - run.began) / run.duration, 0.0), run.stop)
            self.world.go(run.end, fraction)
            if run.verb == "MOVE" and run.hit is not None and fraction >= run.hit > 0:
                self.early_back = run.start
        return run

    def _finish(self, run: Running) -> None:
        world = self.world
        self.running = None
        world.go(run.end, run.stop)
        if run.verb == "MOVE":
            if run.hit is None:
                self._answer(run.seq, f"OK q={self._text(world.q)}")
            else:
                self.early_back = run.start if run.hit > 0 else None  # one that ended where it began has no way back
                self._answer(run.seq, "ERR EARLY touched on the way")
        elif run.hit is None:
            self._answer(run.seq, f"NOCONTACT q={self._text(world.q)}")
        else:
            q = run.start + run.latched * (run.end - run.start)
            self.latch = (run.seq, q)
            world.truth.append(run.start + run.hit * (run.end - run.start))
            said = f"CONTACT boot={world.boot} seq={run.seq} q={self._text(q)} stop={self._text(world.q)}"
            self._answer(run.seq, said)

    def _q(self) -> np.ndarray:
        run = self.running
        if run is None:
            return self.world.q
        fraction = min((self.clock.t - run.began) / run.duration, run.stop)
        return run.start + fraction * (run.end - run.start)

    def _text(self, q: np.ndarray) -> str:
        return ",".join(f"{v:.7f}" for v in q / self.world.cell.robot.joint_unit())

    def _say(self, body: str) -> None:
        for line in self.spoil_out(crc(body).encode()):
            self.outbox += line

    def _answer(self, seq: int, body: str) -> None:
        self.answer = f"{seq} {body}"
        self._say(self.answer)

    def _hear(self, raw: bytes) -> None:
        line = raw.decode("latin-1")
        word, _, beat = line.removeprefix("! ").partition(" ")
        if line.startswith("! ") and word in ("HB", "STOP") and (beat.isdecimal() or not beat):
            self.heard = self.clock.t
            if word == "STOP" and self.running:
                self._interrupted(self.clock.t, "STOPPED")
            q = self._q()
            closed = self.world.reads(self.world.touching(q))
            state = "RUN" if self.running else "IDLE"
            where = f"hb={beat or 0} probe={int(closed)} q={self._text(q)}"
            self._say(f"! ST boot={self.world.boot} {state} seq={self.last} {where}")
            return
        body = line.rpartition("*")[0]
        if crc(body) != line + "\n":
            self._say("? NAK")
            return
        self.heard = self.clock.t
        number, _, words = body.partition(" ")
        if not number.isdecimal() or not words:
            self._say("? NAK")
            return
        verb, *rest = words.split(" ")
        seq = int(number)
        if verb == "HELLO":
            joints = len(self.world.q)
            self._say(f"0 OK TOUCH/1 boot={self.world.boot} joints={joints} last={self.last} nonce={rest[0]}")
        elif self.running and seq == self.running.seq:
            self._say(f"{seq} ACK")
        elif seq == self.last:
            self._say(self.answer)
        elif self.running:
            self._say(f"{seq} ERR BUSY")
        elif seq != self.last % 65535 + 1:
            self._say(f"{seq} ERR OLDSEQ")
        else:
            self.last = seq
            self.executed.append((self.world.boot, seq, verb))
            self._execute(seq, verb, rest)

    def _execute(self, seq: int, verb: str, rest: list[str]) -> None:
        world = self.world
        if verb == "LATCH":
            if self.latch is None:
                return self._answer(seq, "ERR NOLATCH")
            return self._answer(seq, f"OK boot={world.boot} seq={self.latch[0]} q={self._text(self.latch[1])}")
        if len(rest) == 3 and rest[2] != f"boot={world.boot}":
            return self._answer(seq, "ERR BOOT")
        if self.estop or not self.homed:
            return self._answer(seq, "ERR ESTOP" if self.estop else "ERR UNHOMED")
        end = np.array([float(v) for v in rest[0].split(",")]) * world.cell.robot.joint_unit()
        start, rate = world.q, np.radians(float(rest[1]))
        if verb == "SEARCH" and world.closed:
            return self._answer(seq, "ERR ALREADY")
        back = self.early_back
        if back is not None and (verb != "MOVE" or (end - start) @ (back - start) <= 0):
            return self._answer(seq, "ERR EARLY only back")
        self.early_back = None
        span = np.abs(end - start).max()
        duration = max(span / rate, 1e-6)
        hit = None if verb == "MOVE" and world.closed else world.first_contact(start, end)
        latched = np.ceil(((hit or 0.0) * duration + world.delay) / SERVO) * SERVO / duration
        stop = 1.0 if hit is None else (hit if verb == "MOVE" else latched + world.over / duration)
        self.running = Running(seq, verb, start, end, self.clock.t, duration, hit, stop, latched)
        self._say(f"{seq} ACK")
        return None


def spoiler(rng: np.random.Generator, share: float, kinds: tuple[str, ...]) -> Spoil:
    """Spoils a share of the lines in one of the ways."""

    def spoil(line: bytes) -> list[bytes]:
        if rng.random() >= share:
            return [line]
        kind = kinds[rng.integers(len(kinds))]
        at = int(rng.integers(len(line)))
        match kind:
            case "lost line":
                return []
            case "duplicate":
                return [line, line]
            case "bit flip":
                return [line[:at] + bytes([line[at] ^ (1 << rng.integers(8))]) + line[at + 1 :]]
            case "lost byte":
                return [line[:at] + line[at + 1 :]]
            case _:
                return [line[:at] + rng.bytes(int(rng.integers(1, 20))) + line[at:]]

    return spoil


SPOILS = ("bit flip", "lost byte", "garbage", "duplicate", "lost line")
