"""ABB RAPID modules (.mod): targets are [[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[six external axes]].

Whole numbers in the third place tell a target from tools and work objects, which stay as they are. The tool and work
object of a target are those of the instructions that use it, their frames those declared in the given files. Confdata
are quadrants of axes 1, 4 and 6; cfx says where the wrist stands and the sign of axis 5.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool

from identify.programs.abb_data import Aggregate, aggregates, numbers_of
from identify.programs.abb_frames import Declared, Uses, declared, uses
from identify.programs.records import Maker, Mention, Positions, Postures, Record
from identify.programs.setup import Setup
from identify.programs.source import Source, blanked

TARGET = re.compile(r"\b(robtarget|jointtarget)\s+(\w+)\s*(?:\{[^}]*\}\s*)?:=\s*$", re.IGNORECASE)
ABSOLUTE = re.compile(r"\bMoveAbsJ\s*(?:\\\w+\s*,)?\s*$", re.IGNORECASE)
EDGE = 0.5  # [deg] around a quadrant's edge, where a joint may be said to stand on either side


def find(sources: Sequence[Source], setup: Setup) -> list[Positions]:
    """The targets of modules; refuses a broken one. Tools and work objects are looked for in all of them."""
    views = [blanked(source.text, r"![^\r\n]*", r'"[^"\r\n]*"') for source in sources]
    for source, view in zip(sources, views, strict=True):
        _whole(source, view)
    aggregates_by_file = [aggregates(source, view) for source, view in zip(sources, views, strict=True)]
    declarations = Declared()
    for view, mine in zip(views, aggregates_by_file, strict=True):
        declarations = declared(view, mine, declarations)
    usage = uses(views)
    return [_find(*each, usage, declarations) for each in zip(sources, views, aggregates_by_file, strict=True)]


def _whole(source: Source, view: str) -> None:
    if not re.search(r"^\s*MODULE\s+\w+", view, re.IGNORECASE | re.MULTILINE):
        source.fail(0, f"found {source.near(0)}, expected MODULE: not a RAPID module")
    if not re.search(r"^\s*ENDMODULE\b", view, re.IGNORECASE | re.MULTILINE):
        source.fail(len(source.text), "MODULE without ENDMODULE; is the file cut short?")


def _find(source: Source, view: str, mine: Sequence[Aggregate], usage: Uses, declarations: Declared) -> Positions:
    records, mentions = list[Record](), list(_mentions(source, view))
    for outer in mine:
        kind, name = _declared(view, outer)
        parts = list(_targets(outer))
        targets = [_record(source, view, part, kind) for part in parts]
        for i, (part, record) in enumerate(zip(parts, targets, strict=True), 1):
            if record is not None:
                label = name if len(parts) == 1 else f"{name}{{{i}}}"
                pairs = usage.of(name) if kind else uses([_statement(view, part)], inline=True).of("")
                records.append(_placed(record, label or record.name, pairs, declarations))
        if kind and not any(targets):
            why = "computed: it is not made of plain numbers with whole confdata"
            mentions.append(Mention(source.name, source.line(outer.start), name, why))
    return Positions(tuple(records), tuple(mentions))


def _declared(view: str, outer: Aggregate) -> tuple[str, str]:
    """Type and name of a declared target; nothing for one that stands in an instruction."""
    match = TARGET.search(view, max(0, outer.start - 300), outer.start)
    return (match[1].lower(), match[2]) if match else ("", "")


def _targets(outer: Aggregate) -> Iterator[Aggregate]:
    """An aggregate that is a target, or the targets in it."""
    if outer.shape in {"3,4,4,6", "6,6"}:
        yield outer
    else:
        for item in outer.items:
            if isinstance(item, Aggregate):
                yield from _targets(item)


def _record(source: Source, view: str, part: Aggregate, kind: str) -> Record | None:
    """The record of a target; nothing for lists of numbers that only look like one."""
    numbers, line = numbers_of(part), source.line(part.start)
    name = f"target in line {line}"
    if part.shape == "6,6":
        if kind == "jointtarget" or (not kind and ABSOLUTE.search(view, max(0, part.start - 300), part.start)):
            return Record(name, line, "joints", numbers[:6])
        return None
    flags = tuple(number.text for number in numbers[7:11])
    if not all(re.fullmatch(r"[+-]?\d+", text) for text in flags):
        return None
    length = float(np.linalg.norm([number.value for number in numbers[3:7]]))
    reason = "" if abs(length - 1) < 0.01 else f"orientation: its quaternion has length {length:.3g}, expected 1"
    return Record(name, line, "quaternion", numbers[:7], flags=tuple(int(text) for text in flags), why=reason)


def _placed(record: Record, name: str, pairs: Sequence[tuple[str, str]], declarations: Declared) -> Record:
    """A record with its name, and with the tool and the work object that it is used with."""
    if record.kind == "joints":
        return replace(record, name=name)
    places = [declarations.place(tool, wobj) for tool, wobj in dict.fromkeys(pairs)] or [declarations.place("", "")]
    frame, tool, why = places[0]
    why = why if len(places) == 1 else "frame: it is used with more than one tool or work object"
    return replace(record, name=name, frame=frame, tool=tool, why=record.why or why)


def _statement(view: str, part: Aggregate) -> str:
    """The instruction in which a target stands, the target itself left out."""
    start, end = view.rfind(";", 0, part.start) + 1, view.find(";", part.end)
    return view[start : part.start] + "_" + view[part.end : end + 1 if end >= 0 else len(view)]


def _mentions(source: Source, view: str) -> Iterator[Mention]:
    """Targets that instructions shift."""
    for match in re.finditer(r"\b(Offs|RelTool)\s*\(\s*(\w+)", view, re.IGNORECASE):
        why = f"offset: {match[1]} shifts it by a distance that is not corrected"
        yield Mention(source.name, source.line(match.start()), match[2], why)


def fits(flags: tuple[int, int, int, int], postures: Postures) -> Bool[np.ndarray, " solutions"]:
    """Postures that confdata allow: quadrants of axes 1, 4 and 6, and the sign, elbow and front that cfx counts."""
    q = postures.degrees
    allowed = np.ones(len(q), dtype=bool)
    if q.shape[1] < 6:
        return allowed
    for joint, quadrant in zip((0, 3, 5), flags[:3], strict=True):
        allowed &= (q[:, joint] > 90 * quadrant - EDGE) & (q[:, joint] < 90 * (quadrant + 1) + EDGE)
    exact = allowed & ((q[:, 4] < EDGE) if flags[3] & 1 else (q[:, 4] > -EDGE))
    if postures.front is not None and postures.above is not None:
        exact &= (postures.above == (not flags[3] & 2)) & (postures.front == (not flags[3] & 4))
    return exact if exact.any() else allowed  # older programs leave cfx at 0 whatever the posture


MAKER = Maker("ABB", find, fits, {"quaternion": (3, 3, 3, 6, 6, 6, 6), "joints": (4,) * 6}, binding=False)
