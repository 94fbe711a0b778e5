"""From touches to parameters: elimination, Ipopt, outliers, uncertainty, and errors where the fit has not looked."""

from collections.abc import Iterator, Mapping

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.estimation.diagnosis import diagnose
from identify.estimation.folds import regions
from identify.estimation.problem import CalibrationFailed, Estimate, Problem, with_face_scatter
from identify.estimation.selection import select, with_errors
from identify.model.cell import Cell
from identify.model.io.calibration_file import Calibration, Residual, Term, fingerprints, summarize
from identify.model.measurement import Measured, Rows, rows

__all__ = ["CalibrationFailed", "calibrate"]


def calibrate(
    cell: Cell,
    *measured: Measured,
    loss: str = "huber",
    priors: bool = True,
    eliminate: bool = True,
    start: Float[np.ndarray, " parameters"] | None = None,
    folds: int = 5,
    choose: bool = False,
    rng: np.random.Generator | None = None,
    inputs: Mapping[str, str] | None = None,
) -> Calibration:
    """Identify the parameters that put every touch on its face.

    `loss` is a row of LOSSES; `priors` adds the cell's tolerances to the touches (maximum a posteriori); `folds`
    regions are held out in turn; `choose` adds the joint error models that the data ask for; `inputs` are the hashes of
    the files. Without `eliminate` all parameters are estimated, and the tolerances tell apart what touches cannot: what
    the drawing makes dependent, as parallel axes do, is no longer so on a robot as built, and far off its drawing that
    is worth a tenth of a millimetre. The search begins at `start`, or at the nominal robot. Raises InputError where the
    touches cannot determine the parameters, and CalibrationFailed where Ipopt does not converge.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    equations = with_face_scatter(cell, rows(cell.wire, measured, cell.robot.temperature))
    problem = Problem.pose(cell, equations, loss, priors, eliminate)
    choice: tuple[Term, ...] = ()
    if choose:
        selection = select(problem, rng)
        choice, cell = selection.terms, with_errors(cell, selection.errors)
        problem = Problem.pose(cell, problem.rows, loss, priors, eliminate)
        start = start if not selection.errors else None  # of another robot
    estimate = problem.estimate(start)
    problem.require_rank(estimate.x, estimate.weight, "at the solution")
    held_out = _held_out(problem, estimate, folds, rng)
    residual = problem.residual(estimate.x)
    scatter, significant = problem.scatter(estimate)
    unit = dict(zip(cell.robot.parameters, cell.robot.parameter_unit(), strict=True))
    return Calibration(
        cell=cell,
        theta=problem.theta(estimate.x),
        start=problem.start,
        estimated=tuple(problem.names),
        combinations={
            name: {kept: c * unit[name] / unit[kept] for kept, c in terms.items()}
            for name, terms in problem.structure.combinations.items()
        },
        covariance=problem.covariance(estimate.x, estimate.weight),
        scatter=scatter,
        scatter_significant=significant,
        weak=problem.weak(estimate.x, estimate.weight),
        outliers=_worst(problem.rows, residual, ~estimate.used),
        fit=summarize(problem.rows.take(estimate.used).distances(residual[estimate.used])),
        held_out=None if held_out is None else summarize(held_out),
        residuals=_residuals(problem, residual, estimate.used),
        fingerprints=frozenset(fingerprints(problem.rows.q, problem.rows.offset[:, None])),
        iterations=estimate.iterations,
        solve_s=estimate.seconds,
        choice=choice,
        findings=diagnose(problem, estimate, measured),
        inputs=dict(inputs or {}),
    )


def _worst(rows: Rows, residual: Float[np.ndarray, " rows"], these: Bool[np.ndarray, " rows"]) -> dict[str, float]:
    """The largest residual of each touch or position among some rows, by id."""
    order = np.argsort(np.abs(residual), kind="stable")  # the largest comes last, and stays
    order = order[these[order]]
    worst = np.full(len(rows.ids), -1)
    worst[rows.owner[order]] = order
    return {rows.ids[owner]: float(residual[worst[owner]]) for owner in np.flatnonzero(worst >= 0)}


def _residuals(
    problem: "Problem", after: Float[np.ndarray, " rows"], used: Bool[np.ndarray, " rows"]
) -> dict[str, Residual]:
    """What every touch said before and after, in the order of the rows."""
    rows, everywhere = problem.rows, np.ones(len(problem.rows), dtype=bool)
    was, now = (_worst(rows, r, everywhere) for r in (problem.before, after))
    kept = {rows.ids[owner] for owner in np.unique(rows.owner[used])}
    return {name: Residual(was[name], now[name], name in kept) for name in rows.ids}


def _held_out(
    problem: Problem, estimate: Estimate, folds: int, rng: np.random.Generator
) -> Float[np.ndarray, " measured"] | None:
    """Errors at touches of regions left out of the fit, each in its turn; None where none can be spared."""
    if folds < 2:
        return None
    tip = problem.cell.kinematics.tip(problem.rows.q, problem.theta(estimate.x))[0]
    found = [
        problem.rows.take(out).distances(problem.residual(x)[out])
        for out, x in _leave_out(problem, estimate, regions(tip, folds, rng))
    ]
    return np.concatenate(found) if found else None


def _leave_out(
    problem: Problem, estimate: Estimate, label: Int[np.ndarray, " rows"]
) -> Iterator[tuple[Bool[np.ndarray, " rows"], Float[np.ndarray, " kept"]]]:
    for region in np.unique(label):
        out = (label == region) & estimate.used
        weight = np.where(out, 0.0, estimate.weight)
        if out.any() and problem.determined(estimate.x, weight):
            yield out, problem.solve(estimate.x, weight, "linear").x
