"""Ours, and SciPy's solver with our equations and derivatives, to tell what is the solver's and what the model's."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.optimize import least_squares

from identify.estimation.calibrate import calibrate
from identify.estimation.problem import Problem as FitProblem
from identify.model.cell import Cell, Wire
from identify.model.io.description import library, read_cell, read_robot
from identify.model.measurement import measurement_model, rows
from identify.model.touch import HIT, Positions, Touches
from oed.design.exact import exact_design
from studies.many import ManyTouches, calibrate_many

Problem = dict[str, np.ndarray]
MANY = 200  # robots of a batch


def cell_of(problem: Problem) -> Cell:
    """The cell of a problem."""
    return _cell(bool(np.isinf(problem["prior"][0])), "normal" in problem)


@lru_cache
def _cell(anywhere: bool, touched: bool) -> Cell:
    """The cell, read once: with base and tool that may stand `anywhere`, or the paper's, its wire if it touched."""
    if anywhere:
        return Cell(read_robot(library("robots")["irb120"]), None, base=None, tool=None, wire=Wire(0.0, "point"))
    cell = read_cell(library("cells")["arc-welder"])
    return cell if touched else replace(cell, wire=Wire(0.0, "point"))


def measured(problem: Problem) -> Touches | Positions:
    """The measurements of a problem."""
    m = len(problem["q"])
    ids, blank, sigma = tuple(map(str, range(m))), ("",) * m, np.full(m, float(problem["sigma"]))
    if "normal" not in problem:
        return Positions(ids, problem["q"], problem["point"], sigma)
    return Touches(
        ids,
        blank,
        problem["q"],
        problem["normal"],
        problem["offset"],
        sigma,
        (HIT,) * m,
        np.full(m, np.nan),
        blank,
        blank,
    )


def full(problem: Problem) -> Problem:
    """A calibration with everything that the file of one holds, but for regions held out."""
    cell = cell_of(problem)
    calibration = calibrate(
        cell, measured(problem), folds=0, parameters="identifiable" if cell.base is None else "all", errors="cell"
    )
    return {"tip": cell.kinematics.tip(problem["q_unseen"], calibration.theta)[0]}


def alone(problem: Problem) -> Problem:
    """One least-squares fit and nothing else: what the others do."""
    cell = cell_of(problem)
    fit = FitProblem.pose(cell, rows(cell.wire, [measured(problem)]), "linear", True, cell.base is None)
    solution = fit.solve(np.zeros(fit.size), 1 / fit.rows.sigma, "linear")
    return {"tip": cell.kinematics.tip(problem["q_unseen"], fit.theta(solution.x))[0]}


def many(problem: Problem) -> Problem:
    """The same robot many times in a batch, as studies do it; the time is that of all."""
    cell = cell_of(problem)
    q = np.tile(problem["q"], (MANY, 1, 1))
    touches = ManyTouches(
        q,
        np.ones(q.shape[:2], dtype=bool),
        problem["normal"],
        problem["offset"],
        np.full(q.shape[1], float(problem["sigma"])),
    )
    fits = calibrate_many(cell, touches, eliminate=False)
    tip = cell.kinematics.tip(problem["q_unseen"], fits.theta[0])[0]
    return {"tip": tip, "share": np.array(1 / MANY)}


def scipy(problem: Problem) -> Problem:
    """least_squares with our compiled residual and Jacobian."""
    cell = cell_of(problem)
    model, equations, start = measurement_model(cell.robot), rows(cell.wire, [measured(problem)]), cell.theta
    proper = np.isfinite(problem["prior"])
    start = np.concatenate([problem["base"], start[6:-6], problem["tool"]])
    prior = (np.eye(len(start)) / np.where(proper, problem["prior"], 1.0)[:, None])[proper]
    memory: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def both(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if p.tobytes() not in memory:
            memory.clear()
            r, J = model.linearize(p, equations)
            sigma = equations.sigma
            memory[p.tobytes()] = (
                np.concatenate([r / sigma, prior @ (p - start)]),
                np.vstack([J / sigma[:, None], prior]),
            )
        return memory[p.tobytes()]

    def residual(p: np.ndarray) -> np.ndarray:
        return both(p)[0]

    def jacobian(p: np.ndarray) -> np.ndarray:
        return both(p)[1]

    solution = least_squares(residual, start, jac=jacobian, method="trf", x_scale=problem["scale"])
    return {"tip": cell.kinematics.tip(problem["q_unseen"], solution.x)[0]}


def exact(searches: int | None) -> Callable[[Problem], Problem]:
    """The touches of an exact design, and the weights of the relaxation that bounds it."""

    def solve(problem: Problem) -> Problem:
        rng = np.random.default_rng(0)
        design = exact_design(problem["rows"], int(problem["n"]), rng=rng, iterations=searches)
        return {"indices": design.indices, "weights": design.relaxation.weights}

    return solve


METHODS = {
    "touchcal calibrate": full,
    "touchcal one fit": alone,
    "touchcal batch": many,
    "SciPy our Jacobian": scipy,
    "touchcal exact_design": exact(None),
    "touchcal 480 searches": exact(480),
}
