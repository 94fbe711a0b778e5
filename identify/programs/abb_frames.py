"""Which tool and work object a RAPID target is used with, and what frames those are."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from identify.programs.abb_data import Aggregate, Leaf, numbers_of
from identify.programs.orientation import from_quaternion
from identify.programs.records import Ref

DATA = re.compile(r"\b(tooldata|wobjdata)\s+(\w+)\s*:=\s*$", re.IGNORECASE)
MOVES = re.compile(
    r"(?:^|(?<=[;\n]))\s*((?:Move|Trigg|Search|Arc|Spot|Disp|Cap|Paint|Laser|Continuous)\w*)\s+([^;]*);", re.IGNORECASE
)
Place = tuple[Ref, Ref, str]  # frame, tool, and why a target cannot be corrected


@dataclass(frozen=True)
class Declared:
    """Tools and work objects by name, lower case."""

    tools: Mapping[str, tuple[Ref, str]] = field(default_factory=dict)
    frames: Mapping[str, tuple[Ref, str]] = field(default_factory=dict)

    def place(self, tool: str, wobj: str) -> Place:
        """Frame and tool of a target used with these names; tool0 and wobj0 are the flange and the base."""
        at, why_frame = self.frames.get(wobj.lower(), (Ref(wobj), ""))
        with_, why_tool = self.tools.get(tool.lower(), (Ref(tool), ""))
        at = Ref("", np.eye(4)) if wobj.lower() in {"", "wobj0"} else at
        with_ = Ref("", np.eye(4)) if tool.lower() == "tool0" else with_
        return at, with_, why_frame or why_tool


@dataclass(frozen=True)
class Uses:
    """Names of tools and work objects by the target that they are used with, lower case."""

    pairs: Mapping[str, Sequence[tuple[str, str]]]

    def of(self, name: str) -> Sequence[tuple[str, str]]:
        """Tools and work objects that a target is used with."""
        return self.pairs.get(name.lower(), [])


def declared(view: str, aggregates: Sequence[Aggregate], before: Declared) -> Declared:
    """Tools and work objects of one module, added to those known before."""
    tools, frames = dict(before.tools), dict(before.frames)
    for aggregate in aggregates:
        match = DATA.search(view, max(0, aggregate.start - 300), aggregate.start)
        if match and match[1].lower() == "tooldata":
            tools[match[2].lower()] = _tool(match[2], aggregate)
        elif match:
            frames[match[2].lower()] = _wobj(match[2], aggregate)
    return Declared(tools, frames)


def _tool(name: str, data: Aggregate) -> tuple[Ref, str]:
    """The frame of [robhold, tframe, load]."""
    T = _pose(data.items[1]) if len(data.items) == 3 else None
    why = "" if _says(data, 0, "TRUE") else "frame: its tool stands still and the robot holds the work"
    return (Ref(name), why) if T is None else (Ref(name, T), why)


def _wobj(name: str, data: Aggregate) -> tuple[Ref, str]:
    """The frame of [robhold, ufprog, ufmec, uframe, oframe]."""
    if len(data.items) != 5:
        return Ref(name), ""
    user, object_ = _pose(data.items[3]), _pose(data.items[4])
    why = "" if _says(data, 0, "FALSE") else "frame: the robot holds its work object"
    why = why or ("" if _says(data, 1, "TRUE") else "frame: its work object moves with another mechanism")
    return (Ref(name), why) if user is None or object_ is None else (Ref(name, user @ object_), why)


def _says(data: Aggregate, index: int, word: str) -> bool:
    item = data.items[index]
    return isinstance(item, Leaf) and item.text.upper() == word


def _pose(item: Aggregate | Leaf) -> np.ndarray | None:
    if not isinstance(item, Aggregate) or item.shape != "3,4":
        return None
    values = np.array([number.value for number in numbers_of(item)])
    T = np.eye(4)
    T[:3, 3], T[:3, :3] = values[:3], from_quaternion(values[3:])
    return T


def uses(views: Sequence[str], *, inline: bool = False) -> Uses:
    """Tools and work objects by target, of all motion instructions; `inline` for a target that stands in its own."""
    pairs = dict[str, list[tuple[str, str]]]()
    for view in views:
        for move in MOVES.finditer(view):
            if move[1].lower().startswith("moveabsj"):
                continue
            arguments = [part for part in _split(move[2]) if part]
            tool = re.match(r"\w+", arguments[-1]) if len(arguments) > 1 else None
            wobj = re.search(r"\\WObj\s*:=\s*(\w+)", move[2], re.IGNORECASE)
            pair = (tool[0] if tool else "", wobj[1] if wobj else "")
            for name in [""] if inline else re.findall(r"[A-Za-z]\w*", ",".join(arguments[:2])):
                pairs.setdefault(name.lower(), []).append(pair)
    return Uses(pairs)


def _split(text: str) -> list[str]:
    """Arguments parted by commas outside of brackets."""
    parts, depth = [""], 0
    for character in text:
        depth += {"(": 1, "[": 1, "{": 1, ")": -1, "]": -1, "}": -1}.get(character, 0)
        if character == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts]
