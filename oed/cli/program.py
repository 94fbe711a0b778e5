"""`touchcal program`."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import Parameter

from identify.model.files import InputError, write_text
from oed.cli.options import CellFile, Flag, Output, load_cell

if TYPE_CHECKING:
    from probe.programs.options import Options


@Parameter(name="*")
@dataclass(frozen=True)
class Choices:
    """What depends on the cell at hand."""

    input: str = ""
    """The touch signal, in the maker's notation: DI[1], $MEAS_PULSE[1], diTouch, RIN#(1),IN#(1) or 0."""
    tool: str = ""
    """Number or name of the tool."""
    frame: str = ""
    """Number or name of the user frame, base or work object."""
    move_speed: float = 250.0
    """Of the tip between touches, mm/s; mode T1 allows 250."""
    retract_speed: float = 50.0
    """Of the tip back from the contact, mm/s."""
    search_speed: float | None = None
    """Of the tip, mm/s, in place of the cell's."""
    wait: float = 0.4
    """Seconds after each touch: power sources hold the sensing signal for 0.3 s."""
    first_register: int = 1
    """FANUC, Yaskawa: the first register or variable that the program writes."""
    registers: int | None = None
    """FANUC: how many numeric registers the controller has; Yaskawa: how many position variables."""
    per_file: int | None = None
    """Touches in one file of the program, at most."""
    host: str = "192.168.0.100"
    """UR: the PC that listens, in the robot's network."""
    port: int = 30100
    """UR: the port that it listens on."""

    def options(self, rehearsal: bool) -> "Options":
        """The options of the writers."""
        from probe.programs.options import Options

        rest = {name: value for name, value in vars(self).items() if name != "first_register"}
        return Options(first=self.first_register, rehearsal=rehearsal, **rest)


USUAL = Choices()


def program(
    plan: Path,
    *,
    maker: str,
    cell: CellFile = Path("cell.yaml"),
    output: Output = Path("program"),
    rehearsal: Flag = False,
    choices: Choices = USUAL,
) -> None:
    """Write the touches of a plan as a program in the controller's own language, for cells without a line to a PC.

    The program approaches each touch over the plan's postures, searches with the controller's own search or skip, keeps
    the joints of the edge, retracts and waits; touches that miss are recorded, too. OPERATOR.md says what to set, how
    to load it and what the file that comes back is called. No real controller has run such a program yet. Examples:

        touchcal program plan.csv --maker fanuc --input "DI[3]" --tool 2 --rehearsal -o rehearsal

        touchcal program plan.csv --maker abb --input diTouch --tool tTorch -o program

    Parameters
    ----------
    plan
        What touchcal plan wrote.
    maker
        fanuc, kuka, abb, yaskawa or ur.
    output
        The folder to write to.
    rehearsal
        Every approach from 25 mm further off, and no search: to be run first.
    """
    from identify.model.io.tables import read_plan
    from probe.programs.makers import PAGE
    from probe.programs.makers import program as programmed

    described = load_cell(cell)
    touch_plan = read_plan(plan, described)
    maker_program = programmed(touch_plan, described, maker, choices.options(rehearsal))
    files = maker_program.files
    if output.exists() and not output.is_dir():
        raise InputError(f"{output}: it is no folder; choose another place with -o")
    others = sorted({p.name for p in output.glob("T[CR]*.*")} - files.keys()) if output.exists() else []
    if others:
        raise InputError(f"{output}: it holds {', '.join(others)} of another program; choose an empty folder with -o")
    _write(output, files)
    names = ", ".join(name for name in files if name != PAGE)
    print(f"{len(touch_plan)} {'approaches' if rehearsal else 'touches'} in {names}; no real controller has run it yet")
    for note in maker_program.notes:
        print(f"note: {note}")
    print(f"go on with {output / PAGE}: what to set, how to load it, and what comes back")


def _write(folder: Path, files: dict[str, str]) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}; choose another place with -o") from None
    for name, text in files.items():
        write_text(folder / name, text)
