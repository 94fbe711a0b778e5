"""What a program logged: for each touch a code, the latched joints and those at which the robot came to rest."""

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identify.model.files import InputError, Mistake
from identify.model.io.tables import plan_text
from identify.model.robot import Robot
from identify.model.touch import Plan

JOINTS = 6
NOT_MADE, TOUCHED, MISSED, CLOSED, OPENED, HELD = range(6)
"""The codes: touched; nothing met; closed before the search; open again at rest; closed after the retract."""

HEADER = ("stamp", "first", "count", "speed")  # of a log; the speed in um/s, so that all four are whole numbers
STAMPS = 100_000, 900_000  # the least stamp, and how many there are

Joints = Float[np.ndarray, " joints"]


@dataclass(frozen=True, eq=False)
class Entry:
    """What became of one touch."""

    number: int  # of the touch in the plan, from 1
    code: int
    latch: Joints  # [rad], NaN where none was read
    rest: Joints  # [rad], NaN where none was read
    line: int = 0  # of the log


@dataclass(frozen=True)
class Log:
    """What one file of a program logged."""

    file: str
    stamp: int  # of the plan
    first: int  # number of its first touch in the plan
    count: int  # of touches in that file of the program
    speed: float  # [mm/s] of the search
    entries: tuple[Entry, ...]


def stamp(plan: Plan, robot: Robot, maker: str) -> int:
    """A number that tells plans apart, short enough for a register."""
    digest = hashlib.sha256(f"{maker}\n{plan_text(plan, robot)}".encode()).digest()
    return STAMPS[0] + int.from_bytes(digest[:8], "big") % STAMPS[1]


def header(values: Iterable[float], file: Path, line: int = 0) -> tuple[int, int, int, float]:
    """Stamp, first, count and speed [mm/s] of a log; raises InputError where they are not what a program writes."""
    numbers = [float(value) for value in values]
    whole = len(numbers) == len(HEADER) and all(value.is_integer() for value in numbers)
    if not whole or not (STAMPS[0] <= numbers[0] < sum(STAMPS) and min(numbers[1:]) > 0):
        text = f"its header is {numbers}, expected the four numbers that the program writes ({', '.join(HEADER)})"
        raise fault(file, line, f"{text}; was it saved after the program ran, and from its first register on?")
    return int(numbers[0]), int(numbers[1]), int(numbers[2]), numbers[3] / 1000


def fault(file: Path, line: int, text: str) -> InputError:
    """One mistake in a log."""
    return InputError([Mistake(str(file), line, text)])


def read_lines(path: Path, lines: Sequence[str], to_joints: Callable[[Joints], Joints]) -> Log:
    """A log of lines `touchcal` with the header, `t` with number, code and latch, `r` with number and rest."""
    title: tuple[int, int, int, float] | None = None
    codes: dict[int, tuple[int, int]] = {}
    joints: dict[tuple[str, int], Joints] = {}
    for line, content in enumerate(lines, 1):
        words = content.split()
        if not words or words[0] == "end":
            continue
        try:
            if words[0] == "touchcal":
                title = header([float(word) for word in words[1:]], path, line)
                codes, joints = {}, {}
                continue
            width = {"t": 3, "r": 2}[words[0]]
            if len(words) != width + JOINTS:
                raise ValueError
            number = int(words[1])
            joints[words[0], number] = to_joints(np.array([float(word) for word in words[width:]]))
            if words[0] == "t":
                codes[number] = int(words[2]), line
        except InputError:
            raise
        except (ValueError, KeyError):
            text = f"found '{content[:60]}', expected 't' or 'r', a number and {JOINTS} joints"
            raise fault(
                path, line, f"{text}; is the line cut short? delete it, its touch is then not imported"
            ) from None
    if title is None:
        raise fault(path, 0, "no line 'touchcal ...' in it; give the file that the program wrote")
    plan, first, count, speed = title
    blank = np.full(JOINTS, np.nan)
    entries = tuple(
        Entry(number, code, joints.get(("t", number), blank), joints.get(("r", number), blank), line)
        for number, (code, line) in codes.items()
        if first <= number < first + count
    )
    return Log(str(path), plan, first, count, speed, entries)
