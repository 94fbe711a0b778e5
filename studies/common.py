"""What several studies start from, computed once a process, and how they judge a promise."""

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float

from identify.model.calibration import Calibration
from identify.model.cell import Cell
from identify.model.io.description import library, read_cell
from identify.model.touch import Plan
from identify.model.zone import zone_poses
from identify.report.svg import AFTER, OUT, Chart, logarithmic, picture
from identify.uncertainty.posterior import zone_promise
from identify.uncertainty.promise import INTERVAL
from oed.planning.candidate_set import CandidateSet, make_candidate_set
from oed.planning.plan import plan
from studies.engine import Table, column

TOUCHES = 100  # as many as the paper made
REFUSED = dict.fromkeys(("promised_mm", "delivered_mm", "rms_mm", "covered"), float("nan"))  # no calibration to judge
FEW = 400  # touches on offer where a study only shows that it works


@lru_cache(maxsize=1)
def arc_welder() -> Cell:
    """The paper's robot and the stepped jig."""
    return read_cell(library("cells")["arc-welder"])


@lru_cache(maxsize=2)
def offered(structured: bool) -> CandidateSet:
    """Touches that the paper's robot can make: structured ones, or only those spread evenly."""
    return make_candidate_set(arc_welder(), np.random.default_rng(7), structured=structured)


@lru_cache(maxsize=1)
def touches_of_the_paper() -> Plan:
    """Touches spread evenly over the faces, as the paper's were."""
    return plan(arc_welder(), TOUCHES, strategy="even", rng=np.random.default_rng(1)).plan


@lru_cache(maxsize=2)
def zone(poses: int) -> Float[np.ndarray, "poses joints"]:
    """Poses of the weld zone where errors are measured: others than those that planning looks at."""
    return zone_poses(arc_welder(), poses=poses, rng=np.random.default_rng(2024))


def judged(
    calibration: Calibration, error: Float[np.ndarray, " poses"], truth: Mapping[str, float], sigma: Mapping[str, float]
) -> dict[str, float]:
    """What a calibration promised, the tip errors [mm] that it leaves, and the share of its intervals that hold.

    `truth` and `sigma` are true values and standard deviations of unknowns by their names, in the model's units.
    """
    value = dict(zip(calibration.cell.robot.parameters, calibration.theta, strict=True)) | {
        s.name: s.value for s in calibration.shared
    }
    inside = [abs(truth[name] - value.get(name, 0.0)) < INTERVAL * s for name, s in sigma.items() if name in truth]
    return {
        "promised_mm": zone_promise(calibration).p95_mm,
        "delivered_mm": float(np.percentile(error, 95)),
        "rms_mm": float(np.sqrt((error**2).mean())),
        "covered": float(np.mean(inside)),
    }


def kept(table: Table) -> tuple[Bool[np.ndarray, " robots"], float, float]:
    """Which robots have a promise, how many percent of them keep it, and promised over delivered in the median."""
    promised, delivered = column(table, "promised_mm"), column(table, "delivered_mm")
    good = np.isfinite(promised)
    share = 100 * (delivered[good] <= promised[good]).mean()
    return good, float(share), float(np.median(promised[good] / delivered[good]))


def picture_of_promises(table: Table, names: Sequence[str] = ()) -> str:
    """Promised and delivered errors of every robot, each under its name if there are `names`."""
    promised, delivered = column(table, "promised_mm"), column(table, "delivered_mm")
    good = np.isfinite(promised)
    chart = Chart(
        "Tip error at 95 % of the poses of the zone: a dot a robot, kept below the line",
        logarithmic("promised, mm", promised[good]),
        logarithmic("delivered, mm", delivered[good]),
        width=480,
        height=360,
    )
    x, y = chart.x.scaled(promised[good]), chart.y.scaled(delivered[good])
    ends = np.array([max(promised[good].min(), delivered[good].min()), promised[good].max()])
    heads = np.array([f"{name}: " for name in names] or [""] * len(good))[good]
    chart.dots(x, y, AFTER, [f"{head}{e:.3f} mm" for head, e in zip(heads, delivered[good], strict=True)])
    chart.line(chart.x.scaled(ends), chart.y.scaled(ends), OUT)
    return picture(chart)
