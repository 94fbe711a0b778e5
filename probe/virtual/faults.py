"""Faults to order: spoiled lines in both directions, and mishaps of the controller and its wire.

Written `KIND`, then how often: `:RATE` at random, or `@N` at the N-th line, search or move (from 1); then options:

    bit-flip:0.05           5 % of all lines, both ways        lost-line@7,way=out    the 7th line of the controller
    spoil:0.05,way=in       any of the five, towards the controller
    unplug@3,seconds=2      the cable is out for 2 s in the 3rd search, half-way to what that search meets
    reboot@3,fraction=1     the controller restarts just as the 3rd search touches
    early@2,fraction=0.7    the contact closes at 0.7 of the way of the 2nd move

`fraction` (0.5) is of the time until the contact or the end of the motion, more than 1 is after it. `seconds` is
controller time; `on=search`, `move` or `any` chooses which motions count; an open wire stays so `for=N` searches.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from identify.model.files import InputError, nearest

LINE, SEARCH, MOVE = "line", "search", "move"
KINDS = {
    "bit-flip": (LINE, "one bit of a line is wrong"),
    "lost-byte": (LINE, "one byte of a line is lost"),
    "garbage": (LINE, "bytes that nobody sent come before a line"),
    "duplicate": (LINE, "a line comes twice"),
    "lost-line": (LINE, "a line is lost"),
    "unsolicited": (LINE, "the line `error:7`, which nobody asked for, comes before one of the controller"),
    "spoil": (LINE, "any of bit-flip, lost-byte, garbage, duplicate, lost-line"),
    "unplug": (SEARCH, "the port is gone for some seconds"),
    "reboot": (SEARCH, "the controller starts anew, and keeps its position"),
    "reboot-lost": (SEARCH, "the controller starts anew, and its position is lost"),
    "hang": (SEARCH, "the controller neither hears nor answers for some seconds; its deadman still works"),
    "stuck": (SEARCH, "the contact stays closed for some seconds after it closed"),
    "open": (SEARCH, "the wire is open: no contact is felt"),
    "bounce": (SEARCH, "the contact chatters for some seconds after it closed or opened"),
    "stall": (SEARCH, "the drives stop before the target"),
    "estop": (SEARCH, "the emergency stop is pressed for some seconds"),
    "early": (MOVE, "the contact closes during a move, until the robot has gone back"),
}
SPOILS = ("bit-flip", "lost-byte", "garbage", "duplicate", "lost-line")
SECONDS = {"unplug": 1.0, "reboot": 0.5, "reboot-lost": 0.5, "hang": 3.0, "stuck": 1e9, "bounce": 0.02, "estop": 1e9}
WRITTEN = re.compile(r"(?P<kind>[a-z-]+)(:(?P<rate>[\d.]+)|@(?P<at>\d+))?(?P<options>(,\w+=[\w.]+)*)")


@dataclass(frozen=True)
class Fault:
    """One fault to order; see the module for how it is written."""

    kind: str
    rate: float = 0.0  # probability a line or motion
    at: int = 0  # the line, search or move that is hit, counted from 1; 0: by `rate`
    way: str = "both"  # in: to the controller, out: from it, both
    seconds: float = 0.0
    fraction: float = 0.5
    on: str = ""  # search, move or any: which motions count
    lasts: int = 1  # motions, of an open wire

    @property
    def scope(self) -> str:
        """What it happens to: a line, a search or a move."""
        return KINDS[self.kind][0]


def parse_fault(text: str) -> Fault:
    """A fault from how it is written; raises InputError with the cure."""
    match = WRITTEN.fullmatch(text.strip())
    kind = match["kind"] if match else re.split("[:@,]", text)[0]
    if kind not in KINDS:
        raise InputError(f"fault '{kind}' is unknown{nearest(kind, KINDS)}; there are {', '.join(KINDS)}")
    if match is None:
        raise InputError(f"fault '{text}' cannot be read; write {kind}:0.05 or {kind}@3, then options like ,seconds=2")
    options = dict(part.split("=") for part in match["options"].split(",") if part)
    unknown = set(options) - {"way", "seconds", "fraction", "on", "for"}
    way, scope = ("out" if kind == "unsolicited" else "both"), KINDS[kind][0]
    try:
        fault = Fault(
            kind,
            rate=float(match["rate"] or 0),
            at=int(match["at"] or (0 if match["rate"] else 1)),
            way=options.get("way", way),
            seconds=float(options.get("seconds", SECONDS.get(kind, 0.0))),
            fraction=float(options.get("fraction", 0.5)),
            on=options.get("on", scope),
            lasts=int(options.get("for", 1)),
        )
    except ValueError as error:
        raise InputError(f"fault '{text}': {error}") from None
    if unknown or fault.way not in ("in", "out", "both") or fault.on not in (LINE, SEARCH, MOVE, "any"):
        raise InputError(f"fault '{text}': options are way=in|out|both, seconds=, fraction=, on=search|move|any, for=")
    if not 0 <= fault.rate <= 1:
        raise InputError(f"fault '{text}': a rate is a probability between 0 and 1")
    return fault


@dataclass
class Faults:
    """The faults ordered, and what they have hit so far."""

    ordered: Iterable[Fault]
    rng: np.random.Generator
    happened: list[tuple[str, str, int]] = field(default_factory=list)  # kind, what was hit, its number
    _counts: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.ordered = list(self.ordered)

    def lines(self, data: bytes, way: str) -> list[bytes]:
        """What becomes of bytes on their way, line by line."""
        return [part for line in data.splitlines(keepends=True) for part in self._line(line, way)]

    def _line(self, line: bytes, way: str) -> list[bytes]:
        number = self._count(way)
        parts = [line]
        for fault in self.ordered:
            if fault.scope == LINE and fault.way in (way, "both") and self._strikes(fault, number):
                kind = str(self.rng.choice(SPOILS)) if fault.kind == "spoil" else fault.kind
                self.happened.append((kind, way, number))
                parts = [part for each in parts for part in spoil(kind, each, self.rng)]
        return parts

    def motion(self, kind: str) -> list[Fault]:
        """The faults that hit the motion that begins now."""
        kind = kind.lower()
        numbers = {kind: self._count(kind), "any": self._count("any")}
        struck = []
        for fault in self.ordered:
            if fault.scope != LINE and fault.on in numbers and self._strikes(fault, numbers[fault.on]):
                self.happened.append((fault.kind, kind, numbers[fault.on]))
                struck.append(fault)
        return struck

    def _count(self, what: str) -> int:
        self._counts[what] = self._counts.get(what, 0) + 1
        return self._counts[what]

    def _strikes(self, fault: Fault, number: int) -> bool:
        if fault.at:
            return fault.at <= number < fault.at + (fault.lasts if fault.kind == "open" else 1)
        return bool(self.rng.random() < fault.rate)


def spoil(kind: str, line: bytes, rng: np.random.Generator) -> list[bytes]:
    """What becomes of one line."""
    if kind == "duplicate":
        return [line, line]
    if kind == "lost-line" or not line:
        return []
    if kind == "unsolicited":
        return [b"error:7\r\n", line]
    if kind == "garbage":
        return [rng.bytes(int(rng.integers(1, 24))), line]
    at = int(rng.integers(len(line)))
    changed = bytes([line[at] ^ 1 << int(rng.integers(8))]) if kind == "bit-flip" else b""
    return [line[:at] + changed + line[at + 1 :]]
