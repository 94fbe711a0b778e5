"""The estimate with all joint errors at once: linear algebra about one nonlinear fit of the geometry."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.estimation.discrepancy import ENOUGH, ERROR, GEOMETRY, LOOSE, Linear, Models, Posterior, average, folds
from identify.estimation.problem import CalibrationFailed, Problem
from identify.estimation.robust import Estimate, limit
from identify.estimation.selection import FREE, Extended, Selection, extend, relinearized
from identify.model.cell import Cell
from identify.model.joint_error_models import ERROR_MODELS, WARMTH
from identify.model.measurement import Rows

LEAST = 0.5  # share of the rows that has to agree
ROUNDS = 3  # of measurements that join, or are left out
HALVINGS = 6  # of a step
UNNOTICED = 0.5  # of a chi-square, by which it may be larger after a step than foreseen
DEVIATING = 0.1  # share of what a step gains, by which too


@dataclass(frozen=True, eq=False)
class JointErrors:
    """A robot with all joint errors that its measurements can show, averaged over models of their sizes."""

    extended: Extended  # about the estimate
    models: Models
    posterior: Posterior
    used: Bool[np.ndarray, " rows"]
    selection: Selection

    @property
    def unknown(self) -> Float[np.ndarray, " unknowns"]:
        """All unknowns, in units of their priors."""
        return self.extended.at

    @property
    def linear(self) -> Linear:
        """The linear problem of all rows."""
        return whitened(self.extended)

    def without(self, out: Bool[np.ndarray, " rows"]) -> Float[np.ndarray, " out"]:
        """Residuals [mm] of some rows by the estimate from the other rows in use."""
        linear = self.linear
        mean = self.models.posterior(linear.take(self.used & ~out)).mean
        return -(linear.y[out] - linear.A[out] @ mean) * self.extended.rows.sigma[out]

    def problem(self, problem: Problem) -> tuple[Problem, Estimate]:
        """The problem of all these unknowns and its estimate, with priors as wide as the models have them."""
        extended = self.extended
        unknowns, held, x = extended.unknowns, extended.precision, self.unknown
        origin, basis = x * (1 - held), np.eye(len(unknowns))
        factor = np.array([FREE, self.models.geometry, self.models.errors])[_kinds(extended)]
        full = Problem(unknowns.cell, extended.rows, unknowns, origin, basis, None, True, problem.loss, factor)
        noise = self.posterior.noise
        weight = self.used / (extended.rows.sigma * noise)
        return full, Estimate(x * held, self.used, weight, noise, 0, 0.0)


def with_joint_errors(problem: Problem, fit: Estimate, rng: np.random.Generator) -> JointErrors:
    """The estimate of a problem with the unknowns of all error models that its measurements can show.

    The sizes of the errors are chosen and averaged by `discrepancy.average`. Measurements that the geometry alone does
    not explain join those in use as far as they agree with them.
    """
    extended = extend(problem, fit.x, shown(problem.cell, problem.rows))
    counted = problem.rows.counted
    unit = extended.unit(fit.used)  # fitted to all rows, so many joint errors bend to gross ones
    used = (unit > 0) & counted if problem.loss != "linear" else counted
    _require_agreement(used[counted])
    selection = extended.selection(np.where(used, np.maximum(unit, 1e-9), 0.0), rng)
    tip = problem.cell.kinematics.tip(problem.rows.q, problem.theta(fit.x))[0]
    for _ in range(ROUNDS):
        models = _models(extended, used, tip, rng)
        near = _stepped(extended, models, used)
        posterior = models.posterior(whitened(near).take(used))
        agreeing = counted & _agreeing(near, posterior, used) if problem.loss != "linear" else used
        if np.array_equal(agreeing, used):
            break
        used = agreeing
        _require_agreement(used[counted])
    extended = _stepped(near, models, used)
    return JointErrors(extended, models, models.posterior(whitened(extended).take(used)), used, selection)


def _require_agreement(used: Bool[np.ndarray, " rows"]) -> None:
    """Raise CalibrationFailed if most of the rows contradict each other."""
    if used.mean() < LEAST:
        raise CalibrationFailed(
            f"no robot near the drawing explains more than {100 * used.mean():.0f} % of the measurements; no "
            "parameters given. Check the sign and the zero of every joint, the units of every column, the names of "
            "the faces, and that a file holds one target"
        )


def shown(cell: Cell, rows: Rows) -> tuple[str, ...]:
    """Error models that measurements can show: without a temperature, no link grows."""
    warm = rows.conditions is not None and bool(np.ptp(rows.conditions[:, WARMTH]) > 0)
    return tuple(name for name in ERROR_MODELS if name != "thermal" or warm or name in cell.robot.errors)


def _models(
    extended: Extended, used: Bool[np.ndarray, " rows"], tip: Float[np.ndarray, "rows 3"], rng: np.random.Generator
) -> Models:
    """Models of the sizes of errors by the rows in use, or by some of them if there are very many."""
    rows = np.flatnonzero(used)
    if len(rows) > ENOUGH:
        owners = np.unique(extended.rows.owner[rows])
        picked = rng.choice(owners, min(len(owners), ENOUGH // 2), replace=False)
        rows = rows[np.isin(extended.rows.owner[rows], picked)]
    _, first, owner = np.unique(extended.rows.owner[rows], return_index=True, return_inverse=True)
    return average(whitened(extended).take(rows), folds(extended.rows.q[rows][first], tip[rows][first], owner))


def whitened(extended: Extended) -> Linear:
    """The linear problem of all rows, in units of the stated sigma and of the priors."""
    return Linear(extended.A, extended.y, _kinds(extended))


def _kinds(extended: Extended) -> Int[np.ndarray, " unknowns"]:
    errors = {name for name, _, _ in extended.unknowns.cell.robot.error_parameters}
    kinds = [ERROR if name in errors else GEOMETRY for name in extended.unknowns.names]
    return np.where(extended.precision > 0, kinds, LOOSE)


def _stepped(extended: Extended, models: Models, used: Bool[np.ndarray, " rows"]) -> Extended:
    """The problem about the posterior mean: a Gauss-Newton step, halved until residuals are those it predicts.

    Joint 6 and the tool share directions that rows hardly show. A whole step along one of them, for which rows in first
    order ask nothing, would leave residuals of tenths of a millimetre in second order.
    """
    linear, held = whitened(extended), extended.at * extended.precision
    way = models.posterior(linear.take(used)).mean - held
    before = _squares(linear, held, used)
    for share in 0.5 ** np.arange(HALVINGS):
        foreseen, near = _squares(linear, held + share * way, used), relinearized(extended, extended.at + share * way)
        excess = _squares(whitened(near), near.at * near.precision, used) - foreseen
        if excess <= UNNOTICED * models.noise**2 + DEVIATING * max(before - foreseen, 0.0):
            return near
    return extended


def _squares(linear: Linear, x: Float[np.ndarray, " unknowns"], used: Bool[np.ndarray, " rows"]) -> float:
    """Sum of squared residuals, in units of the stated sigma."""
    return float((((linear.y - linear.A @ x)[used]) ** 2).sum())


def _agreeing(extended: Extended, posterior: Posterior, used: Bool[np.ndarray, " rows"]) -> Bool[np.ndarray, " rows"]:
    """Rows of measurements that are as near to the prediction as chance allows, leverage considered."""
    linear = whitened(extended)
    r = linear.y - linear.A @ posterior.mean
    own = ((linear.A @ posterior.covariance) * linear.A).sum(axis=1)
    noise = posterior.noise**2
    # the spread between models widens `own` beyond the leverage of a row
    variance = np.where(used, np.maximum(noise - own, 0.5 * noise), noise + own)
    size = np.zeros(len(extended.rows.ids))
    np.maximum.at(size, extended.rows.owner, np.abs(r) / np.sqrt(variance))
    return (size <= limit(len(r)))[extended.rows.owner]
