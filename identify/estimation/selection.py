"""Which joint errors a robot has, as its touches tell: models that help in regions of space that the fit has not seen.

From the geometric robot to the richest, each step adds the model that helps most where touches were held out. Of all
steps the poorest is kept whose held-out errors are within one standard error of the best (Breiman et al. 1984); then a
model leaves again without which the touches are nearly as likely (evidence, MacKay 1992). Every fit is linear about the
geometric solution, with the priors of the cell: a whole choice takes less than one calibration.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.estimation.folds import regions
from identify.estimation.least_squares import LOSSES
from identify.estimation.problem import Problem
from identify.model.cell import Cell
from identify.model.errors import ERROR_MODELS
from identify.model.io.calibration_file import Term
from identify.model.measurement import Rows, measurement_model
from identify.model.robot import Robot

FOLDS = 5
BELIEVED = 2.0  # logarithm of the odds for a model: seven to one, no more than "positive" (Kass and Raftery 1995)
ROUNDS = 20  # of reweighing, to find touches that no model explains


@dataclass(frozen=True)
class Selection:
    """The chosen models, and what every model on the way buys."""

    errors: tuple[str, ...]
    terms: tuple[Term, ...]


@dataclass(frozen=True, eq=False)
class Linear:
    """Rows y = A x + noise of one standard deviation, x with priors of one, in units that make it so.

    Columns of the geometric robot come first; those of every error model are named.
    """

    A: Float[np.ndarray, "rows columns"]
    y: Float[np.ndarray, " rows"]
    precision: Float[np.ndarray, " columns"]  # 1, or 0 where nothing is known before
    geometric: tuple[int, ...]
    models: dict[str, tuple[int, ...]]
    fold: Int[np.ndarray, " rows"]

    def columns(self, errors: Sequence[str]) -> list[int]:
        """The columns of a robot with these error models."""
        return [*self.geometric, *(i for name in errors for i in self.models[name])]

    @cached_property
    def parts(self) -> list[tuple[Bool[np.ndarray, " rows"], np.ndarray, np.ndarray]]:
        """Rows of each fold, and their normal equations."""
        found = [self.fold == k for k in np.unique(self.fold)]
        return [(out, self.A[out].T @ self.A[out], self.A[out].T @ self.y[out]) for out in found]

    @cached_property
    def whole(self) -> tuple[np.ndarray, np.ndarray]:
        """Normal equations of all rows."""
        return sum(G for _, G, _ in self.parts), sum(b for _, _, b in self.parts)  # type: ignore[return-value]

    def solve(self, G: np.ndarray, b: np.ndarray, these: list[int]) -> Float[np.ndarray, " these"]:
        """Most probable parameters by normal equations."""
        H = G[np.ix_(these, these)] + np.diag(self.precision[these])
        return np.asarray(np.linalg.solve(H, b[these]))

    def held_out(self, errors: Sequence[str]) -> Float[np.ndarray, " rows"]:
        """Errors at the rows of each fold by the fit to the others."""
        these, (G, b), found = self.columns(errors), self.whole, np.empty(len(self.y))
        for out, own, right in self.parts:
            found[out] = self.y[out] - self.A[out][:, these] @ self.solve(G - own, b - right, these)
        return found

    def shows(self, name: str) -> bool:
        """Whether a model changes anything at these rows: without temperatures, no link grows."""
        return bool(self.A[:, list(self.models[name])].any())

    def evidence(self, errors: Sequence[str]) -> float:
        """Logarithm of the probability of the rows, whatever the parameters, but for a constant."""
        these, (G, b) = self.columns(errors), self.whole
        L = np.linalg.cholesky(G[np.ix_(these, these)] + np.diag(self.precision[these]))
        z = np.linalg.solve(L, b[these])
        known = self.precision[these] > 0
        return float(0.5 * z @ z - np.log(np.diag(L)).sum() + 0.5 * np.log(self.precision[these][known]).sum())


def select(problem: Problem, rng: np.random.Generator, folds: int = FOLDS) -> Selection:
    """Choose the error models of a robot by a problem posed for its geometry; those it has already stay."""
    start = problem.estimate()
    robot, rows = problem.cell.robot, problem.rows
    linear, unit = _linear(problem, start.x, rng, folds)
    used = unit > 0
    offered = [name for name in ERROR_MODELS if name not in robot.errors and linear.shows(name)]
    return choose(linear, rows.owner[used], 1 / unit[used], offered)


def choose(
    linear: Linear, owner: Int[np.ndarray, " rows"], mm: Float[np.ndarray, " rows"], offered: Sequence[str]
) -> Selection:
    """Choose among the models of a linear problem; `owner` says which rows are one measurement, `mm` what one is."""
    path, errors = _path(linear, owner, list(offered))
    errors_mm = {names: _distances(owner, linear.held_out(names) * mm) for names in path}
    best = int(np.argmin([e.mean() for e in errors]))
    kept = next(i for i in range(best + 1) if _within(errors[i] - errors[best]))
    chosen = _likely(linear, path[kept])
    terms = tuple(_term(after[-1], errors_mm[before], errors_mm[after], chosen) for before, after in pairwise(path))
    return Selection(tuple(name for name in ERROR_MODELS if name in chosen), terms)


def _term(name: str, before: np.ndarray, after: np.ndarray, chosen: Sequence[str]) -> Term:
    gain = before - after
    return Term(name, float(after.mean()), float(gain.mean()), _standard_error(gain), name in chosen)


def _standard_error(sample: Float[np.ndarray, " measured"]) -> float:
    return float(sample.std(ddof=1) / np.sqrt(len(sample)))


def _path(
    linear: Linear, owner: np.ndarray, offered: list[str]
) -> tuple[list[tuple[str, ...]], list[Float[np.ndarray, " measured"]]]:
    """From no model to all, each time the one that helps most; squared errors held out, one a measurement."""
    path: list[tuple[str, ...]] = [()]
    errors = [_distances(owner, linear.held_out(())) ** 2]
    while len(path[-1]) < len(offered):
        left = [(*path[-1], name) for name in offered if name not in path[-1]]
        tried = [_distances(owner, linear.held_out(names)) ** 2 for names in left]
        least = int(np.argmin([e.mean() for e in tried]))
        path.append(left[least])
        errors.append(tried[least])
    return path, errors


def _within(excess: Float[np.ndarray, " measured"]) -> bool:
    """Whether a mean excess is within one standard error of itself."""
    return bool(excess.mean() <= _standard_error(excess))


def _likely(linear: Linear, names: Sequence[str]) -> tuple[str, ...]:
    """The models without those that chance explains nearly as well."""
    kept = tuple(names)
    while kept:
        without = {name: linear.evidence([k for k in kept if k != name]) for name in kept}
        least = max(without, key=lambda name: without[name])
        if without[least] < linear.evidence(kept) - BELIEVED:
            break
        kept = tuple(name for name in kept if name != least)
    return kept


def _distances(owner: np.ndarray, residual: np.ndarray) -> Float[np.ndarray, " measured"]:
    _, place = np.unique(owner, return_inverse=True)
    return np.asarray(np.sqrt(np.bincount(place, residual**2)))


def _linear(
    problem: Problem, x: Float[np.ndarray, " kept"], rng: np.random.Generator, folds: int
) -> tuple[Linear, Float[np.ndarray, " rows"]]:
    """All models about the geometric solution, in rows that some model explains; and one over the unit of all rows."""
    cell = with_errors(problem.cell, tuple(ERROR_MODELS))
    robot, rows, bare = cell.robot, problem.rows, problem.cell.robot
    theta = cell.theta.copy()
    place = np.array([robot.parameters.index(name) for name in bare.parameters])
    theta[place] = problem.theta(x)
    r, J = measurement_model(robot).linearize(theta, rows)
    A = J * cell.scale
    kept = place[problem.kept]
    models = {name: tuple(robot.parameters.index(p) for p, _, m in robot.error_parameters if m == name)
              for name in ERROR_MODELS}  # fmt: skip
    y = -r + A[:, kept] @ (x / cell.scale[kept])
    precision = np.ones(len(theta))
    precision[kept] = (cell.scale[kept] / problem.prior) ** 2
    every = sorted({*kept.tolist(), *(i for m in models.values() for i in m)})
    unit = _unit(A[:, every], y, precision[every], 1 / rows.sigma, rows)
    used = unit > 0
    tip = cell.kinematics.tip(rows.q, theta)[0]
    fold = regions(tip[used], folds, rng)
    geometric = [*kept.tolist(), *(i for name in bare.errors for i in models[name] if i not in kept)]
    weighted = A[used] * unit[used, None]
    return Linear(weighted, y[used] * unit[used], precision, tuple(geometric), models, fold), unit


def with_errors(cell: Cell, errors: Sequence[str]) -> Cell:
    """The cell with these error models and those that its robot has already."""
    names = tuple(name for name in ERROR_MODELS if name in {*errors, *cell.robot.errors})
    return cell if names == cell.robot.errors else replace(cell, robot=_robot(cell.robot, names))


@lru_cache(maxsize=64)
def _robot(robot: Robot, errors: tuple[str, ...]) -> Robot:
    """One object for all who ask, so that its functions are compiled once."""
    return replace(robot, errors=errors, error_values=())


def _unit(
    A: np.ndarray, y: np.ndarray, precision: np.ndarray, weight: np.ndarray, rows: Rows
) -> Float[np.ndarray, " rows"]:
    """One over the scatter of each row as the richest model leaves it [1/mm]; 0 where no model explains a touch."""
    scale, slope = 1.0, np.ones(len(y))
    for _ in range(ROUNDS):
        w = weight * np.sqrt(slope) / scale
        H = (A * w[:, None]).T @ (A * w[:, None]) + np.diag(precision)
        r = y - A @ np.linalg.solve(H, (A * w[:, None]).T @ (y * w))
        determined = len(H) - float(np.diag(np.linalg.inv(H)) @ precision)
        freedom = max(len(y) - determined, 1.0)
        before = scale
        scale = max(1.0, 1.4826 * float(np.median(np.abs(r * weight))) * np.sqrt(len(y) / freedom))
        slope = LOSSES["huber"]((r * weight / scale) ** 2)[1]
        if abs(scale - before) < 1e-4 * scale:
            break
    good = np.abs(r * weight) < 5 * scale
    worst = np.ones(len(rows.ids), dtype=bool)
    np.logical_and.at(worst, rows.owner, good)
    return np.where(worst[rows.owner], weight / scale, 0.0)
