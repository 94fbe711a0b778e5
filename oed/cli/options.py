"""Options that several commands share, and how files are read for them and results printed.

A module of a command imports what computes inside its functions: help is printed without it.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter

from identify.model.files import InputError, Mistake, digest

if TYPE_CHECKING:
    from identify.model.cell import Cell
    from identify.model.io.calibration_file import Calibration, Errors
    from identify.model.measurement import Measurements
    from identify.model.touch import Touches
    from oed.campaigns.connection import Connection

TOUCHES = "{touches}"  # in the file beside a plan: the table of its touches
IDENTIFY = f"touchcal identify {TOUCHES}"
NAME, TABLE = 32, 78  # characters of a name in a table of errors, and of the whole table
NONE = f"{'none could be spared':>26}"
CellFile = Annotated[Path, Parameter(name="--cell", help="The file that describes robot, jig, tool and zone.")]
Flag = Annotated[bool, Parameter(negative=())]
Json = Annotated[bool, Parameter(name="--json", negative=(), help="Print a machine-readable summary on stdout.")]
Output = Annotated[Path, Parameter(name=["-o", "--output"])]
Seed = Annotated[int, Parameter(name="--seed", help="The same seed gives the same result.")]
TrustUnits = Annotated[
    bool,
    Parameter(name="--trust-units", negative=(), help="Read numbers as they are, even if they look like rad or m."),
]


@Parameter(name="*")
@dataclass(frozen=True)
class Port:
    """How the controller is reached."""

    port: str | None = None
    """/dev/ttyUSB0, COM5, socket://host:port, rfc2217://host:port or sim, in place of the cell's."""
    protocol: str | None = None
    """line (TOUCH/1), grbl or linuxcnc, in place of the cell's."""
    truth: str | None = None
    """With port sim: what the virtual robot truly is, a file or library:arc-welder; drawn from the priors if the
    library knows none of that name."""

    def connection(self, cell: "Cell") -> "Connection":
        """The connection of the cell, with these options in place of what the cell file says."""
        from oed.campaigns.connection import connection

        return connection(cell, **vars(self))


CELL_PORT = Port()


def read_tables(paths: Sequence[Path], cell: "Cell", trust_units: bool) -> tuple[list["Measurements"], dict[str, str]]:
    """The measurements of several files, a table a kind and file, and the hashes of the files.

    Raises InputError with all mistakes.
    """
    from identify.model.io.measurements import read_measurements

    tables = list["tuple[Measurements, ...]"]()
    mistakes: list[Any] = []
    for path in paths:
        try:
            tables.append(read_measurements(path, cell, trust_units=trust_units))
        except InputError as error:
            mistakes += error.mistakes
    if mistakes:
        raise InputError(mistakes)
    return _distinct(paths, tables), {path.name: digest(path) for path in paths}


def next_command(plan: Path, touches: Path) -> str:
    """What to do with the touches of a plan, as the .json file beside the plan says."""
    try:
        after = json.loads(plan.with_suffix(".json").read_text(encoding="utf-8"))["next"]
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        after = IDENTIFY
    return str(after).replace(TOUCHES, str(touches))


def inputs_beside(calibration: "Calibration", folder: Path) -> list[Path]:
    """Files of measurements of the fit that stand in a folder unchanged."""
    paths = [folder / name for name in calibration.inputs if name.endswith(".csv")]
    return [path for path in paths if path.is_file() and digest(path) == calibration.inputs[path.name]]


def only_touches(table: "Measurements") -> "Touches":
    """The touches; raises InputError if something else was measured."""
    from identify.model.touch import Touches

    if not isinstance(table, Touches):
        raise InputError("positions in the jig frame are no touches; give a touches.csv with faces")
    return table


def _distinct(paths: Sequence[Path], tables: list["tuple[Measurements, ...]"]) -> list["Measurements"]:
    """Ids that stand in several files are told apart by the name of their file.

    Raises InputError if one measurement stands in two files: it would count twice.
    """
    ids = [name for of_file in tables for table in of_file for name in table.ids]
    if len(set(ids)) == len(ids):
        return [table for of_file in tables for table in of_file]
    files_of_rows, mistakes = dict[tuple[object, ...], Path](), list[Mistake]()
    for path, of_file in zip(paths, tables, strict=True):
        rows = {(name, *row) for table in of_file for name, row in zip(table.ids, _rows(table), strict=True)}
        if twice := sorted(str(row[0]) for row in rows if row in files_of_rows):
            first = next(files_of_rows[row] for row in rows if row in files_of_rows)
            text = f"'{twice[0]}' ({len(twice)} rows in all) stands in {first} too; give each measurement once"
            mistakes.append(Mistake(str(path), 0, text))
        files_of_rows |= dict.fromkeys(rows, path)
    if mistakes:
        raise InputError(mistakes)
    short = len({path.stem for path in paths}) == len(paths)
    return [
        replace(table, ids=tuple(f"{path.stem if short else path.with_suffix('')}:{name}" for name in table.ids))
        for path, of_file in zip(paths, tables, strict=True)
        for table in of_file
    ]


def _rows(table: "Measurements") -> list[tuple[object, ...]]:
    """What was measured, a row a measurement."""
    columns = [vars(table)[name] for name in ("q", "point") if name in vars(table)]
    return [tuple(row) for row in np.column_stack(columns).tolist()]


def load_cell(path: Path) -> "Cell":
    """Read the cell file; says how to get one where there is none."""
    from identify.model.io.description import read_cell

    if not path.exists():
        raise InputError(f"{path}: no such file; describe the cell there, or name it with --cell FILE")
    return read_cell(path)


def numbers(text: str, count: int, what: str) -> np.ndarray:
    """As many numbers as there have to be, parted by commas; raises InputError."""
    try:
        values = np.array([float(word) for word in text.split(",")])
    except ValueError:
        values = np.array([])
    if len(values) != count or not np.isfinite(values).all():
        raise InputError(f"{what} is '{text}', expected {count} numbers parted by commas")
    return values


def print_json(summary: Mapping[str, Any]) -> None:
    """One JSON document on stdout."""
    print(json.dumps(summary, indent=1), file=getattr(sys.stdout, "whole", sys.stdout))  # never folded


def errors_table(rows: Mapping[str, "Errors | None"]) -> str:
    """Errors as lines of a table, millimetres; on a narrow screen a name has a line of its own."""
    narrow = get_terminal_size().columns < TABLE
    lines = [f"{'':{2 if narrow else NAME}}{'n':>6}{'mean':>9}{'RMS':>9}{'95 %':>9}{'max':>9}  mm"]
    for name, e in rows.items():
        numbers = f"{e.n:6d}{e.mean_mm:9.3f}{e.rms_mm:9.3f}{e.p95_mm:9.3f}{e.max_mm:9.3f}" if e else NONE
        lines += [name, f"  {numbers}"] if narrow else [f"{name:{NAME}}{numbers}"]
    return "\n".join(lines)


def ladder_lines(calibration: "Calibration") -> list[str]:
    """What each way of applying a calibration is predicted to give; no lines where there is no zone to predict for."""
    from identify.compensation.ladder import ladder

    rungs = ladder(calibration)
    table = errors_table({rung.way: rung.errors for rung in rungs})
    return ["predicted tip error in the zone, by what the controller gets:", table, ""] if rungs else []
