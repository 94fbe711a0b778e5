"""`touchcal demo`."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from jaxtyping import Float

from identify.calibration import calibrate
from identify.compensation import compensate
from identify.model.calibration import Calibration, Errors, summarize, write_calibration
from identify.model.cell import Cell
from identify.model.description import library, read_cell
from identify.model.entries import POSE_KEYS, POSE_UNIT
from identify.model.files import digest, read_text, sheet_text, write_text
from identify.model.frames import pose
from identify.model.tables import positions_text, read_positions, read_touches, touches_text
from identify.model.touch import Positions, Touches
from identify.report.report import report
from identify.verification import Verification, verify
from oed.assurance import assurance
from oed.campaign import Job, joined
from oed.campaign import campaign as make
from oed.cli.campaign import PATIENCE, only_one
from oed.cli.options import Json, Seed, errors_table, print_json, progress
from oed.cli.project import Folder, over_port, standing
from oed.planning import plan as make_plan
from oed.posterior import believed
from oed.zone import zone_poses
from probe import Settings
from probe.clock import Clock
from probe.virtual.server import serve
from probe.virtual.truth import Truth, read_truth, truths

UNSEEN = 20  # touches, and as many measured tip positions, kept for verification
POSES = 1000  # of the zone, where the hidden truth is compared at the end
SEAM = 15  # points of a program to correct
GOAL_MM = 0.05  # RMS of the tip error at the poses of the zone
HURRY = 60.0  # times faster than real time
SECONDS = 7.0  # of a touch at 5 mm/s, the way to the next included
TARGET_MM = 0.01  # out of reach: all touches are made


def demo(
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])] = Path("demo"),
    touches: Annotated[int, Parameter(name=["-n", "--touches"])] = 100,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """The whole loop on the embedded virtual robot: plan, touch, identify, verify.

    The virtual robot is the paper's, off by 27 mm in ways that only it knows; touches are made over a pseudo-terminal,
    as on a real robot. The folder that is written can be copied as the start of a real project. Exit code 0 and PASS if
    the tip is as accurate as it should be. Example:

        touchcal demo -o demo

    Parameters
    ----------
    output
        The folder to write; made where it does not exist. The same command goes on where it was stopped.
    touches
        How many touches to plan.
    """
    with only_one(output):
        write_text(output / "cell.yaml", read_text(library("cells")["arc-welder"]))
        cell = read_cell(output / "cell.yaml")
        truth = read_truth(truths()["arc-welder"], cell)  # for the virtual robot, and for the comparison at the end
        found = _calibrated(output, cell, truth, touches, seed, not json)
        verified = _verified(output, found)
        _use(output, found, verified)
    return _tell(output, truth, found, verified, json)


def _calibrated(folder: Path, cell: Cell, truth: Truth, touches: int, seed: int, show: bool) -> Calibration:
    """The touches of all stages and those for verification, made by the virtual robot; and what they tell."""
    rng, clock = np.random.default_rng(seed), Clock(HURRY)
    settings = Settings(trust_position=True, stuck=PATIENCE)
    inputs = _hashes(folder, "cell.yaml")

    @contextmanager
    def port(job: Job) -> Iterator[str]:
        with serve(cell, truth, speed=HURRY, seed=seed, start=standing(folder, cell, job)) as served:
            yield served.url

    touch = over_port(folder, cell, port, "line", settings, clock)
    with progress(show) as say:
        done = make(
            cell, target_mm=TARGET_MM, max_touches=touches, rng=rng, touch=touch, keep=Folder(folder, cell, inputs),
            batch=touches, progress=say,
        )  # fmt: skip
        _unseen(folder, done.calibration, truth, len(done.stages), touch, rng)
    made = done.stages[0].touches
    for stage in done.stages[1:]:
        made = joined(made, stage.touches)
    write_text(folder / "touches.csv", touches_text(made, cell.robot, cell.jig))
    inputs = _hashes(folder, "cell.yaml", "touches.csv")
    found = calibrate(cell, read_touches(folder / "touches.csv", cell), inputs=inputs)
    write_calibration(folder / "calibration.json", found)
    return found


def _hashes(folder: Path, *names: str) -> dict[str, str]:
    return {name: digest(folder / name) for name in names}


def _unseen(
    folder: Path, known: Calibration, truth: Truth, stages: int, touch: Callable[[Job], Touches],
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """Touches anywhere on the jig, and tip positions all over the zone as a tracker would measure them."""
    cell = known.cell
    plan = make_plan(cell, UNSEEN, strategy="random", after=known, rng=rng).plan
    kept = Folder(folder, cell, {})
    number = stages + 1
    made = kept.planned(number)
    length = {"approach_mm": cell.touch.approach, "travel_mm": cell.touch.travel}
    plan = kept.keep_plan(number, plan, length) if made is None else made[0]
    found = touch(Job(number, believed(cell, known.theta), plan, True, 0.0))
    write_text(folder / "unseen.csv", touches_text(found, cell.robot, cell.jig))
    q = zone_poses(cell, known.theta, UNSEEN, rng=rng)
    point = cell.kinematics.tip(q, truth.theta)[0] + cell.touch.sigma * rng.standard_normal((UNSEEN, 3))
    measured = Positions(tuple(f"p{i + 1}" for i in range(UNSEEN)), q, point, np.full(UNSEEN, cell.touch.sigma))
    write_text(folder / "unseen-positions.csv", positions_text(measured, cell.robot))


def _verified(folder: Path, found: Calibration) -> tuple[Verification, Verification]:
    """Errors at touches and at tip positions that the fit has not seen."""
    touched = verify(found, read_touches(folder / "unseen.csv", found.cell))
    return touched, verify(found, read_positions(folder / "unseen-positions.csv", found.cell))


def _use(folder: Path, found: Calibration, verified: tuple[Verification, Verification]) -> None:
    """The report, and a seam corrected."""
    made = read_touches(folder / "touches.csv", found.cell)
    write_text(folder / "report.html", report(found, [made], verified[1]))
    wanted = _seam(found.cell)
    names = [f"s{i + 1}" for i in range(len(wanted))]
    for file, poses in (("poses.csv", wanted), ("corrected.csv", compensate(found, wanted).command)):
        columns: dict[str, Any] = {"id": names} | dict(zip(POSE_KEYS, (poses / POSE_UNIT).T.round(6), strict=True))
        write_text(folder / file, sheet_text(columns))


def _seam(cell: Cell) -> Float[np.ndarray, "points 6"]:
    """Points along x through the middle of the zone, with a torch that the robot reaches there."""
    q = zone_poses(cell)
    tip, R = cell.kinematics.tip(q, cell.theta)
    assert cell.zone is not None
    middle = cell.zone.box.mean(axis=1)
    i = int(np.argmin(np.linalg.norm(tip - middle, axis=1)))
    T = np.tile(np.eye(4), (SEAM, 1, 1))
    T[:, :3, :3], T[:, :3, 3] = R[i], tip[i] + np.linspace(-40, 40, SEAM)[:, None] * [1, 0, 0]
    return pose(T)


def _tell(
    folder: Path, truth: Truth, found: Calibration, verified: tuple[Verification, Verification], json: bool
) -> int:
    """Compare with the truth at unseen poses of the zone: PASS or FAIL."""
    cell = found.cell
    q = zone_poses(cell, found.theta, POSES, rng=np.random.default_rng(12345))
    tip = cell.kinematics.tip(q, truth.theta)[0]
    before, after = (
        summarize(np.linalg.norm(cell.kinematics.tip(q, theta)[0] - tip, axis=1)) for theta in (cell.theta, found.theta)
    )
    made = read_touches(folder / "touches.csv", cell)
    used = np.array([found.residuals[name].used for name in made.ids])
    promise = assurance(cell, found, made.take(used)).promised()
    passed = after.rms_mm <= GOAL_MM
    if json:
        residuals = np.array([r.before_mm for r in found.residuals.values()])
        print_json({
            "touches": len(made), "initial_rms_mm": summarize(residuals).rms_mm, "zone_rms_mm": after.rms_mm,
            "promise": {"p95_mm": promise}, "passed": passed,
        })  # fmt: skip
    else:
        print(_story(folder, found, (before, after), verified, promise, passed))
    return 0 if passed else 1


def _story(
    folder: Path, found: Calibration, zone: tuple[Errors, Errors], verified: tuple[Verification, Verification],
    promise: float, passed: bool,
) -> str:  # fmt: skip
    """The end, as a person reads it."""
    touched, positions = verified
    rows = {
        "tip in the zone, nominal robot": zone[0],
        "tip in the zone, identified": zone[1],
        "unseen tip positions, identified": positions.identified,
        "unseen touches, nominal robot": touched.nominal,
        "unseen touches, identified": touched.identified,
    }
    n = len(found.residuals)
    return (
        f"{errors_table(rows)}\n\n"
        f"{n} touches, about {n * SECONDS / 60:.0f} minutes on a real robot\n"
        f"promised by the touches: 95 % of the zone within {promise:.3f} mm; delivered {zone[1].p95_mm:.3f} mm\n"
        f"{'PASS' if passed else 'FAIL'}: tip RMS {zone[1].rms_mm:.3f} mm, to be at most {GOAL_MM} mm; "
        f"report.html, corrected.csv and all else in {folder}"
    )
