"""Does the choice of joint errors find what a robot has, and nothing else?

Setup: an arm of the size of an IRB 120 makes 300 touches all over its reach, from both sides of every joint, at 10 to
30 degrees, with a scatter of 0.05 mm along x, y or z. Its geometry is off by the usual tolerances. In truth it has no
joint errors, those of one model, or those of all six; every error has half to one and a half times the usual size, to
either side (links only grow when it is warm). The touches choose, 100 robots a case; then each chosen model's errors
are compared with the truth. All is linear about the drawing, as the choice itself is.

Answer: yes. Exactly the true models are chosen in all 800 trials: nothing where there is nothing, one where there is
one, all six where there are six. Of the values of the chosen models 95 to 98 % lie inside their 95 % intervals.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float

from identify.estimation.folds import regions
from identify.estimation.selection import Linear, choose, with_errors
from identify.model.cell import Cell, Wire
from identify.model.identifiability import structure
from identify.model.io.description import library, read_robot
from identify.model.joint_error_models import ERROR_MODELS
from identify.model.measurement import Rows, measurement_model, touch_conditions
from identify.report.svg import AFTER, BEFORE, Chart, axis, named, picture
from identify.uncertainty.promise import INTERVAL
from studies.engine import Table, column, distinct, where

TOUCHES, SIGMA, TRIALS = 300, 0.05, 100
CASES = {"nothing": (), **{name: (name,) for name in ERROR_MODELS}, "all": tuple(ERROR_MODELS)}


def tasks(small: bool) -> list[dict[str, Any]]:
    """Ten trials a task."""
    count = 1 if small else TRIALS // 10
    return [{"case": case, "part": part, "trials": 2 if small else 10} for case in CASES for part in range(count)]


@lru_cache(maxsize=1)
def linear() -> Linear:
    """Touches all over the reach of an arm, about its drawing."""
    rng = np.random.default_rng(1)
    nominal = np.array([200.0, -400, 0, 1.5, 0, 0]), np.array([0.0, 0, 250, 0, -0.5, 0])
    bare = Cell(read_robot(library("robots")["irb120"]), None, *nominal, wire=Wire(0.0, "point"))
    cell = with_errors(bare, tuple(ERROR_MODELS))
    names, robot = cell.robot.parameters, cell.robot
    q = rng.uniform(robot.lower, robot.upper, (TOUCHES, 6))
    zeros = np.zeros(TOUCHES)
    conditions = touch_conditions(q, q - rng.choice([-1.0, 1.0], q.shape), rng.uniform(-10, 10, TOUCHES))
    rows = Rows(q, np.eye(3)[np.arange(TOUCHES) % 3], zeros, zeros, zeros + SIGMA, (), np.arange(TOUCHES), conditions)
    J = measurement_model(robot).linearize(cell.theta, rows)[1]
    free = structure(bare).kept
    geometric = tuple(names.index(bare.robot.parameters[i]) for i in free)
    models = {m: tuple(names.index(p) for p, _, of in robot.error_parameters if of == m) for m in ERROR_MODELS}
    fold = regions(cell.kinematics.tip(q, cell.theta)[0], 5, rng)
    return Linear(J * cell.scale / SIGMA, zeros, np.ones(len(names)), geometric, models, fold)


def run(rng: np.random.Generator, case: str, part: int, trials: int) -> list[dict[str, Any]]:
    """One row a robot: what was chosen, and how many of its errors lie inside their intervals."""
    return [{"case": case, "trial": part * trials + k, **_trial(rng, CASES[case])} for k in range(trials)]


def _trial(rng: np.random.Generator, errors: tuple[str, ...]) -> dict[str, Any]:
    about = linear()
    truth = np.zeros(about.A.shape[1])
    truth[list(about.geometric)] = rng.standard_normal(len(about.geometric))
    for name in errors:
        index = list(about.models[name])
        size = rng.uniform(0.5, 1.5, len(index))
        truth[index] = size if name == "thermal" else size * rng.choice([-1.0, 1.0], len(index))
    y = about.A @ truth + rng.standard_normal(TOUCHES)
    problem = Linear(about.A, y, about.precision, about.geometric, about.models, about.fold)
    families = choose(problem, np.arange(TOUCHES), np.full(TOUCHES, SIGMA), tuple(ERROR_MODELS)).errors
    inside = _inside(problem, truth, families)
    right = set(families) == set(errors)
    return {"chosen": " ".join(families) or "nothing", "right": int(right), "inside": inside}


def _inside(problem: Linear, truth: Float[np.ndarray, " columns"], families: tuple[str, ...]) -> float:
    """Share of the errors of the chosen models that lie inside their 95 % intervals; 1 where there are none."""
    these, (G, b) = problem.columns(families), problem.whole
    C = np.linalg.inv(G[np.ix_(these, these)] + np.diag(problem.precision[these]))
    off = np.abs(C @ b[these] - truth[these]) / np.sqrt(np.diag(C))
    beyond = len(problem.geometric)
    return float((off[beyond:] < INTERVAL).mean()) if len(off) > beyond else 1.0


def answer(table: Table) -> str:
    """Shares of the trials by case."""
    right, inside = [], []
    for case in CASES:
        mine = [i for i, name in enumerate(table["case"]) if name == case]
        right.append(f"{case} {100 * np.mean([float(table['right'][i]) for i in mine]):.0f} %")
        if CASES[case]:
            inside.append(100 * float(np.mean([float(table["inside"][i]) for i in mine])))
    return (
        f"Exactly the true models chosen: {', '.join(right)}. Values inside their 95 % intervals: "
        f"{min(inside):.0f} to {max(inside):.0f} %."
    )


def pictures(table: Table) -> dict[str, str]:
    """Shares of trials with the right choice, and of values inside their intervals, by what the robot has."""
    cases = distinct(table, "case")
    share = {
        key: np.array([100 * np.nanmean(column(where(table, case=case), key)) for case in cases])
        for key in ("right", "inside")
    }
    chart = Chart(
        "Choice of joint errors: what is chosen is what the robot has, and its values are inside their intervals",
        named("what the simulated robot has", cases),
        axis("share of trials or values, %", [80.0, 100.0, *share["right"], *share["inside"]]),
        width=680,
        slanted=True,
    )
    for shift, key, shade in ((-0.12, "right", AFTER), (0.12, "inside", BEFORE)):
        chart.dots(np.arange(len(cases)) + shift, share[key], shade, [f"{s:.0f} %" for s in share[key]], 5)
    chart.level(95.0, "95 %")
    chart.legend([(AFTER, "trials with the right choice"), (BEFORE, "values inside their 95 % intervals")])
    return {"beyond": picture(chart)}
