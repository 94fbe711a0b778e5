"""`touchcal report`."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from identify.estimation.verification import verify
from identify.model.files import digest, write_text
from identify.model.io.calibration_file import Calibration, calibration_entry, read_calibration
from identify.report.certificate import Issue
from identify.report.report import report as make
from oed.cli.options import ladder_lines, read_measured


def report(
    calibration: Path,
    *,
    unseen: Annotated[tuple[Path, ...], Parameter(negative=())] = (),
    since: Annotated[tuple[Path, ...], Parameter(negative=())] = (),
    operator: str = "",
    output: Annotated[Path, Parameter(name=["-o", "--output"])] = Path("report.html"),
) -> None:
    """Write one self-contained HTML page of a calibration, with a 3-D view, and its numbers as JSON beside it.

    The touches are shown where the files that were identified from still lie beside the calibration, unchanged.
    Example:

        touchcal report calibration.json --unseen unseen.csv -o report.html

    Parameters
    ----------
    calibration
        What touchcal identify wrote.
    unseen
        Touches or positions that were not used: the page then states an accuracy.
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

    found = read_calibration(calibration)
    measured, _ = read_measured(list(_inputs(found, calibration.parent)), found.cell, trust_units=True)
    verified = verify(found, *read_measured(unseen, found.cell, trust_units=False)[0]) if unseen else None
    issue = Issue(date.today().isoformat(), operator, version=version("touchcal"))
    earlier = [(str(path), read_calibration(path)) for path in since]
    write_text(output, make(found, measured, verified, issue=issue, earlier=earlier))
    write_text(output.with_suffix(".json"), dumps(calibration_entry(found), indent=1) + "\n")
    print("\n".join([*ladder_lines(found), f"wrote {output}; open it in a browser, it needs no network"]))


def _inputs(found: Calibration, folder: Path) -> Iterable[Path]:
    """Files of the fit that are still there and unchanged."""
    for name, known in found.inputs.items():
        path = folder / name
        if path.suffix == ".csv" and path.is_file() and digest(path) == known:
            yield path
