"""Numbered registers or variables of a controller, as the files that it saves list them."""

from dataclasses import dataclass
from pathlib import Path

from probe.programs.log import HEADER, fault, header

Elements = dict[int, tuple[int, str]]  # line and text of each, by its index


@dataclass(frozen=True)
class Numbers:
    """Registers that hold numbers, in one file."""

    path: Path
    elements: Elements
    name: str  # of one, {0} being its index
    file: str  # that the controller saves them in

    def __getitem__(self, index: int) -> float:
        """The number of a register; raises InputError if the register holds something else."""
        line, text = self.elements.get(index, (0, ""))
        try:
            return float(text.split()[0])
        except (ValueError, IndexError):
            what = f"{self.name.format(index)} is '{text.strip()}', expected a number; save {self.file} again"
            raise fault(self.path, line, what) from None

    def line(self, index: int) -> int:
        """The line of a register in the file."""
        return self.elements[index][0]

    def log(self, stamp: int) -> tuple[int, int, int, float]:
        """Index of the first register of the log of a plan; number of its first touch, count, search speed [mm/s].

        Raises InputError if no register holds the stamp of the plan.
        """
        at = next((i for i, (_, text) in self.elements.items() if text.split()[:1] == [str(stamp)]), None)
        if at is None:
            what = f"no {self.name.format('')} holds {stamp}, the stamp of this plan"
            raise fault(self.path, 0, f"{what}; did its program run, and was {self.file} saved after it?")
        values = [self[at + k] for k in range(len(HEADER))]
        _, first, count, speed = header(values, self.path, self.line(at))
        return at, first, count, speed
