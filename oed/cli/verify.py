"""`touchcal verify`."""

from dataclasses import asdict
from pathlib import Path

from identify.model.files import InputError
from oed.cli.options import Json, TrustUnits, errors_table, print_json, read_measured


def verify(calibration: Path, *files: Path, trust_units: TrustUnits = False, json: Json = False) -> None:
    """Errors at touches or positions that the fit has not seen: an accuracy, and what was promised.

    Measurements that were used in the fit are refused, in whatever file they stand. Example:

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
    measured, _ = read_measured(files, identified.cell, trust_units)
    found = verify_measured(identified, *measured)
    if json:
        print_json(
            asdict(found.identified)
            | {"promised_p95_mm": found.promised_p95_mm, "kept": found.kept, "nominal": asdict(found.nominal)}
            | {"beyond": list(found.beyond), "beyond_in_zone": list(beyond_in_zone(identified))}
        )
        return
    print(errors_table({"nominal robot": found.nominal, "identified robot, unseen": found.identified}))
    kept = "kept" if found.kept else "NOT kept"
    print(f"promised 95 %: {found.promised_p95_mm:.3f} mm (sensor and jig included), {kept}")
    if found.beyond:
        print(f"of these poses, beyond the data of the fit: {'; '.join(found.beyond)}")
    without = beyond_in_zone(identified)
    if without:
        print(f"of the zone, beyond the data of the fit: {'; '.join(without)}")
