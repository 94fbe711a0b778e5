"""What is said to LinuxCNC in its own language: motions with the right feed, and questions to its parameters."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

AXES = "XYZABC"
BOOT, LAST, SEARCH, TRIPPED = "#<_touchcal_boot>", "#<_touchcal_last>", "#<_touchcal_search>", "#5070"
REPORTED = " ".join([BOOT, LAST, SEARCH, TRIPPED, *(f"#{first + i}" for first in (5061, 5420) for i in range(6))])
RESOLUTION = 5e-7  # [deg] or [mm]: LinuxCNC tells and takes six decimals
SLOWEST = 1e-3  # [deg] or [mm]: ways shorter than this cannot carry a feed, see motion_words
CODES = {  # a piece of LinuxCNC's own messages, and the code of ours that it means
    "limit": "LIMIT",
    "homed": "UNHOMED",
    "already tripped": "ALREADY",
    "Probe tripped during": "EARLY",
}


@dataclass(frozen=True, eq=False)
class Report:
    """What LinuxCNC's parameters say, in degrees or millimetres."""

    boot: str  # empty where nobody has greeted this LinuxCNC yet
    last: int  # number of the last command
    search: int  # number of the last search
    tripped: int  # 1 after a contact, 0 after none, -1 where the search never ran
    latched: Float[np.ndarray, " 6"]
    at: Float[np.ndarray, " 6"]  # where a program would say that the machine is


def read_report(values: Sequence[float]) -> Report:
    """The report in the values of the parameters REPORTED, NaN where one does not exist yet."""
    boot, last, search, tripped = (int(value) if np.isfinite(value) else 0 for value in values[:4])
    return Report(f"{boot:04X}" if boot else "", last, search, tripped, np.array(values[4:10]), np.array(values[10:16]))


def motion_words(start: Float[np.ndarray, " joints"], target: Float[np.ndarray, " joints"], seconds: float) -> str:
    """Axis words and a feed that take so long from `start` to `target` [deg or mm]; empty where hardly anything moves.

    LinuxCNC counts the feed along X, Y and Z alone, and along A, B and C where none of those moves. A motion whose XYZ
    way is all but zero would therefore run as fast as the machine can, if that way were off by its own size: such words
    are left out, so that the way is zero exactly, and those joints stay up to SLOWEST off.
    """
    way = np.where(np.abs(target - start) > RESOLUTION, target - start, 0.0)
    if np.linalg.norm(way[:3]) < SLOWEST:
        way[:3] = 0.0
    length = float(np.linalg.norm(way[:3]) or np.linalg.norm(way[3:]))
    if length < SLOWEST:
        return ""
    words = [f"{axis}{value:.6f}" for axis, value, moves in zip(AXES, target, way, strict=False) if moves]
    return f"{' '.join(words)} F{60 * length / seconds:.9f}"


def code_of(messages: Sequence[str], otherwise: str) -> str:
    """The code that LinuxCNC's messages mean."""
    return next((code for part, code in CODES.items() if any(part in text for text in messages)), otherwise)
