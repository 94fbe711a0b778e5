"""FANUC TP programs as text (.LS): positions stand behind /POS, with user frame, tool and posture each.

Position registers (PR[]), offsets and vision frames are not in the file; they are named. Of several motion groups one
is the robot, the others stay as they are. A posture is `N U T, 0, 0, 0`: flip, up, front, and whole turns of joints 4
to 6. Joint 3 is shown against the horizontal. That `N` is a negative joint 5 follows from postures that are published,
not from a manual.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from identify.programs.numbers import NUMBER, Number, number
from identify.programs.records import Maker, Mention, Positions, Postures, Record, Ref
from identify.programs.setup import Setup
from identify.programs.source import Scanner, Source

POSE = ("X", "Y", "Z", "R", "P", "W")  # R = Rz(R) Ry(P) Rx(W)
TURN = 180.05  # [deg], where a whole turn begins, rounding allowed
FIELD = r"(X|Y|Z|W|P|R|[JE]\d+)\s*=\s*"
VALUE = rf"({NUMBER}|\*+)\s*(mm|deg)?"
MOTION = re.compile(r"^\s*\d*\s*:\s*([JLCAS])\s+(P|PR)\[([^\]:]*)[^\n]*", re.MULTILINE)
MODIFIERS = ("Tool_Offset", "Offset", "VOFFSET", "INC")


@dataclass(frozen=True)
class Config:
    """A posture as FANUC writes it."""

    flip: bool
    up: bool
    front: bool
    turns: tuple[int, ...]


@dataclass
class Group:
    """What stands behind GPn: of one position."""

    number: int
    at: int
    frame: str = ""
    tool: str = ""
    config: Config | None = None
    fields: dict[str, Number] | None = None
    untaught: bool = False


def find(sources: Sequence[Source], setup: Setup) -> list[Positions]:
    """The positions of programs; refuses a broken one."""
    return [_find(source, setup) for source in sources]


def _find(source: Source, setup: Setup) -> Positions:
    if not re.match(r"(\xef\xbb\xbf)?\s*/PROG\b", source.text, re.IGNORECASE):
        source.fail(0, f"found {source.near(0)}, expected /PROG: not a FANUC program as text")
    start = re.search(r"^\s*/POS\b[^\n]*", source.text, re.MULTILINE)
    if start is None:
        source.fail(len(source.text), "the program has no /POS; is it cut short?")
    motions = list(MOTION.finditer(source.text, 0, start.start()))
    incremental, coordinated = (
        {m[3].strip() for m in motions if m[2] == "P" and re.search(rf"\b{word}\b", m[0])} for word in ("INC", "COORD")
    )
    records, others = list[Record](), set[int]()
    for name, line, groups in _positions(Scanner(source, start.end())):
        records += [_record(name, line, g, incremental, coordinated) for g in groups if g.number == setup.group]
        others |= {g.number for g in groups} - {setup.group}
    return Positions(
        tuple(records),
        (*_mentions(source, motions), *_groups(source, others)),
        _used(source.text[: start.start()].partition("/MN")[2]),
    )


def _used(instructions: str) -> frozenset[str] | None:
    """Names of the positions that instructions go to; None where a register chooses them, or no motion stands there."""
    names = frozenset(f"P[{number}]" for number in re.findall(r"(?<![A-Za-z_])P\[\s*(\d+)", instructions))
    return None if not names or re.search(r"\bP\[\s*A?R\[", instructions) else names


def _positions(scan: Scanner) -> Iterator[tuple[str, int, list[Group]]]:
    """Name, line and groups of every position, to /END."""
    while not scan.take(r"/END\b"):
        head = scan.need(r"P\[\s*(\d+)\s*(:\s*\"[^\"\n]*\"\s*)?\]\s*\{", "a position P[n]{ or /END")
        groups = list[Group]()
        while not scan.take(r"\}\s*;"):
            match = scan.need(r"GP(\d+)\s*:", "GPn: or };")
            groups.append(_group(scan, Group(int(match[1]), match.start())))
        yield head[1], scan.source.line(head.start()), groups


def _group(scan: Scanner, group: Group) -> Group:
    """Frame, tool, posture and numbers of one group."""
    group.fields = {}
    if match := scan.take(r"UF\s*:\s*(\d+|F)\s*,?"):
        group.frame = match[1]
    if match := scan.take(r"UT\s*:\s*(\d+|F)\s*,?"):
        group.tool = match[1]
    if scan.take(r"CONFIG\s*:\s*'"):
        group.config = _config(scan)
    while match := scan.take(FIELD):
        value = scan.need(VALUE, f"a number for {match[1]}")
        if "*" in value[1]:
            group.untaught = True
        elif match[1] in group.fields:
            scan.source.fail(match.start(), f"{match[1]} stands twice in one position")
        else:
            group.fields[match[1]] = number(value, 1, padded=True)
        scan.take(",")
    if not group.fields and not group.untaught:
        scan.source.fail(scan.at, f"found {scan.source.near(scan.at)}, expected X = or J1=")
    return group


def _config(scan: Scanner) -> Config | None:
    """The posture between quotation marks; None for one of a robot of another build."""
    match = scan.need(r"([^'\n]*)'\s*,?", "a posture such as 'N U T, 0, 0, 0'")
    words = match[1].replace(",", " ").split()
    letters, turns = [w for w in words if w.isalpha()], [w for w in words if re.fullmatch(r"-?\d+", w)]
    if len(letters) != 3 or letters[0] not in "NF" or letters[1] not in "UD" or letters[2] not in "TB":
        return None
    return Config(letters[0] == "F", letters[1] == "U", letters[2] == "T", tuple(int(turn) for turn in turns))


def _record(index: str, line: int, group: Group, incremental: set[str], coordinated: set[str]) -> Record:
    """The record of the robot's group."""
    fields = group.fields or {}
    joints = [fields[f"J{i}"] for i in range(1, 10) if f"J{i}" in fields]
    reason = "not taught: its numbers are stars" if group.untaught else ""
    reason = reason or ("incremental: it is used with INC" if index in incremental else "")
    reason = reason or ("coordinated: its frame moves with another motion group" if index in coordinated else "")
    if joints:
        return Record(f"P[{index}]", line, "joints", tuple(joints), why=reason)
    missing = [name for name in POSE if name not in fields]
    reason = reason or (f"missing: no {', '.join(missing)}" if missing else "")
    numbers = () if reason else tuple(fields[name] for name in POSE)
    frame = Ref("", np.eye(4)) if group.frame == "0" else Ref("" if group.frame == "F" else group.frame)
    tool = Ref("", np.eye(4)) if group.tool == "0" else Ref("" if group.tool == "F" else group.tool)
    return Record(f"P[{index}]", line, "euler", numbers, frame, tool, group.config, reason)


