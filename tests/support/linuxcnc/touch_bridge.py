#!/usr/bin/python3
"""TOUCH/1 on TCP port 5010, spoken by LinuxCNC itself through its Python module.

Runs beside LinuxCNC with the system's Python and shares no code with touchcal. It does what DESIGN.md, section 6, asks
of a controller, except that it leaves switching on and homing to the operator.
"""

import binascii
import math
import random
import select
import socket
import time
from contextlib import suppress

import linuxcnc

PORT = 5010
DEADMAN = 0.75  # [s]
TICK = 0.002  # [s]
SETTLED = 0.02  # [s]
NEAR = 1e-3  # [deg]


def seal(body):
    return f"{body}*{binascii.crc_hqx(body.encode(), 0xFFFF):04X}\n".encode()


def unseal(line):
    """The body of a line whose checksum holds; `! HB` and `! STOP` need none."""
    body, star, crc = line.rpartition("*")
    if star and crc == f"{binascii.crc_hqx(body.encode(), 0xFFFF):04X}":
        return body
    return line if line in ("! HB", "! STOP") else None


class Motion:
    """One MOVE or SEARCH under way."""

    def __init__(self, number, verb, target, in_contact):
        self.number, self.verb, self.target, self.in_contact = number, verb, target, in_contact
        self.begun, self.ending = time.monotonic(), None


class Bridge:
    def __init__(self):
        self.boot = f"{random.SystemRandom().randrange(0x10000):04X}"
        self.command, self.stat = linuxcnc.command(), linuxcnc.stat()
        self.last, self.answer, self.motion, self.latch = 0, None, None, None
        self.heard = self.changed = time.monotonic()
        self.seen = None

    def q(self, values=None):
        values = self.stat.joint_actual_position if values is None else values
        return ",".join(f"{value:.6f}" for value in values[:6])

    def still(self):
        """Whether nothing runs, and nothing has moved for a moment."""
        now = time.monotonic()
        if self.seen != self.stat.joint_position:
            self.seen, self.changed = self.stat.joint_position, now
        return self.stat.interp_state == linuxcnc.INTERP_IDLE and now - self.changed > SETTLED

    def closed(self):
        return bool(self.stat.probe_val)

    def hear(self, line):
        """Answers to one line."""
        body = unseal(line)
        if body is None:
            return ["? NAK"]
        self.heard = time.monotonic()
        self.stat.poll()
        if body.startswith("! "):
            if body == "! STOP":
                self.abort("STOPPED")
            state = "RUN" if self.motion else "IDLE"
            return [f"! ST boot={self.boot} {state} seq={self.last} probe={self.closed():d} q={self.q()}"]
        number, _, rest = body.partition(" ")
        verb, *words = rest.split()
        if number == "0" and verb == "HELLO":
            return [f"0 OK TOUCH/1 boot={self.boot} joints=6 last={self.last} nonce={words[0]}"]
        return self.execute(int(number), verb, words)

    def execute(self, number, verb, words):
        if self.motion:
            return [f"{number} ACK" if number == self.motion.number else f"{number} ERR BUSY"]
        if number == self.last and self.answer:
            return [self.answer]
        if number != self.last % 65535 + 1:
            return [f"{number} ERR OLDSEQ"]
        if verb == "LATCH":
            seq, q = self.latch or (0, "")
            self.last = number
            self.answer = f"{number} OK boot={self.boot} seq={seq} q={q}" if seq else f"{number} ERR NOLATCH"
            return [self.answer]
        if verb not in ("MOVE", "SEARCH") or len(words) != 2:
            return [f"{number} ERR SYNTAX {verb}"]
        self.last, self.answer = number, None
        self.begin(number, verb, [float(word) for word in words[0].split(",")], float(words[1]))
        return [f"{number} ACK"] + ([self.answer] if self.answer else [])

    def begin(self, number, verb, target, rate):
        reason = self.unfit(verb, target)
        if reason:
            self.answer = f"{number} ERR {reason}"
            return
        self.command.mode(linuxcnc.MODE_MDI)
        self.command.wait_complete(5)
        way = [b - a for a, b in zip(self.stat.joint_position[:6], target, strict=True)]
        seconds = max(map(abs, way)) / rate
        words = " ".join(f"{axis}{value:.6f}" for axis, value in zip("XYZABC", target, strict=True))
        feed = (math.hypot(*way[:3]) or math.hypot(*way[3:])) / max(seconds, 1e-6) * 60
        self.motion = Motion(number, verb, target, self.closed())
        self.command.mdi(f"G21 G90 G94 {'G38.3' if verb == 'SEARCH' else 'G1'} {words} F{max(feed, 1e-6):.9f}")

    def unfit(self, verb, target):
        if not all(self.stat.homed[:6]):
            return "UNHOMED"
        if self.stat.estop or not self.stat.enabled:
            return "ESTOP"
        limits = [(joint["min_position_limit"], joint["max_position_limit"]) for joint in self.stat.joint[:6]]
        if not all(low <= value <= high for value, (low, high) in zip(target, limits, strict=True)):
            return "LIMIT"
        return "ALREADY" if verb == "SEARCH" and self.closed() else ""

    def abort(self, code):
        if self.motion and not self.motion.ending:
            self.motion.ending = code
            self.command.abort()

    def tick(self):
        """The answer of a motion that has come to its end."""
        self.stat.poll()
        motion = self.motion
        if motion and time.monotonic() - self.heard > DEADMAN:
            self.abort("DEADMAN")
        still = self.still()
        if not motion or time.monotonic() - motion.begun < 0.05 or not still:
            return []
        self.motion = None
        there = max(abs(a - b) for a, b in zip(self.stat.joint_position[:6], motion.target, strict=True)) < NEAR
        if motion.verb == "SEARCH" and self.stat.probe_tripped:
            q = self.q(self.stat.probed_position)
            self.latch = motion.number, q
            self.answer = f"{motion.number} CONTACT boot={self.boot} seq={motion.number} q={q} stop={self.q()}"
        elif motion.ending:
            self.answer = f"{motion.number} ERR {motion.ending}"
        elif there:
            self.answer = f"{motion.number} {'OK' if motion.verb == 'MOVE' else 'NOCONTACT'} q={self.q()}"
        else:
            code = "EARLY" if self.closed() and not motion.in_contact else "NOTREACHED"
            self.answer = f"{motion.number} ERR {code}"
        return [self.answer]


def serve(bridge, host):
    rest = b""
    while True:
        ready, _, _ = select.select([host], [], [], TICK)
        answers = []
        if ready:
            data = host.recv(4096)
            if not data:
                return
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                answers += bridge.hear(line.decode("latin-1"))
        answers += bridge.tick()
        for answer in answers:
            host.sendall(seal(answer))


def wait_for_linuxcnc():
    """The module fails, and for good, where its status is read too early: linuxcncrsh is what LinuxCNC starts last."""
    while True:
        try:
            socket.create_connection(("127.0.0.1", 5007)).close()
            return
        except OSError:
            time.sleep(0.1)


if __name__ == "__main__":
    wait_for_linuxcnc()
    bridge = Bridge()
    with socket.create_server(("127.0.0.1", PORT)) as server:
        while True:
            host, _ = server.accept()
            with host, suppress(ConnectionError):
                serve(bridge, host)
            bridge.abort("DEADMAN")
