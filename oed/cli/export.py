"""`touchcal export`."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from identify.model.files import InputError, write_text
from oed.cli.options import Json, print_json

if TYPE_CHECKING:
    from identify.export.formats import Exported, Original
    from identify.model.io.calibration_file import Calibration


def export(
    calibration: Path,
    *,
    format: Literal["urdf", "ur-yaml", "dh-csv", "json", "mastering-text"],
    output: Annotated[Path | None, Parameter(name=["-o", "--output"])] = None,
    urdf: Path | None = None,
    base: str | None = None,
    flange: str | None = None,
    json: Json = False,
) -> None:
    """The calibrated robot for other tools, and what the format costs.

    What is written is read again and compared with the identified robot over poses of the zone. Example:

        touchcal export calibration.json --format urdf --urdf arm.urdf -o calibrated.urdf

    Parameters
    ----------
    calibration
        What touchcal identify wrote.
    format
        urdf corrects the origins of a URDF; ur-yaml is the kinematics file of a UR description; dh-csv a table of four
        parameters a link; json holds everything; mastering-text joint zeros, tool and base frame to enter by hand.
    output
        The file to write; calibrated with the ending of the format if not given.
    urdf
        The URDF that the robot came from: all but its origins is kept. Without it, a plain one is made.
    base
        Its first link; the one that the cell names if not given.
    flange
        Its last link; the one that the cell names if not given.
    """
    from identify.export.exporting import FORMATS
    from identify.export.exporting import export as made
    from identify.model.io.calibration_file import read_calibration

    identified = read_calibration(calibration)
    path = Path(f"calibrated{FORMATS[format].suffix}") if output is None else output
    result = made(identified, format, _original(identified, urdf, base, flange))
    names = {suffix: _beside(path, suffix, FORMATS[format].suffix) for suffix in result.files}
    for suffix, text in result.files.items():
        write_text(names[suffix], text)
    if json:
        print_json(summary(result, list(names.values())))
    else:
        print(story(result, list(names.values())))


def _original(identified: "Calibration", urdf: Path | None, base: str | None, flange: str | None) -> "Original | None":
    """The URDF to keep, and its ends: as given, or as the cell named them."""
    from identify.export.exporting import ends_of
    from identify.export.formats import Original

    if urdf is None:
        return None
    ends = ends_of(identified)
    first, last = base or (ends[0] if ends else None), flange or (ends[1] if ends else None)
    if first is None or last is None:
        raise InputError(f"{urdf}: name the links of the chain with --base and --flange")
    return Original(urdf, first, last)


def _beside(path: Path, suffix: str, main: str) -> Path:
    """The file itself, or one beside it whose name tells what is in it."""
    return path if suffix == main else path.with_name(path.stem + suffix)


def summary(result: "Exported", paths: list[Path]) -> dict[str, Any]:
    """What `--json` says."""
    return {"files": [str(path) for path in paths], "deviation": asdict(result.deviation), "notes": list(result.notes)}


def story(result: "Exported", paths: list[Path]) -> str:
    """The result as a person reads it."""
    cost = result.deviation
    size = f"{cost.max_mm:.6f} mm, {cost.max_deg:.6f} degrees" if max(cost.max_mm, cost.max_deg) > 1e-6 else "nothing"
    lines = [f"read again, the tip is at most this far from the identified robot's: {size}", *result.notes]
    return "\n".join([*lines, f"wrote {', '.join(map(str, paths))}"])
