"""What every maker's programs have in common: positions with a place in the text, a frame, a tool and a posture."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from identify.programs.numbers import Number
from identify.programs.setup import Setup
from identify.programs.source import Source


@dataclass(frozen=True, eq=False)
class Ref:
    """A frame or a tool: a name for the table, or what the program itself says it is."""

    name: str = ""  # empty: the base, or the cell's own tool
    T: Float[np.ndarray, "4 4"] | None = None  # [mm], base_T_frame or flange_T_tool


@dataclass(frozen=True)
class Record:
    """One position of a program."""

    name: str
    line: int
    kind: Literal["euler", "quaternion", "joints"]
    numbers: tuple[Number, ...]  # x y z rz ry rx [mm, deg] | x y z w i j k | joints [deg], in this order
    frame: Ref = field(default_factory=Ref)
    tool: Ref = field(default_factory=Ref)
    flags: Any = None  # how the maker writes the posture down
    why: str = ""  # why it cannot be corrected
    per_degree: Float[np.ndarray, " joints"] | None = None  # of joints that are not written in degrees (pulses)

    @property
    def values(self) -> Float[np.ndarray, " numbers"]:
        """What the numbers say."""
        return np.array([number.value for number in self.numbers])


@dataclass(frozen=True, order=True)
class Mention:
    """Something in a program that a reader should know, or a position left alone."""

    file: str
    line: int
    name: str
    why: str


@dataclass(frozen=True)
class Positions:
    """The positions of one program, and what else is to be said about it."""

    records: tuple[Record, ...]
    mentions: tuple[Mention, ...] = ()
    destinations: frozenset[str] | None = None  # names of the positions that motions go to; None: all


@dataclass(frozen=True, eq=False)
class Postures:
    """Solutions of one position: joints as the maker counts them, and on which side of the arm the wrist stands."""

    degrees: Float[np.ndarray, "solutions joints"]
    front: Bool[np.ndarray, " solutions"] | None  # before axis 1, not behind it; None: not an elbow arm
    above: Bool[np.ndarray, " solutions"] | None  # before the lower arm: elbow up

    def take(self, part: slice) -> "Postures":
        """Some of them."""
        front, above = (None if side is None else side[part] for side in (self.front, self.above))
        return Postures(self.degrees[part], front, above)


@dataclass(frozen=True)
class Maker:
    """How one maker writes programs; a row of MAKERS."""

    name: str
    find: Callable[[Sequence[Source], Setup], list[Positions]]  # refuses a broken file with line and column
    fits: Callable[[Any, Postures], Bool[np.ndarray, " solutions"]]  # which postures the flags allow
    decimals: Mapping[str, Sequence[int]]  # fewest, for each number of a kind of record
    coupled: bool = False  # whether joint 3 is shown against the horizontal, not against joint 2
    pairs: bool = False  # whether files of one name and other endings are one program
    bare: bool = False  # whether .5 is written for 0.5
    binding: bool = True  # whether a posture that the flags do not describe any more is left alone
