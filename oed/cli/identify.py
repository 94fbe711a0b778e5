"""`touchcal identify`."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from cyclopts import Parameter

from oed.cli.options import (
    CellFile,
    Json,
    Output,
    Seed,
    TrustUnits,
    errors_table,
    ladder_lines,
    load_cell,
    print_json,
    read_tables,
)
from oed.cli.screen.progress import progress
from oed.cli.screen.unknowns import kind_lines, parameter_lines, shared_lines

if TYPE_CHECKING:
    from identify.model.cell import Cell
    from identify.model.io.calibration_file import Calibration
    from identify.model.measurement import Measurements


@Parameter(name="*")
@dataclass(frozen=True)
class Fit:
    """How parameters are estimated."""

    loss: Literal["huber", "linear", "cauchy"] = "huber"
    """How touches that disagree are found: huber, cauchy, or linear to use all touches as they are."""
    priors: bool = True
    """Use the tolerances of the cell file beside the touches (maximum a posteriori)."""
    parameters: Literal["all", "identifiable"] = "all"
    """all estimates every parameter and every face; the tolerances hold what touches cannot tell apart. identifiable
    drops the parameters that the drawing makes dependent, as the paper does: fewer numbers, each with its name, but
    less accurate for a robot far off its drawing."""
    errors: str = "auto"
    """Joint errors beyond geometry: auto estimates all of them, as large as they predict regions left out best; names,
    with commas between them, take these; none takes none; cell those of the cell file."""


USUAL = Fit()
WEAK = 12  # names that are listed


def identify(
    *files: Path,
    cell: CellFile = Path("cell.yaml"),
    output: Output = Path("calibration.json"),
    fit: Fit = USUAL,
    seed: Seed = 0,
    trust_units: TrustUnits = False,
    keep: bool = False,
    json: Json = False,
) -> None:
    """Identify the parameters that put every touch on its face.

    Files are CSV with a header; a row is of the kind whose columns it fills. Every row needs id and the joints q1_deg
    to q6_deg (q1_mm where a joint slides), as the controller counts them, and

        a touch     face, or nx, ny, nz, offset_mm
        a position  x_mm, y_mm, z_mm of the tip
        a pose      these, and rz_deg, ry_deg, rx_deg
        a distance  anchor, distance_mm
        a contact   point

    Positions and planes stand in the jig frame; anchor and point are points: of the cell file, whose distance from
    the tip was measured, or in which the tip was. A row may have sigma_mm (its scatter; that of the cell file if not
    given), status (rows other than hit are passed over), placement and tool (others than the first of the cell file),
    temperature_c, payload_kg (where other than payload: of the cell file) and note. Touches that disagree with all
    others are named and left out. Examples:

        touchcal identify touches.csv positions.csv -o calibration.json

        touchcal identify touches.csv --errors none

    Parameters
    ----------
    files
        touches.csv and positions.csv files, one or more.
    output
        Where the identified robot is written.
    keep
        Write the calibration even if it must not be used.
    """
    from identify.estimation.selection import cell_with_errors
    from identify.estimation.verdict import hypotheses, refusals, with_promise
    from identify.model.files import InputError
    from identify.model.io.calibration_file import write_calibration

    if not files:
        raise InputError("nothing to identify from: name at least one touches.csv or positions.csv")
    described = cell_with_errors(load_cell(cell), fit.errors)
    tables, inputs = read_tables(files, described, trust_units)
    with progress(not json, "identifying"):
        calibration = with_promise(_calibrated(described, tables, fit, seed, inputs))
    reasons = refusals(calibration)
    if reasons:
        calibration = replace(calibration, findings=(*hypotheses(described, tables), *calibration.findings))
    if keep or not reasons:
        write_calibration(output, calibration)
    _report(calibration, tables, reasons, output, keep, json)


def _report(
    calibration: "Calibration",
    tables: Sequence["Measurements"],
    reasons: Sequence[str],
    output: Path,
    keep: bool,
    json: bool,
) -> None:
    """Print the result; raises CalibrationFailed if it must not be used."""
    from identify.estimation.calibrate import CalibrationFailed

    if json:
        print_json(summary(calibration) | {"refused": list(reasons)})
    else:
        print(story(calibration, output if keep or not reasons else None, tables))
    if reasons:
        note = f"{output} was written all the same" if keep else "nothing was written; --keep writes it all the same"
        raise CalibrationFailed(f"this calibration must not be used: {'; '.join(reasons)}. {note}")


def _calibrated(
    cell: "Cell", tables: Sequence["Measurements"], fit: Fit, seed: int, inputs: Mapping[str, str]
) -> "Calibration":
    """The calibration; raises CalibrationFailed with the likely causes if there is none."""
    from identify.estimation.calibrate import CalibrationFailed, calibrate
    from identify.estimation.verdict import hypotheses

    try:
        return calibrate(
            cell,
            *tables,
            loss=fit.loss,
            priors=fit.priors,
            parameters=fit.parameters,
            errors="auto" if fit.errors == "auto" else "cell",
            rng=np.random.default_rng(seed),
            inputs=inputs,
        )
    except CalibrationFailed as error:
        causes = "; ".join(f"{finding.kind}: {finding.text}" for finding in hypotheses(cell, tables))
        raise CalibrationFailed(f"{error}. {causes}" if causes else str(error)) from None


def summary(c: "Calibration") -> dict[str, Any]:
    """What `--json` says."""
    from identify.compensation.ladder import ladder

    return {
        "rank": len(c.estimated),
        "estimated": list(c.estimated),
        "eliminated": {name: dict(terms) for name, terms in c.combinations.items()},
        "weak": list(c.weak),
        "outliers": dict(c.outliers),
        "errors": list(c.cell.robot.errors),
        "choice": [asdict(term) for term in c.choice],
        "findings": [asdict(finding) for finding in c.findings],
        "scatter": c.scatter,
        "discrepancy": None if c.discrepancy is None else asdict(c.discrepancy),
        "faces": {s.name.removeprefix("face."): s.value for s in c.shared if s.unit == "mm" and s.name[:5] == "face."},
        "shared": {s.name: [s.value / s.inside, sigma / s.inside] for s, sigma in c.named},
        "promise": None if c.promise is None else dict(c.promise),
        "fit": asdict(c.fit),
        "held_out": None if c.held_out is None else asdict(c.held_out),
        "ladder": {rung.way: asdict(rung.errors) for rung in ladder(c)},
        "iterations": c.iterations,
        "solve_s": c.solve_s,
    }


def story(c: "Calibration", output: Path | None, tables: Sequence["Measurements"] = ()) -> str:
    """The result as a person reads it; no `output` if nothing was written."""
    from identify.model.io.calibration_file import summarize
    from identify.uncertainty.promise import Promise

    before = summarize(np.array([r.before_mm for r in c.residuals.values() if r.used]))
    lines = [
        f"{len(c.estimated)} of {len(c.theta)} parameters estimated from {len(c.residuals)} measurements, "
        f"{c.iterations} iterations, {1000 * c.solve_s:.0f} ms",
        *kind_lines(tables),
        "",
        errors_table({"nominal robot, residuals": before, "fit (no accuracy)": c.fit, "regions held out": c.held_out}),
        "",
        *_choice(c),
        *_scatter(c),
        *(f"{finding.kind}: {finding.text}" for finding in c.findings),
        *_listed("left out, they disagree", [f"{name} ({r:+.2f} mm)" for name, r in c.outliers.items()]),
        *_listed("weak, the tolerances tell more", c.weak if len(c.weak) <= WEAK else []),
        *_listed("weak, the tolerances tell more of", [f"{len(c.weak)} unknowns"] if len(c.weak) > WEAK else []),
        *_listed("eliminated", [_carried(name, terms) for name, terms in c.combinations.items()]),
        "",
        *parameter_lines(c),
        *shared_lines(c),
        "",
        *ladder_lines(c),
        *_listed("promise for the zone", [] if c.promise is None else [str(Promise(**c.promise))]),
    ]
    if output is not None:
        lines += [f"wrote {output}; an accuracy comes from touches not used here: touchcal verify {output} FILE"]
    return "\n".join(lines)


def _choice(c: "Calibration") -> list[str]:
    """What every error model buys in regions held out, where the touches chose among them."""
    if not c.choice:
        return []
    first = c.choice[0]
    lines = [
        f"{'beyond geometry, regions held out':36}{'mean mm':>9}{'buys mm':>9}{'+-':>8}",
        f"{'  geometry alone':36}{first.held_out_mm + first.gain_mm:9.3f}",
        *(
            f"{f'  {term.name}':36}{term.held_out_mm:9.3f}{term.gain_mm:9.4f}{term.standard_error_mm:8.4f}"
            f"{'  kept' if term.kept else ''}"
            for term in c.choice
        ),
    ]
    names = ", ".join(c.cell.robot.errors)
    advice = f"errors: [{names}] in cell.yaml makes plans see them" if names else "the touches ask for nothing more"
    sizes = c.discrepancy
    if sizes is not None and not c.combinations:
        advice = (
            f"all of them are estimated, {sizes.errors:.2g} times as large as usual, the geometry {sizes.geometry:.2g} "
            f"times its tolerances, the noise {sizes.noise:.2g} times the stated sigma; {advice}"
        )
    return [*lines, advice, ""]


def _scatter(c: "Calibration") -> list[str]:
    if not c.scatter_significant:
        return [f"residuals scatter as the stated sigma says (x {c.scatter:.2f})"]
    if c.scatter < 1:
        return [f"residuals scatter less than the stated sigma (x {c.scatter:.2f}): sigma_mm may be smaller"]
    far = ["or it is so far off its drawing that --parameters all is the better choice"] if c.combinations else []
    far_off = [finding.kind for finding in c.findings if finding.kind in ("base", "tool")]
    if far_off:
        return [f"residuals scatter {c.scatter:.2f} times the stated sigma: correct {' and '.join(far_off)} first"]
    return [
        f"residuals scatter {c.scatter:.2f} times the stated sigma: intervals are widened by that; the touches are",
        "worse than stated (joints read before the robot settled?), or the robot bends more than the model knows",
        *far,
    ]


def _listed(title: str, items: Any) -> list[str]:
    return [f"{title}: {', '.join(items)}"] if items else []


def _carried(name: str, terms: Any) -> str:
    if not terms:
        return f"{name} (no effect on the tip)"
    return f"{name} ({', '.join(f'{c:+.4g} {carrier}' for carrier, c in terms.items())})"
