"""`touchcal fix`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter

from identify.model.files import InputError, read_bytes, write_bytes
from oed.cli.options import Json, print_json
from oed.cli.screen.progress import progress

if TYPE_CHECKING:
    from identify.programs.fixing import Fixed

SHOWN = 20  # positions or remarks of a kind that are named on the screen
DIFF = "corrections.diff"


def fix(
    calibration: Path,
    *programs: Path,
    output: Annotated[Path, Parameter(name=["-o", "--output"])] = Path("corrected"),
    setup: Path | None = None,
    diff: Annotated[bool, Parameter(negative=())] = False,
    json: Json = False,
) -> None:
    """Corrected copies of robot programs: FANUC .LS, KUKA .dat and .src, ABB .mod, Yaskawa .JBI.

    Positions are found, corrected and written back in place; every other byte stays. Positions that cannot be corrected
    stay too, and are named. Beside the copies stands corrections.diff. Give files that belong together (.dat and .src,
    modules that share tools) in one call. Example:

        touchcal fix calibration.json SEAM.LS -o corrected

    Parameters
    ----------
    calibration
        What touchcal identify wrote.
    programs
        Programs, of one maker or of several.
    output
        The folder to write to; made where it does not exist.
    setup
        A YAML file with frames, tools and how the maker counts the joints. Without it, the tool is the cell's and
        frames that the program does not declare are the robot's base.
    diff
        Print the changes.
    """
    from identify.compensation.compensate import remarks
    from identify.model.io.calibration_file import read_calibration
    from identify.programs.fixing import fix as corrected
    from identify.programs.setup import Setup, read_setup

    if not programs:
        raise InputError("nothing to correct: name at least one program")
    identified = read_calibration(calibration)
    names = _distinct(programs)
    _other_folder(output, programs)
    table = Setup() if setup is None else read_setup(setup, identified.cell.robot)
    with progress(not json, "correcting"):
        found = corrected(identified, {name: read_bytes(path) for name, path in names.items()}, table)
    _write(output, found)
    if json:
        print_json(summary(found))
    else:
        print(story(found, remarks(identified, table.fixed_to), output))
    if diff and not json:
        print(b"".join(each.diff for each in found).decode("utf-8", errors="replace"))


def _distinct(programs: tuple[Path, ...]) -> dict[str, Path]:
    """Programs by their names, which the copies get."""
    names = {path.name: path for path in programs}
    if len(names) < len(programs):
        raise InputError("two programs have the same name; correct them one by one, into different folders")
    return names


def _other_folder(output: Path, programs: tuple[Path, ...]) -> None:
    """Refuse to write over what is read."""
    for path in programs:
        if output.resolve() == path.resolve().parent:
            raise InputError(f"{output}: {path.name} stands there; choose another folder with -o")


def _write(output: Path, found: "list[Fixed]") -> None:
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{output}: cannot be made: {error.strerror}; choose another folder with -o") from None
    for each in found:
        write_bytes(output / each.name, each.after)
    write_bytes(output / DIFF, b"".join(each.diff for each in found))


def summary(found: "list[Fixed]") -> dict[str, Any]:
    """What `--json` says."""
    return {
        each.name: {
            "corrected": len(each.shift),
            "shift_mm": {"median": float(np.median(each.shift)), "max": float(each.shift.max())}
            if len(each.shift)
            else None,
            "left": [{"line": m.line, "name": m.name, "why": m.why} for m in each.left],
            "mentions": [{"line": m.line, "name": m.name, "why": m.why} for m in each.mentions],
        }
        for each in found
    }


def story(found: "list[Fixed]", notes: list[str], output: Path) -> str:
    """The result as a person reads it."""
    lines = list[str]()
    for each in found:
        moved = (
            f", by {np.median(each.shift):.3f} mm (median), {each.shift.max():.3f} mm at most"
            if len(each.shift)
            else ""
        )
        lines.append(f"{each.name}: {len(each.shift)} of {len(each.shift) + len(each.left)} positions corrected{moved}")
        lines += [f"  left as they are: {count} {why}" for why, count in each.reasons.items()]
        for mentions in (each.left, each.mentions):
            lines += [f"  {_place(m.line, m.name)}{m.why}" for m in mentions[:SHOWN]]
            lines += [f"  ... and {len(mentions) - SHOWN} more"] if len(mentions) > SHOWN else []
    return "\n".join([*lines, *notes, f"wrote {output}, the changes in {output / DIFF}"])


def _place(line: int, name: str) -> str:
    where = f"line {line}, {name}" if line else name
    return f"{where}: " if where else ""
