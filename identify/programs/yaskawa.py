"""Yaskawa jobs (.JBI): positions stand line by line behind //POS, under headers that hold from there on.

Cartesian positions count in the base, robot or user frame; pulses need the pulses of a degree (joints: of cell.yaml).
P variables belong to the controller and are left alone unless the table says otherwise. Of a posture, front and rear,
upper and lower arm and the whole turns are heeded; what flip means differs between controllers, so which of the two
wrists is meant has to be said by near_deg where it matters.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from identify.programs.numbers import NUMBER, Number, number
from identify.programs.records import Maker, Mention, Positions, Postures, Record, Ref
from identify.programs.setup import Setup
from identify.programs.source import Source

POSITION = re.compile(r"\s*(C|BC|EC|P|BP|EX)(\d+)\s*=\s*")
HEADER = re.compile(r"\s*///(\w+)\s*([^\r\n]*)")
PLACES = {"BASE": "", "ROBOT": "", "USER": "user"}
ROUND = 0.001  # [deg]


@dataclass(frozen=True)
class Header:
    """What the header lines said last."""

    tool: str = ""
    user: str = ""
    place: str = ""
    form: str = ""
    config: tuple[int, ...] = ()


def find(sources: Sequence[Source], setup: Setup) -> list[Positions]:
    """The positions of jobs; refuses a broken one."""
    return [_find(source, setup) for source in sources]


def _find(source: Source, setup: Setup) -> Positions:
    lines = list(re.finditer(r"[^\r\n]*\S[^\r\n]*", source.text))
    names = [line[0].strip() for line in lines]
    if not any(name == "/JOB" for name in names[:3]):
        source.fail(0, f"found {source.near(0)}, expected /JOB: not a Yaskawa job")
    if "//INST" not in names or "END" not in names[-2:]:  # a control-Z may follow
        source.fail(len(source.text), "the job has no //INST or no END; is it cut short?")
    if "//POS" not in names:
        return Positions(())
    first, last = names.index("//POS"), names.index("//INST")
    if last < first:
        source.fail(lines[last].start(), "//INST stands before //POS")
    records = tuple(_positions(source, lines[first + 1 : last], setup))
    return Positions(
        records, tuple(_mentions(source, lines[last:])), _used(records, source.text[lines[last].start() :])
    )


def _used(records: Sequence[Record], instructions: str) -> frozenset[str] | None:
    """Names of the positions that instructions go to, of the job or of none; None where there are none."""
    places = {(letter, int(number)) for letter, number in re.findall(r"\b([CP])(\d+)\b", instructions)}
    names = {int(record.name[1:]) for record in records if record.name[0] == "C"}
    motions = re.findall(r"\bS?MOV[JLCS]\s+C(\d+)", instructions)
    absent = {f"C{number}" for number in motions if int(number) not in names}
    return frozenset(r.name for r in records if (r.name[0], int(r.name[1:])) in places).union(absent) or None


def _positions(source: Source, lines: Sequence[re.Match[str]], setup: Setup) -> Iterator[Record]:
    """The robot's positions, line by line."""
    header = Header()
    for line in lines:
        if match := HEADER.match(source.text, line.start(), line.end()):
            header = _header(header, match[1], match[2].strip())
        elif match := POSITION.match(source.text, line.start(), line.end()):
            if match[1] in {"C", "P"}:
                yield _record(source, match, line.end(), header, setup)
        elif line[0].strip() and not line[0].lstrip().startswith(("/", "'")):
            source.fail(line.start(), f"found {source.near(line.start())}, expected a position such as C00000=")


def _header(header: Header, key: str, value: str) -> Header:
    if key == "TOOL":
        return replace(header, tool=value)
    if key == "USER":
        return replace(header, user=value)
    if key == "POSTYPE":
        return replace(header, place=value)
    if key in {"RECTAN", "PULSE", "ANGLE"}:
        return replace(header, form=key)
    if key == "RCONF":
        return replace(header, config=tuple(int(word) if word.strip().isdigit() else 0 for word in value.split(",")))
    return header


