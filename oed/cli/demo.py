"""`touchcal demo`."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from identify.calibration import calibrate
from identify.model.calibration import Calibration, summarize, write_calibration
from identify.model.cell import Cell
from identify.model.description import library, read_cell
from identify.model.files import InputError, digest, read_text, write_text
from identify.model.tables import plan_text, read_touches, touches_text
from identify.model.zone import zone_poses
from identify.verification import verify
from oed.cli.options import Json, Seed, errors_table, print_json, progress
from oed.cli.plan import write_summary
from oed.planning import PlanResult, summary
from oed.planning import plan as make_plan
from probe.virtual.batch import touch_batch
from probe.virtual.truth import Truth, read_truth, truths

UNSEEN = 40  # touches kept for verification
POSES = 1000  # of the zone, where the hidden truth is compared at the end
GOAL_MM = 0.06  # RMS of the tip error at those poses


def demo(
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])] = Path("demo"),
    touches: Annotated[int, Parameter(name=["-n", "--touches"])] = 100,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """The whole loop on the embedded virtual robot: plan, touch, identify, verify.

    The virtual robot is the paper's, off by 22 mm in ways that only it knows. The folder that is written can be copied
    as the start of a real project. Exit code 0 and PASS if the tip is as accurate as it should be. Example:

        touchcal demo -o demo

    Parameters
    ----------
    output
        The folder to write; made where it does not exist.
    touches
        How many touches to plan.
    """
    folder = _folder(output)
    write_text(folder / "cell.yaml", read_text(library("cells")["arc-welder"]))
    cell = read_cell(folder / "cell.yaml")
    rng = np.random.default_rng(seed)
    truth = read_truth(truths()["arc-welder"], cell)  # for the virtual robot, and for the comparison at the end
    with progress(not json) as say:
        planned = make_plan(cell, touches, rng=rng, progress=say)
        _write_plan(folder / "plan.csv", cell, planned, folder)
        unseen = make_plan(cell, UNSEEN, strategy="random", rng=rng)
    _touch(folder / "touches.csv", cell, truth, planned, rng)
    _touch(folder / "unseen.csv", cell, truth, unseen, rng)
    found = calibrate(
        cell, read_touches(folder / "touches.csv", cell), inputs=_hashes(folder, "cell.yaml", "touches.csv")
    )
    write_calibration(folder / "calibration.json", found)
    return _tell(folder, cell, truth, planned, found, json)


def _folder(path: Path) -> Path:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be made: {error.strerror}; choose another folder with -o") from None
    return path


def _hashes(folder: Path, *names: str) -> dict[str, str]:
    return {name: digest(folder / name) for name in names}


def _write_plan(path: Path, cell: Cell, result: PlanResult, folder: Path) -> None:
    write_text(path, plan_text(result.plan, cell.robot))
    write_summary(path.with_suffix(".json"), summary(result), _hashes(folder, "cell.yaml"))


def _touch(path: Path, cell: Cell, truth: Truth, planned: PlanResult, rng: np.random.Generator) -> None:
    """The virtual robot makes the touches."""
    write_text(path, touches_text(touch_batch(cell, truth, planned.plan, rng), cell.robot))


def _tell(folder: Path, cell: Cell, truth: Truth, planned: PlanResult, found: Calibration, json: bool) -> int:
    """Compare with unseen touches, and with the truth at unseen poses of the zone."""
    unseen = verify(found, read_touches(folder / "unseen.csv", cell))
    q = zone_poses(cell, found.theta, POSES, rng=np.random.default_rng(12345))
    tip = cell.kinematics.tip(q, truth.theta)[0]
    before, after = (
        summarize(np.linalg.norm(cell.kinematics.tip(q, theta)[0] - tip, axis=1)) for theta in (cell.theta, found.theta)
    )
    passed = after.rms_mm <= GOAL_MM
    if json:
        residuals = np.array([r.before_mm for r in found.residuals.values()])
        told = {
            "touches": len(found.residuals),
            "initial_rms_mm": summarize(residuals).rms_mm,
            "zone_rms_mm": after.rms_mm,
            "promise": asdict(planned.promise),
            "passed": passed,
        }
        print_json(told)
        return 0 if passed else 1
    rows = {
        "tip in the zone, nominal robot": before,
        "tip in the zone, identified": after,
        "unseen touches, nominal robot": unseen.nominal,
        "unseen touches, identified": unseen.identified,
    }
    print(errors_table(rows))
    print(f"\n{len(found.residuals)} touches, about {planned.minutes:.0f} minutes on a real robot")
    print(
        f"promised by the plan: RMS {planned.promise.rms_mm:.3f} mm, 95 % {planned.promise.p95_mm:.3f} mm in the zone"
    )
    print(
        f"{'PASS' if passed else 'FAIL'}: tip RMS {after.rms_mm:.3f} mm, to be at most {GOAL_MM} mm; files in {folder}"
    )
    return 0 if passed else 1
