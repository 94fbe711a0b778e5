"""Aggregates of RAPID, [value,[value,value]], with the place of every number."""

import re
from dataclasses import dataclass
from functools import cached_property

from identify.programs.numbers import NUMBER, Number, number
from identify.programs.source import Scanner, Source


@dataclass(frozen=True)
class Leaf:
    """A value that is no aggregate, and the number that it is, if it is one."""

    text: str
    number: Number | None


@dataclass(frozen=True)
class Aggregate:
    """A list in brackets."""

    start: int
    end: int
    items: "tuple[Aggregate | Leaf, ...]"

    @cached_property
    def shape(self) -> str:
        """The lengths of lists of plain numbers, such as 3,4,4,6; empty where anything else is in it."""
        sizes = [
            len(item.items)
            for item in self.items
            if isinstance(item, Aggregate) and all(isinstance(x, Leaf) and x.number for x in item.items)
        ]
        return ",".join(map(str, sizes)) if len(sizes) == len(self.items) else ""


def aggregates(source: Source, view: str) -> list[Aggregate]:
    """The outermost aggregates of a module; refuses one that does not close before its statement ends."""
    items, at = list[Aggregate](), 0
    while (at := view.find("[", at)) >= 0:
        items.append(_aggregate(Scanner(source, at, view)))
        at = items[-1].end
    return items


def _aggregate(scan: Scanner) -> Aggregate:
    start = scan.need(r"\[", "'['").start()
    items = list[Aggregate | Leaf]()
    while True:
        scan.skip()
        if scan.view[scan.at : scan.at + 1] == "[":
            items.append(_aggregate(scan))
        else:
            items.append(_leaf(scan, start))
        if scan.take(r"\]"):
            return Aggregate(start, scan.at, tuple(items))
        if not scan.take(","):
            line = scan.source.line(start)
            scan.source.fail(scan.at, f"found {scan.source.near(scan.at)}, expected ',' or the ']' of line {line}")


def _leaf(scan: Scanner, start: int) -> Leaf:
    """Anything up to a comma or bracket at its own depth."""
    at, depth = scan.at, 0
    while scan.at < len(scan.view) and (depth or scan.view[scan.at] not in ",[];"):
        depth += {"(": 1, ")": -1, "{": 1, "}": -1}.get(scan.view[scan.at], 0)
        if scan.view[scan.at] == ";":
            break
        scan.at += 1
    text = scan.view[at : scan.at].rstrip()
    if not text:
        line = scan.source.line(start)
        scan.source.fail(at, f"found {scan.source.near(at)}, expected a value in the '[' of line {line}")
    plain = re.compile(NUMBER).match(scan.view, at) if re.fullmatch(NUMBER, text) else None
    return Leaf(text, number(plain) if plain else None)


def numbers_of(aggregate: Aggregate) -> tuple[Number, ...]:
    """All numbers in an aggregate, in their order."""
    numbers = list[Number]()
    for item in aggregate.items:
        if isinstance(item, Aggregate):
            numbers += numbers_of(item)
        elif item.number is not None:
            numbers.append(item.number)
    return tuple(numbers)