def _mentions(source: Source, motions: Sequence[re.Match[str]]) -> Iterator[Mention]:
    """Registers and offsets that motions use: the program does not hold them."""
    for motion in motions:
        line, name = source.line(motion.start(3)), f"{motion[2]}[{motion[3].strip()}]"
        if motion[2] == "PR":
            yield Mention(source.name, line, name, "position register: it is in the controller, not in the program")
        for word in MODIFIERS[:3]:
            if re.search(rf"(?<![A-Za-z_]){word}\b", motion[0], re.IGNORECASE):
                yield Mention(source.name, line, name, f"offset: {word} shifts it by what is not in the program")
        if re.search(r"\bCOORD\b", motion[0]):
            yield Mention(source.name, line, name, "coordinated: the frame moves with another group")


def _groups(source: Source, others: set[int]) -> Iterator[Mention]:
    for group in sorted(others):
        yield Mention(source.name, 0, f"GP{group}", "another motion group: its positions stay as they are")


def fits(config: Config | None, postures: Postures) -> Bool[np.ndarray, " solutions"]:
    """Postures that a CONFIG allows; all of them where there is none that is understood."""
    q = postures.degrees
    allowed = np.ones(len(q), dtype=bool)
    if config is None or q.shape[1] < 6:
        return allowed
    allowed &= q[:, 4] > -0.05 if config.flip else q[:, 4] < 0.05
    for joint, turn in zip((3, 4, 5), config.turns, strict=False):
        allowed &= np.abs(q[:, joint] - 360 * turn) < TURN
    if postures.front is not None and postures.above is not None:
        allowed &= (postures.front == config.front) & (postures.above == config.up)
    return allowed


MAKER = Maker("FANUC", find, fits, {"euler": (3,) * 6, "joints": (3,) * 9}, coupled=True, bare=True)
