"""Does touching by turns keep its promise, and does it need fewer touches than one shot, planned or spread evenly?

Setup: robots drawn from the priors of the paper's cell (41 mm off at the tip, 1 sigma in the worst direction), faces
off by their tolerances, touches that scatter by 0.05 mm, a controller that cannot tell what was met. A campaign
touches, identifies and plans (quickly) by turns until it promises 0.15 mm (95 % of the poses of the zone, 95 of 100
robots), for 50 robots. One shot makes 100, 200 or 400 touches planned for the robot on the drawing (`optimal`) or
spread evenly over the faces, searched for as far as a campaign searches first, and identified as a campaign does; ten
of the robots. All touches that are tried count. The tip is compared with the truth at 500 poses of the zone.

Answer: yes. 49 of 50 campaigns reached 0.15 mm, after 70 to 189 touches, median 102; one ended at 0.176 mm, where more
touches hardly help. 48 (96 %) kept what they promised, and the worst delivered 0.164 mm. One shot needs 200 to 400
planned touches in the median for the same promise, and even ones do not give it with 400; three of ten robots do not
reach it with 400 planned ones, because touches miss, or meet another face, while the robot is badly known. Medians:

    way         touches   met  reached %  promised mm  delivered mm  kept %
    campaign        102    97         98        0.141         0.096      96
    optimal         100    76          0        0.208         0.140      70
    optimal         200   154         50        0.150         0.113      80
    optimal         400   298         70        0.124         0.083      90
    even            100    88          0        0.473         0.230      90
    even            200   174          0        0.244         0.162      90
    even            400   353          0        0.223         0.135     100

With about as many touches as a campaign takes, one shot promises 0.21 mm and breaks it for three of ten robots. After a
campaign, 48 of 50 robots are better than 0.15 mm.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from identify.estimation.calibrate import CalibrationFailed, calibrate
from identify.estimation.face_association import believe
from identify.model.cell import Cell, Priors
from identify.model.files import InputError
from identify.model.io.calibration_file import Calibration
from identify.model.touch import Plan, Touches
from identify.report.svg import Chart, axis, colour, picture
from identify.uncertainty.posterior import zone_promise
from oed.campaigns.campaign import LONGEST, campaign
from oed.campaigns.stages import Campaign, Job
from oed.planning.plan import COUNT, plan
from oed.planning.uncertain import plan_under_uncertainty
from probe.line.controller import TouchError
from probe.virtual.batch import touch_batch
from probe.virtual.truth import Truth, draw_truth
from studies.common import FEW, arc_welder, zone
from studies.engine import Table, column, distinct, where

TARGET, ROUGH = 0.15, 0.6  # [mm]
NUMBERS, FEWER = (100, 200, 400), (40,)  # touches of one shot
MOST = 250  # touches of a campaign
SMALL = 0.2  # of the tolerances: a robot that takes few touches and short searches
ROBOTS, SHOT = 50, 10  # with campaigns, and how many of them with one shot, too
WAYS = {"campaign": "campaigns, a dot each", "optimal": "one shot, planned", "even": "one shot, even (medians)"}


def tasks(small: bool) -> list[dict[str, Any]]:
    """One robot and way a task; for one shot, one number of touches."""
    size = (SMALL, ROUGH, FEW) if small else (1.0, TARGET, COUNT)
    shared = dict(zip(("off", "target", "offered"), size, strict=True))
    ways, numbers = (("even",), FEWER) if small else (("optimal", "even"), NUMBERS)
    tasks = list[dict[str, Any]]()
    for i in range(1 if small else ROBOTS):
        tasks.append({"robot": i, "way": "campaign", "touches": MOST})
        tasks += [{"robot": i, "way": way, "touches": n} for way in ways for n in numbers if i < SHOT]
    return [task | shared for task in tasks]


def run(
    rng: np.random.Generator, robot: int, way: str, touches: int, off: float, target: float, offered: int
) -> list[dict[str, Any]]:
    """What a campaign of so many touches at the most, or one shot of so many, promised and delivered."""
    cell = _cell(off)
    truth = draw_truth(cell, np.random.default_rng(robot), jig=True)  # the same robot, whatever touches it
    if way == "campaign":
        outcome = _by_turns(cell, truth, target, touches, rng)
    else:
        outcome = _at_once(off, truth, way, touches, offered, rng)
    return [_row(robot, way, truth, target, outcome)]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What some touches came to; without a calibration where they could not identify the robot."""

    touches: int
    hits: int
    promised: float = np.nan  # [mm]
    calibration: Calibration | None = None


@lru_cache(maxsize=2)
def _cell(off: float) -> Cell:
    """The paper's cell with its tolerances times `off`."""
    cell = arc_welder()
    base, tool, link = (
        (off * size[0], off * size[1]) for size in (cell.priors.base, cell.priors.tool, cell.priors.link)
    )
    return replace(cell, priors=Priors(base, tool, link))


def _row(robot: int, way: str, truth: Truth, target: float, outcome: Outcome) -> dict[str, Any]:
    error = np.full(1, np.nan)
    if outcome.calibration is not None:
        tip = outcome.calibration.cell.kinematics.tip(zone(500), outcome.calibration.theta)[0]
        error = np.linalg.norm(tip - arc_welder().kinematics.tip(zone(500), truth.theta)[0], axis=1)
    return {
        "robot": robot,
        "way": way,
        "touches": outcome.touches,
        "hits": outcome.hits,
        "promised_p95_mm": outcome.promised,
        "delivered_p95_mm": float(np.quantile(error, 0.95)),
        "target_mm": target,
    }


