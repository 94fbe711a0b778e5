"""Structures of KUKA programs, {NAME value,NAME value}, nested or not, with the place of every number."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from identify.programs.numbers import NUMBER, Number, number
from identify.programs.source import Scanner, Source

INTEGER = re.compile(r"'B\s*([01]+)'|'H\s*([0-9A-F]+)'|(-?\d+)", re.IGNORECASE)


@dataclass(frozen=True)
class Component:
    """The value of one component: its text, and the number that it is, if it is one."""

    text: str
    number: Number | None = None

    @property
    def integer(self) -> int | None:
        """What a whole number says, written as 35, 'B100011' or 'H23'."""
        match = INTEGER.fullmatch(self.text.strip())
        if match is None:
            return None
        return int(match[1] or match[2] or match[3], 2 if match[1] else 16 if match[2] else 10)


@dataclass(frozen=True)
class Structure:
    """A structure in braces, its type where it begins with one ({POS: ...}), its components by name."""

    start: int
    end: int
    kind: str = ""
    components: dict[str, Component] = field(default_factory=dict)


def structures(source: Source, view: str) -> list[Structure]:
    """The outermost structures of a program; refuses one that does not close in its line."""
    items, at = list[Structure](), 0
    while (at := view.find("{", at)) >= 0:
        structure = _structure(Scanner(source, at, view))
        items.append(structure)
        at = structure.end
    if (stray := _stray(view, items)) is not None:
        source.fail(stray, "a '}' that nothing has opened")
    return items


def _stray(view: str, structures: list[Structure]) -> int | None:
    """The first closing brace outside of all structures."""
    edges = [0, *(edge for s in structures for edge in (s.start, s.end)), len(view)]
    outside = zip(edges[::2], edges[1::2], strict=True)
    return next((at for a, b in outside if (at := view.find("}", a, b)) >= 0), None)


def _structure(scan: Scanner) -> Structure:
    start = scan.need(r"\{", "'{'").start()
    kind, components = scan.take(r"(\w+)\s*:(?=\s*\w+\s)"), dict[str, Component]()
    end = scan.view.find("\n", start)
    while not scan.take(r"\}"):
        if scan.skip() >= (end if end >= 0 else len(scan.view)):
            scan.source.fail(start, "a '{' that does not close in its line")
        name = scan.need(r"\$?\w+(?:\[[^\]]*\])?", "the name of a component")
        if name[0].upper() in components:
            scan.source.fail(name.start(), f"{name[0]} stands twice in one structure")
        components[name[0].upper()] = _value(scan)
        scan.take(",")
    return Structure(start, scan.at, kind[1].upper() if kind else "", components)


def _value(scan: Scanner) -> Component:
    """The value of a component: a structure, a number, or anything up to a comma."""
    at = scan.skip()
    if scan.view[at : at + 1] == "{":
        inner = _structure(scan)
        return Component(scan.view[inner.start : inner.end])
    value = scan.need(r"[^,{}\r\n]*[^,{}\s]", "a value")
    plain = re.compile(rf"{NUMBER}").fullmatch(value[0])
    if plain is None:
        return Component(value[0])
    there = re.compile(NUMBER).match(scan.view, value.start())
    return Component(value[0], number(there) if there else None)


def assigned(view: str) -> Iterator[tuple[int, str, str]]:
    """Statements NAME = ... that are not in a declaration: place, name, and the right-hand side."""
    for match in re.finditer(r"^[ \t]*(\$?\w+)[ \t]*=(?!=)[ \t]*([^\r\n]*)", view, re.MULTILINE):
        yield match.start(), match[1].upper(), match[2].strip()
