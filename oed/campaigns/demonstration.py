"""The whole loop on the embedded virtual robot, whose truth is compared with the result at the end."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from json import dumps
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from identify.compensation.compensate import compensate
from identify.estimation.calibrate import calibrate
from identify.estimation.face_association import as_identified
from identify.estimation.verdict import with_promise
from identify.estimation.verification import Verification, verify
from identify.model.cell import Cell
from identify.model.files import InputError, digest, read_text, sheet_text, write_text
from identify.model.frames import pose
from identify.model.identifiability import structure
from identify.model.io.calibration_file import Calibration, summarize, write_calibration
from identify.model.io.description import library, read_cell
from identify.model.io.entries import POSE_KEYS, POSE_UNIT
from identify.model.io.tables import positions_text, read_positions, read_touches, touches_text
from identify.model.touch import Positions, Touches, joined
from identify.model.zone import zone_poses
from identify.report.report import report
from identify.uncertainty.posterior import zone_promise
from oed.campaigns.campaign import SPARE, campaign
from oed.campaigns.connection import SIM, Connection
from oed.campaigns.folder import Folder, only_one, over_port
from oed.campaigns.stages import Campaign, Job
from oed.planning.plan import plan as plan_touches
from oed.planning.uncertain import plan_under_uncertainty
from probe import Settings
from probe.motion.tour import minutes
from probe.virtual.truth import Truth, read_truth, truths

UNSEEN = 20  # touches, and as many measured tip positions, kept for verification
POSES = 1000  # of the zone, where the hidden truth is compared at the end
SEAM = 15  # points of a program to correct
GOAL_MM = 0.05  # RMS of the tip error at the poses of the zone
TARGET_MM = 0.01  # out of reach: all touches are made
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Demonstration:
    """What the loop took, and how accurate it made the robot."""

    effort: dict[str, Any]
    compared: dict[str, Any]
    touches: Verification
    positions: Verification

    @property
    def passed(self) -> bool:
        """Whether the tip is as accurate as it should be."""
        return bool(self.compared["zone_rms_mm"] <= GOAL_MM)


def demonstrate(folder: Path, touches: int, seed: int, progress: Progress) -> Demonstration:
    """Plan, touch, identify, verify and correct, all into a folder; the same call goes on where it was stopped."""
    with only_one(folder):
        cell = _begun(folder, touches, seed)
        truth = read_truth(truths()["arc-welder"], cell)  # for the virtual robot, and for the comparison at the end
        calibration, effort = _calibrated(folder, cell, truth, touches, seed, progress)
        verified = _verified(folder, calibration)
        _use(folder, calibration, verified)
        return Demonstration(effort, _compared(cell, truth, calibration), *verified)


def _begun(folder: Path, touches: int, seed: int) -> Cell:
    """The cell of the demo in its folder; raises InputError where the folder holds something else."""
    least = structure(read_cell(library("cells")["arc-welder"])).rank + SPARE
    if touches < least:
        raise InputError(f"{touches} touches cannot identify the robot of the demo; give -n {least} or more")
    mine = f"{dumps({'touches': touches, 'seed': seed})}\n"
    texts = {"cell.yaml": read_text(library("cells")["arc-welder"]), "demo.json": mine}
    there = [folder / name for name in texts if (folder / name).exists()]
    for path in there:
        if read_text(path) != texts[path.name]:
            raise InputError(f"{path} is not that of this demo; choose another folder with -o, or clear this one")
    for name in texts:
        write_text(folder / name, texts[name])
    return read_cell(folder / "cell.yaml")


def _calibrated(
    folder: Path, cell: Cell, truth: Truth, touches: int, seed: int, progress: Progress
) -> tuple[Calibration, dict[str, Any]]:
    """The touches of all stages and those for verification, made by the virtual robot; and what they tell."""
    rng, inputs = np.random.default_rng(seed), _hashes(folder, "cell.yaml")
    result = campaign(
        cell,
        target_mm=TARGET_MM,
        max_touches=touches,
        rng=rng,
        touch=_toucher(folder, cell, truth, seed),
        keep=Folder(folder, cell, inputs),
        batch=touches,
        planner=plan_under_uncertainty,  # without the last refinement: a demonstration is short
        progress=progress,
    )
    _unseen(folder, cell, result.calibration, truth, seed)
    every = reduce(joined, (stage.touches for stage in result.stages))
    write_text(folder / "touches.csv", touches_text(every, cell.robot))
    inputs = _hashes(folder, "cell.yaml", "touches.csv")
    calibration = with_promise(calibrate(cell, read_touches(folder / "touches.csv", cell), inputs=inputs))
    write_calibration(folder / "calibration.json", calibration)
    return calibration, _effort(result)


def _effort(result: Campaign) -> dict[str, Any]:
    """What it took."""
    return {
        "touches": result.touches,
        "hits": sum(stage.hits for stage in result.stages),
        "stages": len(result.stages),
        "minutes": sum(minutes(stage.job.cell, stage.job.plan) for stage in result.stages),
    }


def _toucher(folder: Path, cell: Cell, truth: Truth, seed: int) -> Callable[[Job], Touches]:
    """What makes the touches of a job: the real driver, and a virtual robot behind a pseudo-terminal."""
    return over_port(folder, cell, Connection(SIM, "line", truth=truth, seed=seed), Settings(trust_position=True))


def _hashes(folder: Path, *names: str) -> dict[str, str]:
    return {name: digest(folder / name) for name in names}


def _unseen(folder: Path, cell: Cell, calibration: Calibration, truth: Truth, seed: int) -> None:
    """Touches anywhere on the jig, and tip positions all over the zone as a tracker would measure them."""
    rng = np.random.default_rng([seed, 1])
    store = Folder(folder / "unseen", cell, {})
    store.path.mkdir(exist_ok=True)
    stage = store.planned(1)
    length = {"approach_mm": cell.touch.approach, "travel_mm": cell.touch.travel}
    random_plan = plan_touches(cell, UNSEEN, strategy="random", after=calibration, rng=rng, lifting=False).plan
    plan = store.keep_plan(1, random_plan, length) if stage is None else stage[0]
    job = Job(1, as_identified(cell, calibration), plan, True, 0.0)
    touches = _toucher(store.path, cell, truth, seed + UNSEEN)(job)
    write_text(folder / "unseen.csv", touches_text(touches, cell.robot))
    q = zone_poses(calibration.cell, calibration.theta, UNSEEN, rng=rng)
    point = cell.kinematics.tip(q, truth.theta)[0] + cell.touch.sigma * rng.standard_normal((UNSEEN, 3))
    tables = Positions(tuple(f"p{i + 1}" for i in range(UNSEEN)), q, point, np.full(UNSEEN, cell.touch.sigma))
    write_text(folder / "unseen-positions.csv", positions_text(tables, cell.robot))


def _verified(folder: Path, calibration: Calibration) -> tuple[Verification, Verification]:
    """Errors at touches and at tip positions that the fit has not seen."""
    touched = verify(calibration, read_touches(folder / "unseen.csv", calibration.cell))
    return touched, verify(calibration, read_positions(folder / "unseen-positions.csv", calibration.cell))


def _use(folder: Path, calibration: Calibration, verified: tuple[Verification, Verification]) -> None:
    """The report, and a seam corrected."""
    touches = read_touches(folder / "touches.csv", calibration.cell)
    write_text(folder / "report.html", report(calibration, [touches], verified[1]))
    seam = _seam(calibration.cell)
    names = [f"s{i + 1}" for i in range(len(seam))]
    for file, poses in (("poses.csv", seam), ("corrected.csv", compensate(calibration, seam).command)):
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


def _compared(cell: Cell, truth: Truth, calibration: Calibration) -> dict[str, Any]:
    """The tip at unseen poses of the zone beside the hidden truth, and what was promised of it."""
    q = zone_poses(calibration.cell, calibration.theta, POSES, rng=np.random.default_rng(12345))
    tip = cell.kinematics.tip(q, truth.theta)[0]
    before, after = (
        summarize(np.linalg.norm(one.kinematics.tip(q, theta)[0] - tip, axis=1))
        for one, theta in ((cell, cell.theta), (calibration.cell, calibration.theta))
    )
    residuals = np.array([r.before_mm for r in calibration.residuals.values()])
    return {
        "initial_rms_mm": summarize(residuals).rms_mm,
        "zone_rms_mm": after.rms_mm,
        "before": before,
        "after": after,
        "promise": {"p95_mm": zone_promise(calibration).p95_mm},
    }