def _by_turns(cell: Cell, truth: Truth, target: float, most: int, rng: np.random.Generator) -> Outcome:
    def touch(job: Job) -> Touches:
        return touch_batch(replace(cell, touch=job.cell.touch), truth, job.plan, rng, blind=True)

    def planner(cell: Cell, n: int, rng: np.random.Generator, after: Calibration | None) -> Plan:
        return plan_under_uncertainty(cell, n, rng, after)

    try:
        result: Campaign = campaign(cell, target_mm=target, max_touches=most, rng=rng, touch=touch, planner=planner)
    except (InputError, TouchError, CalibrationFailed):  # it says why and stops: this robot is not reached
        return Outcome(most, 0)
    hits = sum(stage.hits for stage in result.stages)
    return Outcome(
        result.touches, hits, np.nan if result.promised_mm is None else result.promised_mm, result.calibration
    )


def _at_once(off: float, truth: Truth, strategy: str, n: int, offered: int, rng: np.random.Generator) -> Outcome:
    cell, (wide, result) = _cell(off), _shot(off, strategy, n, offered)
    touches = touch_batch(wide, truth, result, rng, blind=True)
    met = touches.measured()
    try:
        belief = believe(cell, met)
        good = met.take(belief.as_planned(met))
        calibration = calibrate(cell, good, start=belief.theta, folds=0)
    except (InputError, CalibrationFailed):
        return Outcome(n, len(met))
    return Outcome(n, len(met), zone_promise(calibration).p95_mm, calibration)


@lru_cache(maxsize=16)
def _shot(off: float, strategy: str, n: int, count: int) -> tuple[Cell, Plan]:
    """Touches for the robot on the drawing, and the cell with the search of a campaign's first stage."""
    cell = _cell(off)
    approach = max(cell.touch.approach, off * LONGEST)
    wide = replace(cell, touch=replace(cell.touch, approach=approach, travel=2 * approach))
    result = plan(wide, n, rng=np.random.default_rng(n), strategy=strategy, count=count, lifting=False)
    return wide, result.plan


def answer(table: Table) -> str:
    """A line for the campaigns and each number of touches of one shot, and how many each way needs."""
    lines = [f"{'way':10}{'touches':>9}{'met':>6}{'reached %':>11}{'promised mm':>13}{'delivered mm':>14}{'kept %':>8}"]
    for way in distinct(table, "way"):
        every = where(table, way=way)
        numbers = [None] if way == "campaign" else distinct(every, "touches")
        lines += [_line(way, every if n is None else where(every, touches=n)) for n in numbers]
    needs = [f"{way} {_needs(where(table, way=way))}" for way in distinct(table, "way")]
    return "\n".join([*lines, "", "touches until the promise is reached, median of the robots: " + ", ".join(needs)])


def _line(way: str, some: Table) -> str:
    """Medians over the robots, and the share of promises that are kept."""
    promised, delivered = column(some, "promised_p95_mm"), column(some, "delivered_p95_mm")
    promising = np.isfinite(promised)
    share = 100 * float(np.mean(delivered[promising] <= promised[promising])) if promising.any() else 0.0
    middle = [np.median(x[promising]) if promising.any() else np.nan for x in (promised, delivered)]
    return (
        f"{way:10}{np.median(column(some, 'touches')):9.0f}{np.median(column(some, 'hits')):6.0f}"
        f"{100 * np.mean(promised <= column(some, 'target_mm')):11.0f}{middle[0]:13.3f}{middle[1]:14.3f}{share:8.0f}"
    )


def _needs(some: Table) -> str:
    """The fewest touches with which each robot reached the target; the median, or more than all that were tried."""
    touches, reached = column(some, "touches"), column(some, "promised_p95_mm") <= column(some, "target_mm")
    robots = column(some, "robot")
    fewest = [np.min(touches[(robots == i) & reached], initial=np.inf) for i in np.unique(robots)]
    middle = float(np.median(fewest))
    return f"{middle:.0f}" if np.isfinite(middle) else f"> {touches.max():.0f}"


def pictures(table: Table) -> dict[str, str]:
    """Touches and tip error: dots for campaigns, one each robot, lines through the medians of one shot."""
    ways = distinct(table, "way")
    shades = dict(zip(ways, colour(np.linspace(0.0, 0.75, len(ways))), strict=True))
    names, target = ("promised", "delivered"), float(column(table, "target_mm")[0])
    series = [_drawn(where(table, way=way), name)[1] for way in ways for name in names]
    every = np.concatenate([*series, [target]])
    chart = Chart(
        "Touches, and the tip error promised (solid, large dots) and delivered (dashed, small dots)",
        axis("touches tried", column(table, "touches"), zero=True),
        axis("95 % tip error in the zone, mm", every[np.isfinite(every)], zero=True),
        width=560,
        height=360,
    )
    for way, shade in shades.items():
        some = where(table, way=way)
        for name in names:
            touches, error = _drawn(some, name)
            hints = [f"{n:.0f} touches: {name} {e:.3f} mm" for n, e in zip(touches, error, strict=True)]
            if way != "campaign":
                chart.line(touches, error, shade, dashed=name == "delivered")
            chart.dots(touches, error, shade, hints, 3.0 if name == "promised" else 1.6)
    chart.level(target, "target")
    chart.legend([(shade, WAYS[way]) for way, shade in shades.items()])
    return {"campaign": picture(chart)}


def _drawn(some: Table, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Touches and errors: of every campaign, or the medians for each number of touches of one shot."""
    touches, error = column(some, "touches"), column(some, f"{name}_p95_mm")
    finite = np.isfinite(error)
    if some["way"][0] == "campaign":
        return touches[finite], error[finite]
    numbers = np.unique(touches[finite])
    return numbers, np.array([np.median(error[finite & (touches == n)]) for n in numbers])
