"""`touchcal report`."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from identify.model.files import write_text
from oed.cli.options import CellFile, inputs_beside, ladder_lines, load_cell, read_tables

if TYPE_CHECKING:
    from identify.model.io.calibration_file import Calibration


def report(
    calibration: Path,
    *files: Path,
    unseen: Annotated[tuple[Path, ...], Parameter(negative=())] = (),
    since: Annotated[tuple[Path, ...], Parameter(negative=())] = (),
    operator: str = "",
    cell: CellFile = Path("cell.yaml"),
    output: Annotated[Path, Parameter(name=["-o", "--output"])] = Path("report.html"),
) -> None:
    """Write one self-contained HTML page of a calibration, with a 3-D view, and its numbers as JSON beside it.

    The touches are shown if the files that were identified from still lie beside the calibration, unchanged; the arm is
    shown with its meshes if the cell file names a URDF that has some.
    Example:

        touchcal report calibration.json unseen.csv -o report.html

    Parameters
    ----------
    calibration
        What touchcal identify wrote.
    files
        Touches or positions that were not used, as for verify: the page then states an accuracy.
    unseen
        The same as an option.
    since
        Earlier calibrations of the same robot: the page then shows what has changed.
    operator
        The name of the person who calibrated, for the certificate.
    output
        Where the page is written; the numbers go into a .json file of the same name.
    """
    from datetime import date
    from importlib.metadata import version
    from json import dumps

    from identify.estimation.verification import verify
    from identify.model.io.calibration_file import calibration_entry, read_calibration
    from identify.report.certificate import Issue
    from identify.report.report import report as make

    calibrated = _with_shapes(read_calibration(calibration), cell)
    tables, _ = read_tables(inputs_beside(calibrated, calibration.parent), calibrated.cell, trust_units=True)
    unseen = (*files, *unseen)
    verified = verify(calibrated, *read_tables(unseen, calibrated.cell, trust_units=False)[0]) if unseen else None
    issue = Issue(date.today().isoformat(), operator, version=version("touchcal"))
    earlier = [(str(path), read_calibration(path)) for path in since]
    write_text(output, make(calibrated, tables, verified, issue=issue, earlier=earlier))
    write_text(output.with_suffix(".json"), dumps(calibration_entry(calibrated), indent=1) + "\n")
    print("\n".join([*ladder_lines(calibrated), f"wrote {output}; open it in a browser, it needs no network"]))


def _with_shapes(calibration: "Calibration", path: Path) -> "Calibration":
    """The calibration of a robot that looks as the cell file says, if that is there and of the same robot."""
    if not path.is_file():
        return calibration
    robot = load_cell(path).robot
    if (robot.name, len(robot.joints)) != (calibration.cell.robot.name, len(calibration.cell.robot.joints)):
        return calibration
    return replace(
        calibration, cell=replace(calibration.cell, robot=replace(calibration.cell.robot, shapes=robot.shapes))
    )
