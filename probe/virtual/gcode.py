"""One line of G-code as GRBL takes it: its words, or the number of the error."""

import re
from dataclasses import dataclass

WORD = re.compile(r"([A-Z])([+-]?(?:\d+\.?\d*|\.\d+))")
OFFSETS = {"G43.1", "G49"}
MODES = {"G17", "G21", "G40", "G54", "G80", "G94", "G90", "G91", "G93"}
MOTIONS = {"G0", "G1", "G38.2", "G38.3"}
NOT_A_NUMBER, NOT_A_LETTER, UNSUPPORTED, TWO_MOTIONS, TWICE, NO_AXES, NO_TOOL = 2, 1, 20, 21, 25, 26, 38
NO_FEED = 22  # but for G0 and G80
NO_MOTION = 31  # axis words after G80, those of an offset too
MISSING = 28  # G4 without P
UNUSED = 36  # a word that nothing in the line uses
TOOLS = 255  # the highest number


@dataclass(frozen=True)
class Block:
    """The words of one line."""

    motion: str  # one of MOTIONS, or G80; empty where the line names none
    dwell: bool  # G4
    offset: str  # one of OFFSETS; empty where the line names none
    modes: tuple[str, ...]
    values: dict[str, float]  # of the axes, F, P, N and T
    axes: dict[str, float]


def read_block(code: str, axes: str) -> Block | int:
    """A line without spaces and comments; everything is checked before anything changes."""
    words = WORD.findall(code)
    if "".join(letter + number for letter, number in words) != code:
        return NOT_A_NUMBER if code[:1].isalpha() else NOT_A_LETTER
    gs = [f"G{float(number):g}" for letter, number in words if letter == "G"]
    values = {letter: float(number) for letter, number in words if letter != "G"}
    if len(values) + len(gs) != len(words):
        return TWICE
    if set(gs) - MODES - MOTIONS - OFFSETS - {"G4"} or set(values) - {*axes, "F", "P", "N", "S", "T"}:
        return UNSUPPORTED
    if values.get("T", 0) > TOOLS:
        return NO_TOOL
    motions = [g for g in gs if g in MOTIONS or g == "G80"]
    offsets = [g for g in gs if g in OFFSETS]
    if len(motions) > 1 or len(offsets) > 1 or (offsets and set(motions) & MOTIONS):
        return TWO_MOTIONS
    if ("P" in values) != ("G4" in gs):
        return UNUSED if "P" in values else MISSING
    block = Block(
        "".join(motions),
        "G4" in gs,
        "".join(offsets),
        tuple(g for g in gs if g in MODES),
        values,
        {a: values[a] for a in axes if a in values},
    )
    return NO_AXES if block.motion.startswith("G38") and not block.axes else block
