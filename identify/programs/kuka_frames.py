"""Which tool and base hold for a position of a KUKA program: what is taught with it, or what was set last before it."""

import re
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from identify.model.frames import transform
from identify.programs.kuka_values import Structure, assigned
from identify.programs.records import Ref

POSE = ("X", "Y", "Z", "A", "B", "C")
ELEMENT = re.compile(r"(TOOL|BASE)_DATA\s*\[\s*(\d+)\s*\]", re.IGNORECASE)
BAS = re.compile(r"\bBAS\s*\(\s*#(TOOL|BASE)\s*,\s*(\d+)\s*\)", re.IGNORECASE)
MOVES = re.compile(r"^[ \t]*(?:S?(?:PTP|LIN|CIRC)|SPL)\b([^\r\n]*)", re.IGNORECASE | re.MULTILINE)
FORGOTTEN = r"(?!\{|\$NULLFRAME|(?:TOOL|BASE)_DATA\s*\[\s*\d+\s*\]\s*$)"  # what no number or structure says
UNKNOWN = "frame: $BASE or $TOOL is computed where it is used"
Place = tuple[Ref, Ref, str]  # base, tool, and why the position cannot be corrected
DEFAULT: Place = (Ref(), Ref(), "")


@dataclass(frozen=True)
class Uses:
    """Tools and bases of taught positions, of named ones by their uses, and of any place in one file."""

    taught: Mapping[str, Place]
    named: Mapping[str, list[Place]]
    steps: Sequence[tuple[int, Place]] = field(default_factory=list)

    def of(self, name: str) -> Place:
        """Base and tool of a position that has a name."""
        plain = name.split("[")[0]
        if name in self.taught:
            return self.taught[name]
        entries = self.named.get(name, self.named.get(plain, []))
        if not entries:
            return DEFAULT
        first = entries[0]
        if any(not _alike(first, other) for other in entries):
            return (*first[:2], "frame: it is used with more than one base or tool")
        return first

    def at(self, place: int) -> Place:
        """Base and tool at a place of the one file that this was made of."""
        before = bisect_right([at for at, _ in self.steps], place)
        return self.steps[before - 1][1] if before else DEFAULT


def uses(files: Sequence[tuple[str, Sequence[Structure]]]) -> Uses:
    """What files that belong together say about tools and bases."""
    taught, named, steps = dict[str, Place](), dict[str, list[Place]](), list[tuple[int, Place]]()
    for view, structures in files:
        taught |= _taught(view, structures)
        steps = _steps(view, structures)
        states = Uses({}, {}, steps)
        for motion in MOVES.finditer(view):
            for name in re.findall(r"(?<![\w$#])([A-Za-z_]\w*(?:\[\s*\d+\s*\])?)", re.sub(r"\{[^}]*\}", "", motion[1])):
                named.setdefault(name.upper(), []).append(states.at(motion.start()))
    return Uses(taught, named, steps)


def _taught(view: str, structures: Sequence[Structure]) -> dict[str, Place]:
    """What the structures FP1 say of positions XP1."""
    places = dict[str, Place]()
    for structure in structures:
        name = re.search(
            r"\bFDAT\s+F(\w+)\s*=\s*$", view[max(0, structure.start - 200) : structure.start], re.IGNORECASE
        )
        if name is None:
            continue
        parts = structure.components
        tool, base = (parts[key].integer if key in parts else None for key in ("TOOL_NO", "BASE_NO"))
        frame = parts["IPO_FRAME"].text.upper() if "IPO_FRAME" in parts else "#BASE"
        why = "" if frame == "#BASE" else "frame: the tool stands still and the robot holds the work (#TCP)"
        places[f"X{name[1].upper()}"] = (_numbered(base), _numbered(tool), why)
    return places


def _numbered(index: int | None) -> Ref:
    """A base or tool by its number; 0 is the robot's own."""
    return Ref("", np.eye(4)) if index == 0 else Ref() if index is None or index < 0 else Ref(str(index))


def _steps(view: str, structures: Sequence[Structure]) -> list[tuple[int, Place]]:
    """What holds from which place on."""
    changes = [(m.start(), m[1].upper(), _numbered(int(m[2])), "") for m in BAS.finditer(view)]
    at_start = {structure.start: structure for structure in structures}
    for at, name, value in assigned(view):
        if name in {"$BASE", "$TOOL"}:
            ref = _literal(view, at, value, at_start)
            changes.append((at, name[1:], ref or Ref(), "" if ref else UNKNOWN))
    steps, state = list[tuple[int, Place]](), {"BASE": (Ref(), ""), "TOOL": (Ref(), "")}
    for at, which, ref, why in sorted(changes, key=lambda change: change[0]):
        state[which] = (ref, why)
        steps.append((at, (state["BASE"][0], state["TOOL"][0], state["BASE"][1] or state["TOOL"][1])))
    return steps


def _literal(view: str, at: int, value: str, at_start: Mapping[int, Structure]) -> Ref | None:
    """A frame that an assignment says in plain words; nothing where it computes one."""
    if value.upper() == "$NULLFRAME":
        return Ref("", np.eye(4))
    if element := ELEMENT.fullmatch(value):
        return _numbered(int(element[2]))
    structure = at_start.get(view.find("{", at))
    if not value.startswith("{") or structure is None or not value.endswith("}"):
        return None
    numbers = [structure.components[name].number if name in structure.components else None for name in POSE]
    if any(number is None for number in numbers):
        return None
    pose = np.array([number.value for number in numbers if number is not None])
    return Ref("", transform(pose * np.array([1, 1, 1, *[np.pi / 180] * 3])))


def _alike(a: Place, b: Place) -> bool:
    same = [x.name == y.name and _equal(x, y) for x, y in zip(a[:2], b[:2], strict=True)]
    return all(same) and a[2] == b[2]


def _equal(a: Ref, b: Ref) -> bool:
    if a.T is None or b.T is None:
        return a.T is b.T
    return bool(np.array_equal(a.T, b.T))
