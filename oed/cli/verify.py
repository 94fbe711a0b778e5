"""`touchcal verify`."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identify.model.files import InputError, digest, write_json, write_text
from oed.cli.options import TOUCHES, Json, TrustUnits, errors_table, inputs_beside, print_json, read_tables
from oed.cli.screen.progress import progress

if TYPE_CHECKING:
    from identify.model.cell import Cell


def verify(calibration: Path, *files: Path, trust_units: TrustUnits = False, json: Json = False) -> None:
    """Errors at touches or positions that the fit has not seen: an accuracy, and what was promised.

    Measurements that were used in the fit are refused, in whatever file they stand. touchcal plan --unseen chooses
    touches for it. Example:

        touchcal verify calibration.json unseen.csv

    Parameters
    ----------
    calibration
        What touchcal identify wrote.
    files
        touches.csv or positions.csv files that were not used.
    """
    from identify.estimation.verification import beyond_in_zone
    from identify.estimation.verification import verify as verify_measured
    from identify.model.io.calibration_file import read_calibration

    if not files:
        raise InputError("nothing to verify with: name a touches.csv or positions.csv that was not used in the fit")
    identified = read_calibration(calibration)
    tables, _ = read_tables(files, identified.cell, trust_units)
    result = verify_measured(identified, *tables)
    if json:
        print_json(
            asdict(result.identified)
            | {"promised_p95_mm": result.promised_p95_mm, "kept": result.kept, "nominal": asdict(result.nominal)}
            | {"beyond": list(result.beyond), "beyond_in_zone": list(beyond_in_zone(identified))}
        )
        return
    print(errors_table({"nominal robot": result.nominal, "identified robot, unseen": result.identified}))
    verdict = "kept" if result.kept else "NOT kept"
    print(f"promised 95 %: {result.promised_p95_mm:.3f} mm (sensor and jig included), {verdict}")
    if result.beyond:
        print(f"of these poses, beyond the data of the fit: {'; '.join(result.beyond)}")
    without = beyond_in_zone(identified)
    if without:
        print(f"of the zone, beyond the data of the fit: {'; '.join(without)}")


def plan_touches(
    cell: "Cell", cell_file: Path, n: int | None, after: Path | None, output: Path, seed: int, json: bool
) -> None:
    """Write the touches to verify with, and a .json file of the same name."""
    from identify.model.io.calibration_file import read_calibration
    from identify.model.io.tables import plan_text, read_plan
    from oed.planning.unseen import plan_unseen

    usual = cell_file.parent / "plan.csv"
    output = Path("unseen-plan.csv") if output == Path("plan.csv") else output
    calibration = None if after is None else read_calibration(after)
    files = [] if calibration is None or after is None else inputs_beside(calibration, after.parent)
    tables, _ = read_tables(files, cell, trust_units=True)
    postures = [table.q for table in tables]
    if usual.is_file() and usual.resolve() != output.resolve():
        postures, files = [*postures, read_plan(usual, cell).q], [*files, usual]
    with progress(not json, "choosing touches"):
        joints = np.concatenate([np.empty((0, len(cell.robot.joints))), *postures])
        result = plan_unseen(cell, joints, n, np.random.default_rng(seed), after=calibration)
    answer = {
        "touches": len(result.plan),
        "apart": result.apart,
        "from": [path.name for path in files],
        "minutes": result.minutes,
        "notes": list(result.notes),
        "seed": seed,
        "next": f"touchcal verify {'calibration.json' if after is None else after} {TOUCHES}",
    }
    write_text(output, plan_text(result.plan, cell.robot))
    write_json(output.with_suffix(".json"), answer, {cell_file.name: digest(cell_file)} | dict(cell.sources))
    if json:
        print_json(answer)
    else:
        print(unseen_story(answer, output, after))


def unseen_story(answer: dict[str, Any], output: Path, after: Path | None) -> str:
    """Touches to verify with, as a person reads of them."""
    option = "" if after is None else f" --after {after}"
    minutes = f"about {answer['minutes']:.0f} minutes"
    lines = [f"{answer['touches']} touches to verify with, spread over all that can be made, {minutes}"]
    if answer["apart"] is None:
        lines.append("note: neither plan.csv nor the files of a fit were found: touches of the fit may be among these")
    else:
        names = ", ".join(answer["from"])
        lines.append(
            f"each differs from each touch of {names} by at least {answer['apart']:.1f} degrees (mm) in a joint"
        )
    lines += [f"note: {sentence}" for sentence in answer["notes"]]
    return "\n".join(
        [
            *lines,
            f"wrote {output}; make them with touchcal run {output}{option} -o unseen.csv,",
            f"then {answer['next'].replace(TOUCHES, 'unseen.csv')}",
        ]
    )
