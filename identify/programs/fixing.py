"""Correct programs in place: a path whole or not at all, and a list of what holds it back.

A path is all motions of one program (KUKA: a .src with its .dat). A corrected point beside one that is not would bend a
seam by the whole correction, so one point that cannot be corrected leaves its path as it is. Positions that no motion
goes to hold nothing back.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import unified_diff
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identify.model.io.calibration_file import Calibration
from identify.programs.correction import Corrected, correct
from identify.programs.makers import maker_of
from identify.programs.records import Maker, Mention, Positions
from identify.programs.setup import Setup
from identify.programs.source import Source, source_of
from identify.programs.writing import faithful, replaced, replacements, skeleton

ABSENT = "absent: a motion goes there, and the program holds no such position"


@dataclass(frozen=True, eq=False)
class Fixed:
    """A program before and after."""

    name: str
    before: bytes
    after: bytes
    shift: Float[np.ndarray, " corrected"]  # [mm], of the positions corrected
    failures: tuple[Mention, ...]  # positions that cannot be corrected, and why
    whole: bool  # whether its path was corrected; a path is left as it is where a point of it cannot be corrected
    unchanged: int  # positions that could be corrected, and stay as they were with the path
    step: float  # [mm], largest between the corrections of neighbouring positions
    assumed: tuple[str, ...]  # frames and tools that the program does not say and no table names
    mentions: tuple[Mention, ...]  # what else a reader should know

    @cached_property
    def diff(self) -> bytes:
        """The change as a unified diff, in the bytes of the program."""
        old, new = (text.decode("latin-1").splitlines(keepends=True) for text in (self.before, self.after))
        lines = unified_diff(old, new, f"a/{self.name}", f"b/{self.name}")
        return "".join(line if line.endswith(("\n", "\r")) else line + "\n" for line in lines).encode("latin-1")

    @property
    def reasons(self) -> dict[str, int]:
        """How many positions were left alone, by what stands before the first colon of the reason."""
        return dict(Counter(mention.why.split(":")[0] for mention in self.failures).most_common())


class NotFaithful(RuntimeError):
    """What was to be written does not read back as it should: a mistake of touchcal, and nothing is written."""


def fix(calibration: Calibration, programs: Mapping[str, bytes], setup: Setup | None = None) -> list[Fixed]:
    """Programs whose positions bring the identified robot where they said; `programs` are bytes by file name.

    All programs are read before any is corrected; a broken one raises InputError with line and column. What comes out
    is read again: the same positions must stand there, and nothing but their numbers may have changed.
    """
    setup = Setup() if setup is None else setup
    setup = replace(
        setup, joints=replace(setup.joints, pulses=setup.joints.pulses or calibration.cell.robot.counting.pulses)
    )
    sources = {name: source_of(name, content) for name, content in programs.items()}
    positions = _find(sources, setup)
    able = {name: correct(calibration, positions[name].records, maker_of(name), setup) for name in sources}
    stopped = {_path(name) for name in sources for one in able[name] if _stops(one, positions[name])}
    stopped |= {_path(name) for name in sources if _absent(positions[name])}
    corrections = {
        name: [_held(one) for one in able[name]] if _path(name) in stopped else able[name] for name in sources
    }
    texts = {
        name: Source(name, _corrected(source, corrections[name], maker_of(name))) for name, source in sources.items()
    }
    again = _find(texts, setup)
    for name in sources:
        _check(sources[name], texts[name], corrections[name], positions[name], again[name], maker_of(name))
    return [
        _fixed(sources[name], texts[name], corrections[name], positions[name], _path(name) not in stopped)
        for name in sources
    ]


def _path(name: str) -> str:
    """The path that the positions of a file belong to."""
    return Path(name).stem.lower() if maker_of(name).pairs else name


def _stops(one: Corrected, positions: Positions) -> bool:
    """Whether a position leaves its path as it is."""
    return bool(one.why) and (positions.destinations is None or one.record.name in positions.destinations)


def _absent(positions: Positions) -> list[str]:
    """Positions that motions go to, and that the program does not hold."""
    return sorted((positions.destinations or frozenset()).difference(record.name for record in positions.records))


def _held(one: Corrected) -> Corrected:
    """A position that stays as it is with its path."""
    return one if one.why else replace(one, values=None, move=None)


def _find(sources: Mapping[str, Source], setup: Setup) -> dict[str, Positions]:
    """The positions of all programs; those of one maker are read together, for they declare things for one another."""
    positions, together = dict[str, Positions](), dict[str, list[str]]()
    for name in sources:
        together.setdefault(maker_of(name).name, []).append(name)
    for names in together.values():
        read: Sequence[Positions] = maker_of(names[0]).find([sources[name] for name in names], setup)
        positions |= dict(zip(names, read, strict=True))
    return positions


def _corrected(source: Source, corrections: Sequence[Corrected], maker: Maker) -> str:
    return replaced(source.text, [change for one in corrections for change in replacements(one, maker)])


def _check(
    before: Source,
    after: Source,
    corrections: Sequence[Corrected],
    positions: Positions,
    again: Positions,
    maker: Maker,
) -> None:
    """Raise NotFaithful where the corrected program is not the old one with other numbers."""
    same = skeleton(before.text, positions.records) == skeleton(after.text, again.records)
    if not same or not all(
        faithful(one, record, maker) for one, record in zip(corrections, again.records, strict=True)
    ):
        raise NotFaithful(f"{before.name}: the corrected program does not read back as it should; nothing was written")


def _fixed(before: Source, after: Source, corrections: Sequence[Corrected], positions: Positions, whole: bool) -> Fixed:
    failures = tuple(Mention(before.name, one.record.line, one.record.name, one.why) for one in corrections if one.why)
    failures += tuple(Mention(before.name, 0, name, ABSENT) for name in _absent(positions))
    moves = [one.move for one in corrections if one.move is not None]
    steps = np.linalg.norm(np.diff(moves, axis=0), axis=1) if len(moves) > 1 else np.zeros(1)
    notes = dict.fromkeys(note for one in corrections for note in one.notes)
    return Fixed(
        before.name,
        before.text.encode("latin-1"),
        after.text.encode("latin-1"),
        np.array([one.shift for one in corrections if one.values is not None]),
        failures,
        whole,
        sum(one.values is None and not one.why for one in corrections),
        float(steps.max()),
        tuple(dict.fromkeys(text for one in corrections for text in one.assumed)),
        (*dict.fromkeys(positions.mentions), *(Mention(before.name, 0, "", note) for note in notes)),
    )
