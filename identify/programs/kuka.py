"""KUKA programs (.dat, .src): positions are structures such as {X 1.0,Y 2.0,Z 3.0,A 4.0,B 5.0,C 6.0,S 2,T 35}.

Tool and base of a taught position XP1 stand in FP1, those of others where the program sets $TOOL and $BASE before it
moves there. A component that is missing keeps the value it had. Bits of T are the signs of the joints; bit 4 of S (16)
says, in most sources, that the position was taught with the absolute-accuracy model: it must not be corrected twice.
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from identify.programs.kuka_frames import FORGOTTEN, Uses, uses
from identify.programs.kuka_values import Component, Structure, structures
from identify.programs.numbers import Number
from identify.programs.records import Maker, Mention, Positions, Postures, Record, Ref
from identify.programs.setup import Setup
from identify.programs.source import Source, blanked

POSE, AXES = ("X", "Y", "Z", "A", "B", "C"), tuple(f"A{i}" for i in range(1, 7))
DECLARED = re.compile(r"(?:\b(\w+)\s+)?(\$?\w+(?:\[[^\]]*\])?)\s*=\s*$")
MOTION = re.compile(r"^\s*(S?(?:PTP|LIN|CIRC)|SPL)(_REL)?\b", re.IGNORECASE)
POSES, AXIS = {"POS", "E6POS"}, {"AXIS", "E6AXIS"}
ACCURATE = 16  # the bit of S
EITHER = 2.0  # [deg] around zero, where the controller takes either sign (reported by users)


def find(sources: Sequence[Source], setup: Setup) -> list[Positions]:
    """The positions of programs; refuses a broken one. Files of one name belong together."""
    views = [blanked(source.text, r";[^\r\n]*|^[ \t]*&[^\r\n]*", r'"[^"\r\n]*"') for source in sources]
    for source, view in zip(sources, views, strict=True):
        _whole(source, view)
    ownby_file = [structures(source, view) for source, view in zip(sources, views, strict=True)]
    return [_find(i, sources, views, ownby_file) for i in range(len(sources))]


def _whole(source: Source, view: str) -> None:
    """Refuse a file that is cut short or no KUKA program."""
    begin = re.search(r"^\s*(GLOBAL\s+)?(DEF|DEFDAT|DEFFCT)\b", view, re.IGNORECASE | re.MULTILINE)
    if begin is None:
        source.fail(0, f"found {source.near(0)}, expected DEF or DEFDAT: not a KUKA program")
    end = {"DEFDAT": "ENDDAT", "DEFFCT": "ENDFCT"}.get(begin[2].upper(), "END")
    if not re.search(rf"^\s*{end}\b", view[begin.end() :], re.IGNORECASE | re.MULTILINE):
        source.fail(len(source.text), f"{begin[2].upper()} without {end}; is the file cut short?")


def _find(
    which: int, sources: Sequence[Source], views: Sequence[str], ownby_file: Sequence[Sequence[Structure]]
) -> Positions:
    source, view, mine = sources[which], views[which], ownby_file[which]
    stem = Path(source.name).stem.lower()
    together = [i for i, other in enumerate(sources) if Path(other.name).stem.lower() == stem]
    usage = uses([(views[i], ownby_file[i]) for i in together])
    types = {name: kind for i in together for name, kind in _types(ownby_file[i], views[i])}
    places = uses([(view, mine)])  # inline positions: what holds in this very file
    records = [r for s in mine if (r := _record(source, view, s, types, usage, places)) is not None]
    return Positions(tuple(records), tuple(_mentions(source, view)))


def _types(own: Sequence[Structure], view: str) -> Iterator[tuple[str, str]]:
    for structure in own:
        kind, name = _declared(view, structure)
        if kind:
            yield name, kind
    for match in re.finditer(r"\bDECL\s+(?:GLOBAL\s+)?(E6POS|POS|FRAME|E6AXIS|AXIS)\s+(\w+)", view, re.IGNORECASE):
        yield match[2].upper(), match[1].upper()


def _declared(view: str, structure: Structure) -> tuple[str, str]:
    """The type, where it is written, and the name that a structure is given to."""
    line = view[view.rfind("\n", 0, structure.start) + 1 : structure.start]
    match = DECLARED.search(line)
    if match is None:
        return "", ""
    kind = (match[1] or "").upper()
    return kind if kind in POSES | AXIS | {"FRAME", "FDAT"} else "", match[2].upper()


def _record(
    source: Source, view: str, structure: Structure, types: dict[str, str], usage: Uses, here: Uses
) -> Record | None:
    """The position that a structure is; nothing for a structure of another kind."""
    kind, name = _declared(view, structure)
    line_start = view.rfind("\n", 0, structure.start) + 1
    motion = MOTION.match(view[line_start : structure.start])
    kind = kind or types.get(name.split("[")[0], "") or structure.kind
    parts = structure.components
    if not name:
        if motion is None or motion[2]:
            return None
        name = f"{motion[1].upper()} in line {source.line(structure.start)}"
        kind = kind or ("AXIS" if "A1" in parts else "POS")
    elif not kind and {"S", "T"} & parts.keys():
        kind = "POS"
    if kind in AXIS:
        return _joints(source, structure, name)
    taught = kind == "FRAME" and name in usage.taught
    if kind not in POSES and not taught:
        return None
    place = usage.of(name) if name in usage.named or name in usage.taught else here.at(structure.start)
    return _pose(source, structure, name, place)


def _joints(source: Source, structure: Structure, name: str) -> Record:
    numbers, reason = _numbers(structure.components, AXES)
    return Record(name, source.line(structure.start), "joints", numbers, why=reason)


def _pose(source: Source, structure: Structure, name: str, place: tuple[Ref, Ref, str]) -> Record:
    base, tool, why = place
    numbers, reason = _numbers(structure.components, POSE)
    status, turn = (structure.components.get(key, Component("")).integer for key in ("S", "T"))
    if status is not None and status & ACCURATE:
        reason = reason or "absolute accuracy: bit 4 of S says that the robot's own model has corrected it already"
    flags = None if status is None and turn is None else (status, turn)
    return Record(name, source.line(structure.start), "euler", numbers, base, tool, flags, reason or why)


def _numbers(parts: dict[str, Component], names: Sequence[str]) -> tuple[tuple[Number, ...], str]:
    """The numbers of a structure, or why there are not all of them."""
    missing = [name for name in names if name not in parts]
    if missing:
        return (), f"missing: without {', '.join(missing)}, which keeps the value it had"
    computed = [name for name in names if parts[name].number is None]
    if computed:
        return (), f"computed: {', '.join(computed)} is no plain number"
    return tuple(number for name in names if (number := parts[name].number) is not None), ""


def _mentions(source: Source, view: str) -> Iterator[Mention]:
    """Relative motions, and positions that the program shifts while it runs."""
    for match in re.finditer(r"[^\r\n]+", view):
        line, motion = source.line(match.start()), MOTION.match(match[0])
        if motion and motion[2]:
            yield Mention(source.name, line, motion[0].strip(), "incremental: it moves by a distance")
        elif motion and re.search(r"[\w}\]]\s*:\s*[\w{]", match[0]):
            yield Mention(
                source.name, line, motion[0].strip(), "offset: the operator : shifts it by what is not corrected"
            )
        elif shift := re.match(r"\s*(\w+)\.[XYZABC]\s*=(?!=)", match[0], re.IGNORECASE):
            yield Mention(source.name, line, shift[1], "offset: a component is changed while the program runs")
        elif motion is None and re.match(rf"\s*\$(BASE|TOOL)\s*=(?!=)\s*{FORGOTTEN}", match[0], re.IGNORECASE):
            yield Mention(
                source.name, line, match[0].split("=")[0].strip(), "frame: it is computed while the program runs"
            )


def fits(flags: tuple[int | None, int | None], postures: Postures) -> Bool[np.ndarray, " solutions"]:
    """Postures that S and T allow: bit i of T is the sign of joint i + 1, bit 0 of S a wrist behind axis 1."""
    status, turn = flags
    q = postures.degrees
    allowed = np.ones(len(q), dtype=bool)
    for joint in range(q.shape[1] if turn is not None else 0):
        negative = bool(turn >> joint & 1) if turn is not None else False
        allowed &= q[:, joint] < EITHER if negative else q[:, joint] > -EITHER
    if status is not None and turn is None and postures.front is not None:
        allowed &= postures.front == (not status & 1)
    return allowed


MAKER = Maker("KUKA", find, fits, {"euler": (3, 3, 3, 4, 4, 4), "joints": (4,) * 9}, binding=False, pairs=True)
