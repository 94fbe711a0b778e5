"""One file of a program: some touches of a plan, and what all of them need to know."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil

import numpy as np

from identify.model.robot import Robot
from probe.programs.options import UNTRIED, Options
from probe.programs.routine import Joints, Routine

STUCK = 2.0  # [s] for the touch input to open
REST = 0.1  # [s] at the contact before the input is read
FAILURES = 3  # touches in a row without a contact that stop the program


@dataclass(frozen=True)
class Part:
    """Touches that one file of a program makes."""

    number: int  # of the file, from 1
    parts: int
    routines: tuple[Routine, ...]
    options: Options
    stamp: int
    speed: float  # [mm/s] of the search
    robot: Robot

    @property
    def name(self) -> str:
        """The name of the program: eight letters are enough for every controller."""
        return f"{'TR' if self.options.rehearsal else 'TC'}{self.number}"

    @property
    def first(self) -> int:
        """The number of its first touch in the plan."""
        return self.routines[0].number

    @property
    def header(self) -> tuple[int, int, int, int]:
        """What the log begins with."""
        return self.stamp, self.first, len(self.routines), round(1000 * self.speed)

    def counts(self, q: Joints) -> Joints:
        """Joint values [rad] as the controller counts them [deg]."""
        return self.robot.to_controller(q)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What every file says of itself."""
        last = self.routines[-1]
        kind = "rehearsal, no search" if self.options.rehearsal else "touches"
        return (
            f"touchcal: {kind}, file {self.number} of {self.parts}",
            f"touches {self.routines[0].id} to {last.id} of the plan, stamp {self.stamp}",
            UNTRIED,
            "Run it slowly first, in the manual mode of the controller.",
        )


def parts(
    routines: Sequence[Routine], options: Options, stamp: int, speed: float, robot: Robot, capacity: int
) -> list[Part]:
    """The touches of a plan, spread evenly over as few files as their capacity allows."""
    most = max(1, min(capacity, options.per_file or capacity))
    count = ceil(len(routines) / most)
    cuts = np.linspace(0, len(routines), count + 1).round().astype(int)
    return [
        Part(k + 1, count, tuple(routines[a:b]), options, stamp, speed, robot)
        for k, (a, b) in enumerate(pairwise(cuts))
    ]


def folded(text: str, width: int) -> Iterator[str]:
    """A remark in lines of limited width."""
    line = ""
    for word in text.split():
        if line and len(line) + 1 + len(word) > width:
            yield line
            line = ""
        line = f"{line} {word}".strip()
    yield line


def joined(joints: Joints, decimals: int, separator: str = ",", pattern: str = "{value}") -> str:
    """Joint values as text; `pattern` may name each by its number."""
    return separator.join(
        pattern.format(number=k + 1, value=f"{value + 0.0:.{decimals}f}")
        for k, value in enumerate(joints.round(decimals))
    )


def percent(share: float) -> int:
    """A share of the joint speed as whole percent, at least one."""
    return max(1, int(100 * share))
