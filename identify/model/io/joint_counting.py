"""`joints:` of a cell or of a table of programs: from what the file says to a JointCounting, and back."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from identify.model.files import Mistake, nearest
from identify.model.io.document import Document, usable
from identify.model.io.schema import JointsEntry
from identify.model.joint_counting import JointCounting, circle

LISTS = {"sign": 1.0, "zero_deg": 0.0, "pulses_per_deg": float("nan")}  # and what a joint has that is not named


def counting_of(entry: JointsEntry, names: Sequence[str]) -> JointCounting:
    """How a controller counts joints of these names; `entry` has no mistakes."""
    sign, zero, pulses = (_row(getattr(entry, key), names, usual) for key, usual in LISTS.items())
    coupled = [(j, w, s) for _, j, w, s in _coupled(entry, names) if j is not None and w is not None]
    uncoupled = entry.coupled is not None and not coupled
    return JointCounting(tuple(map(int, sign)), zero, tuple(coupled), pulses, uncoupled)


def counting_entry(counting: JointCounting, names: Sequence[str]) -> dict[str, Any]:
    """The inverse of `counting_of`: what differs from the usual, by name; pulses as a list."""
    entry: dict[str, Any] = {
        "sign": {name: sign for name, sign in zip(names, counting.sign, strict=False) if sign < 0},
        "zero_deg": {name: zero for name, zero in zip(names, counting.zero, strict=False) if zero},
        "coupled": {names[j]: f"{'-' if sign < 0 else ''}{names[w]}" for j, w, sign in counting.coupled},
        "pulses_per_deg": list(counting.pulses),
    }
    return {key: value for key, value in entry.items() if value or (key == "coupled" and counting.uncoupled)}


def counting_mistakes(document: Document, names: Sequence[str]) -> list[Mistake]:
    """What is wrong in `joints:` beyond its form: unknown joints, rows of another length, couplings in a circle."""
    entry = usable(document.get("joints"), JointsEntry)
    if entry is None:
        return []
    wrong = [
        document.wrong(f"joints.{key} {text}", "joints", key)
        for key in LISTS
        for text in _row_mistakes(entry, key, names)
    ]
    wrong += [
        document.wrong(
            f"joints.coupled: the robot has no joint '{word}'{nearest(word, names)}", "joints", "coupled", at
        )
        for at, joint, with_, _ in _coupled(entry, names)
        for word, value in ((at, joint), ((entry.coupled or {})[at].lstrip("+-"), with_))
        if value is None
    ]
    pairs = [(j, w, s) for _, j, w, s in _coupled(entry, names) if j is not None and w is not None]
    if circle(pairs):
        wrong.append(
            document.wrong("joints.coupled: the couplings run in a circle; one of them is wrong", "joints", "coupled")
        )
    return wrong


def _row(values: Sequence[float] | Mapping[str, float] | None, names: Sequence[str], usual: float) -> tuple[float, ...]:
    """One number a joint; empty where the file says nothing."""
    if not values:
        return ()
    return tuple(values.get(name, usual) for name in names) if isinstance(values, Mapping) else tuple(values)


def _row_mistakes(entry: JointsEntry, key: str, names: Sequence[str]) -> Iterator[str]:
    values = getattr(entry, key)
    if isinstance(values, Mapping):
        for name in (name for name in values if name not in names):
            yield f"names a joint that the robot does not have: '{name}'{nearest(name, names)}"
        missing = [name for name in names if name not in values]
        if key == "pulses_per_deg" and values and missing:
            yield f"has no number for {', '.join(missing)}; write one for each joint"
    elif values is not None and len(values) != len(names):
        yield f"has {len(values)} numbers, the robot has {len(names)} joints"


def _coupled(entry: JointsEntry, names: Sequence[str]) -> Iterator[tuple[str, int | None, int | None, int]]:
    """Each coupling as the file names it, with the indices of both joints (None: no such joint) and its sign."""
    place = {name: i for i, name in enumerate(names)}
    for joint, word in (entry.coupled or {}).items():
        yield joint, place.get(joint), place.get(word.lstrip("+-")), -1 if word.startswith("-") else 1
