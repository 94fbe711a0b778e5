"""Put corrected numbers in the place of the old ones, and prove that nothing else has changed."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from identify.programs.correction import Corrected, frame_T_tool
from identify.programs.numbers import Number, decimals, spaces_before, written
from identify.programs.orientation import angle_between
from identify.programs.records import Maker, Record

NOISE = 1e-5  # [mm] or [deg], below which a correction is rounding of the inverse kinematics and no reason to write


def replacements(correction: Corrected, maker: Maker) -> list[tuple[Number, str]]:
    """The numbers of a position that change, and their new texts.

    A number that says the new value already, to its own precision, keeps its text; so does a whole orientation.
    """
    record, values = correction.record, correction.values
    if values is None:
        return []
    numbers = [_same(number, value, least) for number, value, least in _triples(record, values, maker)]
    if record.kind != "joints" and _same_orientation(record, values, maker):
        numbers[3:] = [True] * len(numbers[3:])
    return [
        (number, written(number, value, least, bare=maker.bare))
        for keep, (number, value, least) in zip(numbers, _triples(record, values, maker), strict=True)
        if not keep
    ]


def replaced(text: str, changes: Iterable[tuple[Number, str]]) -> str:
    """A text with numbers, and the spaces before them that they own, replaced."""
    parts, at = list[str](), 0
    for number, new in sorted(changes, key=lambda change: change[0].start):
        parts += [text[at : number.start - number.lead], new]
        at = number.end
    return "".join([*parts, text[at:]])


def skeleton(text: str, records: Sequence[Record]) -> str:
    """A text without the numbers of its positions, and without the spaces before them."""
    numbers = [number for record in records for number in record.numbers]
    wide = [replace(number, lead=spaces_before(text, number.start)) for number in numbers]
    return replaced(text, ((number, "#") for number in wide))


def faithful(correction: Corrected, again: Record, maker: Maker) -> bool:
    """Whether a position read again says what it was to say, within the rounding of its decimals."""
    record, values = correction.record, correction.record.values if correction.values is None else correction.values
    if (record.name, record.kind, len(record.numbers)) != (again.name, again.kind, len(again.numbers)):
        return False
    if not len(values):
        return True
    near = [_same(number, value, least, 1.001) for number, value, least in _triples(again, values, maker)]
    if record.kind != "joints" and _same_orientation(again, values, maker):
        near[3:] = [True] * len(near[3:])
    return all(near)


def _triples(record: Record, values: np.ndarray, maker: Maker) -> Iterable[tuple[Number, float, int]]:
    least = maker.decimals[record.kind][: len(record.numbers)]
    return zip(record.numbers, values.tolist(), least, strict=True)


def _same(number: Number, value: float, least: int, slack: float = 1.0) -> bool:
    return abs(number.value - value) <= max(NOISE, slack * 0.5 * 10.0 ** -decimals(number.text, least))


def _same_orientation(record: Record, values: np.ndarray, maker: Maker) -> bool:
    """Whether the orientation written and a new one differ by less than the last decimal."""
    least = maker.decimals[record.kind]
    unit = 1.0 if record.kind == "euler" else 180 / np.pi
    finest = max(decimals(number.text, few) for number, few in zip(record.numbers[3:], least[3:], strict=True))
    turned = angle_between(frame_T_tool(record, record.values)[:3, :3], frame_T_tool(record, values)[:3, :3])
    return turned < max(NOISE, 0.5 * unit * 10.0**-finest)
