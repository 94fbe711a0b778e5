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

LONGEST = 20  # positions or remarks of a kind that are named on the screen
DIFF = "corrections.diff"


def fix(
    calibration: Path,
    *programs: Path,
    output: Annotated[Path, Parameter(name=["-o", "--output"])] = Path("corrected"),
    setup: Annotated[tuple[Path, ...], Parameter(negative=())] = (),
    diff: Annotated[bool, Parameter(negative=())] = False,
    json: Json = False,
) -> int:
    """Corrected copies of robot programs: FANUC .LS, KUKA .dat and .src, ABB .mod, Yaskawa .JBI.

    A program is corrected whole or not at all: if one of its points cannot be corrected, no copy is written, the point
    is named, and the exit code is 1. Every byte but the numbers stays. Beside the copies stands corrections.diff. Give
    files that belong together (.dat and .src, modules that share tools) in one call. Frames and tools decide
    everything: state them with --setup, a backup of the controller or a YAML file of lines like

        frames: {1: {x_mm: 800, z_mm: 400, rz_deg: 90}}

        fixed_to: jig

    (or robot, where points stand with its base), and tools:, joints: {coupled: true}. For example:

        touchcal fix calibration.json SEAM.LS --setup sysframe.va -o corrected

    Parameters
    ----------
    calibration
        What touchcal identify wrote.
    programs
        Programs, of one maker or of several.
    output
        The folder to write to; made where it does not exist.
    setup
        Frames and tools: what the controller backs up (FANUC sysframe.va, KUKA $config.dat, ABB SYS.MOD, Yaskawa
        TOOL.CND or UFRAME.CND), or a YAML file, which also says how joints are counted; several may be given. Without
        it, the tool is the cell's and frames that the program does not declare are the robot's base.
    diff
        Print the changes.
    """
    from identify.compensation.compensate import remarks
    from identify.model.io.calibration_file import read_calibration
    from identify.programs.fixing import fix as corrected
    from identify.programs.setup import read_setups

    if not programs:
        raise InputError("nothing to correct: name at least one program")
    identified = read_calibration(calibration)
    names = _distinct(programs)
    _other_folder(output, programs)
    table = read_setups(setup, identified.cell.robot)
    with progress(not json, "correcting"):
        files = corrected(identified, {name: read_bytes(path) for name, path in names.items()}, table)
    _write(output, files)
    if json:
        print_json(summary(files))
    else:
        print(story(files, remarks(identified, table.fixed_to), output))
    if diff and not json:
        print(b"".join(each.diff for each in files).decode("utf-8", errors="replace"))
    return 0 if all(each.whole for each in files) else 1


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


def _write(output: Path, files: "list[Fixed]") -> None:
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{output}: cannot be made: {error.strerror}; choose another folder with -o") from None
    for each in files:
        if each.whole:
            write_bytes(output / each.name, each.after)
    write_bytes(output / DIFF, b"".join(each.diff for each in files))


def summary(files: "list[Fixed]") -> dict[str, Any]:
    """What `--json` says."""
    return {
        each.name: {
            "corrected": len(each.shift),
            "shift_mm": {"median": float(np.median(each.shift)), "max": float(each.shift.max())}
            if len(each.shift)
            else None,
            "held": each.unchanged,
            "largest_step_mm": each.step if len(each.shift) else None,
            "assumed": list(each.assumed),
            "left": [{"line": m.line, "name": m.name, "why": m.why} for m in each.failures],
            "mentions": [{"line": m.line, "name": m.name, "why": m.why} for m in each.mentions],
        }
        for each in files
    }


def story(files: "list[Fixed]", notes: list[str], output: Path) -> str:
    """The result as a person reads it: what decides everything first, then each program."""
    lines = list(
        dict.fromkeys(f"frames and tools decide everything: {text}" for each in files for text in each.assumed)
    )
    for each in files:
        lines.append(f"{each.name}: {_corrected(each)}")
        lines += [f"  cannot be corrected: {count} {why}" for why, count in each.reasons.items()]
        for mentions in (each.failures, each.mentions):
            lines += [f"  {_place(m.line, m.name)}{m.why}" for m in mentions[:LONGEST]]
            lines += [f"  ... and {len(mentions) - LONGEST} more"] if len(mentions) > LONGEST else []
    return "\n".join([*lines, *notes, f"wrote {output}, the changes in {output / DIFF}"])


def _corrected(program: "Fixed") -> str:
    """How many positions of a program were corrected, and by how much."""
    total = len(program.shift) + len(program.failures) + program.unchanged
    if not program.whole:
        stuck = f"{len(program.failures)} of {total} positions cannot be corrected"
        return f"not corrected and not written: {stuck}, and a path is one whole"
    if not len(program.shift):
        return f"0 of {total} positions corrected"
    return (
        f"{len(program.shift)} of {total} positions corrected, by {np.median(program.shift):.3f} mm (median), "
        f"{program.shift.max():.3f} mm at most; largest step between neighbours {program.step:.3f} mm"
    )


def _place(line: int, name: str) -> str:
    where = f"line {line}, {name}" if line else name
    return f"{where}: " if where else ""