def _record(source: Source, match: re.Match[str], end: int, header: Header, setup: Setup) -> Record:
    """One position under the headers above it."""
    numbers = _numbers(source, match.end(), end)
    name, line = match[1] + match[2], source.line(match.start())
    form = header.form or ("PULSE" if header.place == "PULSE" else "RECTAN")
    reason = "position variable: it lives in the controller, other jobs may use it"
    reason = reason if match[1] == "P" and not setup.position_variables else ""
    if form == "RECTAN":
        if len(numbers) < 6:
            source.fail(end, f"{name} has {len(numbers)} numbers, expected X, Y, Z, Rx, Ry, Rz")
        x, y, z, rx, ry, rz = numbers[:6]
        if header.place not in PLACES:
            reason = reason or f"frame: positions of type {header.place or '(none)'} have no frame to correct in"
        frame = Ref(header.user) if PLACES.get(header.place) else Ref("", np.eye(4))
        return Record(name, line, "euler", (x, y, z, rz, ry, rx), frame, Ref(header.tool), header.config, reason)
    pulses = setup.joints.pulses
    if form == "PULSE" and not pulses:
        reason = (
            reason or "pulses: their number a degree is not known; write joints: {pulses_per_deg: [...]} in cell.yaml"
        )
    per_degree = np.array(pulses) if form == "PULSE" and pulses else None
    joints = len(numbers) if per_degree is None else len(per_degree)
    return Record(name, line, "joints", tuple(numbers[:joints]), why=reason, per_degree=per_degree)


def _numbers(source: Source, at: int, end: int) -> list[Number]:
    """Numbers parted by commas, to the end of the line."""
    numbers, part = list[Number](), re.compile(rf"\s*({NUMBER})\s*")
    while True:
        match = part.match(source.text, at, end)
        if match is None:
            source.fail(at, f"found {source.near(at)}, expected a number")
        numbers.append(number(match, 1))
        at = match.end()
        if at == end:
            return numbers
        if source.text[at] != ",":
            source.fail(at, f"found {source.near(at)}, expected a comma or the end of the line")
        at += 1


def _mentions(source: Source, lines: Sequence[re.Match[str]]) -> Iterator[Mention]:
    """Shifts and variables that motions use."""
    for line in lines:
        text = line[0].strip()
        if re.match(r"(SFTON|MSHIFT)\b", text):
            yield Mention(
                source.name, source.line(line.start()), text.split()[0], "offset: what it shifts by is not here"
            )
        elif match := re.match(r"(?:MOV[JLCS]|IMOV|REFP)\s+(?:\d+\s+)?(P(?:\d+|\[[^\]]*\]))", text):
            why = "position variable: it lives in the controller"
            yield Mention(source.name, source.line(line.start()), match[1], why)
        elif re.match(r"IMOV\b", text):
            yield Mention(source.name, source.line(line.start()), "IMOV", "incremental: it moves by a distance")


def fits(config: tuple[int, ...], postures: Postures) -> Bool[np.ndarray, " solutions"]:
    """Postures that RCONF allows: lower arm, rear, and R, T, S beyond 180 degrees; flip is not heeded."""
    q = postures.degrees
    allowed = np.ones(len(q), dtype=bool)
    if len(config) < 3 or q.shape[1] < 6:
        return allowed
    if postures.front is not None and postures.above is not None:
        allowed &= (postures.front == (config[2] == 0)) & (postures.above == (config[1] == 0))
    for joint, far in zip((3, 5, 0), config[3:6], strict=False):
        allowed &= np.abs(q[:, joint]) > 180 - ROUND if far else np.abs(q[:, joint]) < 180 + ROUND
    return allowed


MAKER = Maker("Yaskawa", find, fits, {"euler": (3, 3, 3, 4, 4, 4), "joints": (0,) * 9})
