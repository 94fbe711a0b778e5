"""Which joint errors a robot has, as its touches tell: models that help in regions of space that the fit has not seen.

From the geometric robot to the richest, each step adds the model that helps most where touches were held out. Of all
steps the poorest is kept whose held-out errors are within one standard error of the best (Breiman et al. 1984); then a
model leaves without which the touches are nearly as likely (evidence, MacKay 1992). Every fit is linear, with priors.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.estimation.folds import regions
from identify.estimation.least_squares import LOSSES
from identify.estimation.problem import PART, Problem
from identify.estimation.robust import estimate
from identify.model.cell import Cell
from identify.model.files import InputError, nearest
from identify.model.io.calibration_file import Term
from identify.model.joint_error_models import ERROR_MODELS
from identify.model.measurement import Rows
from identify.model.robot import Robot
from identify.uncertainty.unknowns import Unknowns

FOLDS = 5
BELIEVED = 2.0  # logarithm of the odds for a model: seven to one, no more than "positive" (Kass and Raftery 1995)
FREE = 10.0  # prior deviation of an unknown without a prior, in its scale
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
        folds = [self.fold == k for k in np.unique(self.fold)]
        return [(out, self.A[out].T @ self.A[out], self.A[out].T @ self.y[out]) for out in folds]

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
        these, (G, b), predictions = self.columns(errors), self.whole, np.empty(len(self.y))
        for out, own, right in self.parts:
            predictions[out] = self.y[out] - self.A[out][:, these] @ self.solve(G - own, b - right, these)
        return predictions

    def shows(self, name: str) -> bool:
        """Whether a model changes anything at these rows: without temperatures, no link grows."""
        return bool(self.A[:, list(self.models[name])].any())

    def evidence(self, errors: Sequence[str]) -> float:
        """Logarithm of the probability of the rows, whatever the parameters, but for a constant."""
        these, (G, b) = self.columns(errors), self.whole
        L = np.linalg.cholesky(G[np.ix_(these, these)] + np.diag(self.precision[these]))
        z = np.linalg.solve(L, b[these])
        finite = self.precision[these] > 0
        return float(0.5 * z @ z - np.log(np.diag(L)).sum() + 0.5 * np.log(self.precision[these][finite]).sum())


def select(problem: Problem, rng: np.random.Generator, folds: int = FOLDS) -> Selection:
    """Choose the error models of a robot by a problem posed for its geometry; those it has already stay."""
    extended = extend(problem, estimate(problem).x, tuple(ERROR_MODELS))
    return extended.selection(extended.unit(), rng, folds)


def choose(
    linear: Linear, owner: Int[np.ndarray, " rows"], mm: Float[np.ndarray, " rows"], models: Sequence[str]
) -> Selection:
    """Choose among the models of a linear problem; `owner` says which rows are one measurement, `mm` what one is."""
    path, errors = _path(linear, owner, list(models))
    errors_mm = {names: _distances(owner, linear.held_out(names) * mm) for names in path}
    best = int(np.argmin([e.mean() for e in errors]))
    place = next(i for i in range(best + 1) if _within(errors[i] - errors[best]))
    likely = _likely(linear, path[place])
    terms = tuple(_term(after[-1], errors_mm[before], errors_mm[after], likely) for before, after in pairwise(path))
    return Selection(tuple(name for name in ERROR_MODELS if name in likely), terms)


def _term(name: str, before: np.ndarray, after: np.ndarray, names: Sequence[str]) -> Term:
    gain = before - after
    return Term(name, float(after.mean()), float(gain.mean()), _standard_error(gain), name in names)


def _standard_error(sample: Float[np.ndarray, " measured"]) -> float:
    return float(sample.std(ddof=1) / np.sqrt(len(sample)))


def _path(
    linear: Linear, owner: np.ndarray, models: list[str]
) -> tuple[list[tuple[str, ...]], list[Float[np.ndarray, " measured"]]]:
    """From no model to all, each time the one that helps most; squared errors held out, one a measurement."""
    path: list[tuple[str, ...]] = [()]
    errors = [_distances(owner, linear.held_out(())) ** 2]
    while len(path[-1]) < len(models):
        longer = [(*path[-1], name) for name in models if name not in path[-1]]
        tried = [_distances(owner, linear.held_out(names)) ** 2 for names in longer]
        least = int(np.argmin([e.mean() for e in tried]))
        path.append(longer[least])
        errors.append(tried[least])
    return path, errors


def _within(excess: Float[np.ndarray, " measured"]) -> bool:
    """Whether a mean excess is within one standard error of itself."""
    return bool(excess.mean() <= _standard_error(excess))


def _likely(linear: Linear, names: Sequence[str]) -> tuple[str, ...]:
    """The models without those that chance explains nearly as well."""
    models = tuple(names)
    while models:
        without = {name: linear.evidence([k for k in models if k != name]) for name in models}
        least = max(without, key=lambda name: without[name])
        if without[least] < linear.evidence(models) - BELIEVED:
            break
        models = tuple(name for name in models if name != least)
    return models


def _distances(owner: np.ndarray, residual: np.ndarray) -> Float[np.ndarray, " measured"]:
    _, place = np.unique(owner, return_inverse=True)
    return np.asarray(np.sqrt(np.bincount(place, residual**2)))


@dataclass(frozen=True, eq=False)
class Extended:
    """A problem about a solution, linear, with the joint errors of more models: y = A x, in units of sigma.

    Unknowns without a prior are counted from the solution, all others from the drawing.
    """

    unknowns: Unknowns
    at: Float[np.ndarray, " unknowns"]  # where the rows are taken, in units of the priors
    precision: Float[np.ndarray, " unknowns"]  # of the priors
    rows: Rows
    A: Float[np.ndarray, "rows unknowns"]
    y: Float[np.ndarray, " rows"]
    bare: Cell
    allowed: Float[np.ndarray, "unknowns unknowns"] | None = None  # projection without choices of frame; None: no such

    def columns(self) -> tuple[tuple[int, ...], dict[str, tuple[int, ...]]]:
        """Columns of the robot as it was and of what measurements share, and those of each further error model."""
        further = {
            name: model
            for name, _, model in self.unknowns.cell.robot.error_parameters
            if model not in self.bare.robot.errors
        }
        names = self.unknowns.names
        own = tuple(i for i, name in enumerate(names) if name not in further)
        return own, {
            model: tuple(i for i, name in enumerate(names) if further.get(name) == model)
            for model in dict.fromkeys(further.values())
        }

    @property
    def held(self) -> Float[np.ndarray, " unknowns"]:
        """Precision of the priors; that of unknowns without one is so small that it holds only what nothing shows."""
        return np.where(self.precision > 0, self.precision, FREE**-2)

    def unit(self, inliers: Bool[np.ndarray, " rows"] | None = None) -> Float[np.ndarray, " rows"]:
        """One over the scatter of each row as the richest model leaves it, in units of sigma; 0 for outliers.

        With `used` the model is fitted to these rows, and the others are judged by it.
        """
        inliers = np.ones(len(self.y), dtype=bool) if inliers is None else inliers
        return _unit(self.A, self.y, self.held, inliers.astype(float), self.rows)

    def selection(self, unit: Float[np.ndarray, " rows"], rng: np.random.Generator, folds: int = FOLDS) -> Selection:
        """The error models that help in regions held out, and what each buys."""
        inliers, (own, models) = unit > 0, self.columns()
        tip = self.unknowns.cell.kinematics.tip(self.rows.q[inliers], self.unknowns.theta(self.at))[0]
        A, y = self.A[inliers] * unit[inliers, None], self.y[inliers] * unit[inliers]
        linear = Linear(A, y, self.held, own, models, regions(tip, folds, rng))
        candidates = [name for name in models if linear.shows(name)]
        return choose(linear, self.rows.owner[inliers], self.rows.sigma[inliers] / unit[inliers], candidates)


def extend(problem: Problem, x: Float[np.ndarray, " size"], errors: Sequence[str]) -> Extended:
    """A problem about the coordinates of a solution, with the unknowns of further error models beside its own."""
    cell = with_errors(problem.cell, errors)
    before = dict(zip(problem.unknowns.names, problem.unknown(x), strict=True))
    names = {*before, *(name for name, _, _ in cell.robot.error_parameters)} - problem.cell.fixed
    some = [i for i, name in enumerate(cell.robot.parameters) if name in names]
    unknowns = replace(problem.unknowns, cell=cell, parameters=np.array(some))
    at = np.array([before.get(name, 0.0) for name in unknowns.names])
    beyond = {name for name, _, _ in cell.robot.error_parameters}
    mask = np.array([problem.priors or name in beyond for name in unknowns.names])
    none = np.empty(0)
    allowed = _allowed(problem, unknowns) if unknowns.named else None
    start = Extended(unknowns, at, unknowns.precision * mask, problem.rows, none[:, None], none, problem.cell, allowed)
    return relinearized(start, at)


def _allowed(problem: Problem, unknowns: Unknowns) -> Float[np.ndarray, "unknowns unknowns"]:
    """The projection of unknowns without a prior on the directions that a problem has for them."""
    loose = problem.unknowns.precision == 0
    B = problem.basis[loose][:, np.isinf(problem.prior)]
    P, place = np.eye(len(unknowns)), np.flatnonzero(unknowns.precision == 0)
    P[np.ix_(place, place)] = B @ B.T
    return P


def relinearized(extended: Extended, at: Float[np.ndarray, " unknowns"]) -> Extended:
    """The same problem with its rows taken at other unknowns."""
    unknowns, rows, precision = extended.unknowns, extended.rows, extended.precision
    parts = [slice(k, k + PART) for k in range(0, len(rows), PART)]
    blocks = [unknowns.linearize(at, rows.take(np.arange(len(rows))[part])) for part in parts]
    r, A = np.concatenate([r for r, _ in blocks]) / rows.sigma, np.concatenate([J for _, J in blocks])
    A /= rows.sigma[:, None]
    if extended.allowed is not None:
        A = A @ extended.allowed
    return replace(extended, at=at, A=A, y=A @ (at * precision) - r)


def cell_with_errors(cell: Cell, errors: str) -> Cell:
    """The cell with the error models that `calibrate` is asked for; raises InputError if there is no such model."""
    if errors in {"cell", "auto"}:
        return cell
    names = () if errors == "none" else tuple(name.strip() for name in errors.split(","))
    for name in names:
        if name not in ERROR_MODELS:
            words = ("auto", "none", "cell", *ERROR_MODELS)
            raise InputError(f"no error model '{name}'{nearest(name, words)}; choose of {', '.join(words)}")
    return cell if names == cell.robot.errors else replace(cell, robot=_robot(cell.robot, names))


def with_errors(cell: Cell, errors: Sequence[str]) -> Cell:
    """The cell with these error models and those that its robot has already."""
    names = tuple(name for name in ERROR_MODELS if name in {*errors, *cell.robot.errors})
    return cell if names == cell.robot.errors else replace(cell, robot=_robot(cell.robot, names))


@lru_cache(maxsize=64)
def _robot(robot: Robot, errors: tuple[str, ...]) -> Robot:
    """One object for all who ask, so that its functions are compiled once."""
    return robot.with_errors(errors)


def _unit(
    A: np.ndarray, y: np.ndarray, precision: np.ndarray, weight: np.ndarray, rows: Rows
) -> Float[np.ndarray, " rows"]:
    """One over the scatter of each row as the richest model leaves it [1/sigma]; 0 where no model explains a touch.

    Rows of weight 0 are judged by the fit to the others.
    """
    scale, slope = 1.0, np.ones(len(y))
    for _ in range(ROUNDS):
        w = weight * np.sqrt(slope) / scale
        H = (A * w[:, None]).T @ (A * w[:, None]) + np.diag(precision)
        r = y - A @ np.linalg.solve(H, (A * w[:, None]).T @ (y * w))
        determined = len(H) - float(np.diag(np.linalg.inv(H)) @ precision)
        freedom = max(np.count_nonzero(weight) - determined, 1.0)
        before = scale
        median = float(np.median(np.abs(r[weight > 0])))
        scale = max(1.0, 1.4826 * median * np.sqrt(np.count_nonzero(weight) / freedom))
        slope = LOSSES["huber"]((r / scale) ** 2)[1]
        if abs(scale - before) < 1e-4 * scale:
            break
    good = np.abs(r) < 5 * scale
    worst = np.ones(len(rows.ids), dtype=bool)
    np.logical_and.at(worst, rows.owner, good)
    return np.where(worst[rows.owner], 1 / scale, 0.0)
