"""What an operator may choose for a program."""

from dataclasses import dataclass

from identify.model.cell import Cell
from identify.model.files import InputError
from probe.motion.settings import Settings

UNTRIED = "No real controller has run this program yet."


@dataclass(frozen=True)
class Options:
    """Inputs, frames, speeds and registers; what is empty or None is the maker's usual."""

    input: str = ""  # the touch signal, in the maker's notation
    tool: str = ""  # number or name of the tool
    frame: str = ""  # number or name of the user frame, base or work object
    move_speed: float = 250.0  # [mm/s] of the tip between touches: what mode T1 allows
    retract_speed: float = 50.0  # [mm/s] of the tip, back from the contact
    search_speed: float | None = None  # [mm/s]; None: what the cell says
    wait: float = 0.4  # [s] after each touch; power sources hold the sensing signal for 0.3 s
    first: int = 1  # of the registers that the program writes
    registers: int | None = None  # that the controller has, of the kind that it runs out of first
    per_file: int | None = None  # touches in one file; None: as many as the registers hold
    rehearsal: bool = False  # every approach from further off, no search
    host: str = "192.168.0.100"  # where the PC listens, for controllers that send
    port: int = 30100

    def settings(self, cell: Cell) -> Settings:
        """The speeds as the driver knows them."""
        return Settings(
            move_speed=self.move_speed,
            retract_speed=self.retract_speed,
            search_speed=self.search_speed or cell.touch.speed,
        )

    def check(self) -> None:
        """Raise InputError for what no controller can do."""
        for name, value, low, high in (
            ("--wait", self.wait, 0.3, 10.0),
            ("--first-register", self.first, 1, 9999),
            ("--registers", 1 if self.registers is None else self.registers, 1, 99999),
            ("--per-file", 1 if self.per_file is None else self.per_file, 1, 9999),
            ("--port", self.port, 1024, 65535),
        ):
            if not low <= value <= high:
                raise InputError(f"{name} is {value:g}, expected {low:g} to {high:g}")
