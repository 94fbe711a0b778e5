"""From touches to parameters: elimination, Ipopt, outliers, uncertainty, and errors where the fit has not looked."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from threadpoolctl import threadpool_limits

from identify.estimation.all_joint_errors import JointErrors, with_joint_errors
from identify.estimation.changes import Change, with_changes
from identify.estimation.diagnosis import diagnose, place_findings
from identify.estimation.edges import without_doubtful
from identify.estimation.faces import with_jig_as_it_is
from identify.estimation.folds import regions
from identify.estimation.gauge import gauge_words, require_scale
from identify.estimation.problem import CalibrationFailed, Problem
from identify.estimation.robust import Estimate, estimate, scatter
from identify.estimation.selection import cell_with_errors, select, with_errors
from identify.estimation.starts import Label, labels, on_faces, survivor
from identify.model.calibration import (
    Calibration,
    Discrepancy,
    Finding,
    Residual,
    SharedValue,
    Term,
    coordinates,
    fingerprints,
    summarize,
)
from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.measurement import Measurements, Rows, equations
from identify.uncertainty.unknowns import Unknowns

__all__ = ["CalibrationFailed", "calibrate"]


def calibrate(
    cell: Cell,
    *tables: Measurements,
    loss: str = "huber",
    priors: bool = True,
    parameters: Literal["all", "identifiable"] = "all",
    errors: str = "auto",
    start: Float[np.ndarray, " parameters"] | None = None,
    folds: int = 5,
    rng: np.random.Generator | None = None,
    inputs: Mapping[str, str] | None = None,
) -> Calibration:
    """Identify the unknowns that put every touch on its face.

    By default all parameters and what measurements share are estimated, held by the cell's tolerances (maximum a
    posteriori), and all families of joint errors with them, averaged over the sizes of their priors: `errors` is
    "auto", as on the command line, or "cell" for those of the cell, "none", or names of ERROR_MODELS with commas.
    `identifiable` drops, as the paper does, the parameters that the drawing makes dependent: far off the drawing that
    costs a tenth of a millimetre. `loss` is a row of LOSSES; without `priors` the
    touches alone decide; `folds` regions are held out in turn; `inputs` are the hashes of the files. The search begins
    at `start`, or at the nominal robot. Raises InputError if the touches cannot determine the parameters, and
    CalibrationFailed if Ipopt does not converge.
    """
    if not tables or any(isinstance(table, list | tuple) for table in tables):
        raise TypeError("calibrate takes measurements table by table: calibrate(cell, *read_measurements(path, cell))")
    tables = tuple(table.measured() for table in tables)
    with threadpool_limits(1):  # several threads spin more than they compute on matrices of 200 columns
        rng, cell = np.random.default_rng(0) if rng is None else rng, cell_with_errors(cell, errors)
        whole = _equations(cell, tables)
        problem = Problem.pose(cell, whole, loss, priors, parameters == "identifiable")
        choice: tuple[Term, ...] = ()
        if errors == "auto" and parameters == "identifiable":
            selection = select(problem, rng)
            choice, cell = selection.terms, with_errors(cell, selection.errors)
            problem = Problem.pose(cell, whole, loss, priors)
            start = start if not selection.errors else None  # of another robot
        result = estimate(problem, start)
        if parameters == "all":
            problem, result = survivor(problem, result, tables)
        problem, result, changes = with_changes(problem, result, tables)
        if parameters == "all":
            problem, result = with_jig_as_it_is(problem, result)
            problem, result = without_doubtful(problem, result, on_faces(tables))
        if not problem.is_stationary(result.x, result.weight):
            x = problem.theta(result.x)
            problem = problem.complete()
            result = estimate(problem, x, result.used)
        problem.require_rank(result.x, result.weight, "at the solution")
        require_scale(problem.unknowns, problem.unknown(result.x), problem.rows)
        fit = _Fit(problem, result, choice)
        if errors == "auto" and parameters == "all":
            joint_errors = with_joint_errors(problem, result, rng)
            full, last = joint_errors.problem(problem)
            last = replace(last, iterations=result.iterations, seconds=result.seconds)
            fit = _Fit(full, last, joint_errors.selection.terms, joint_errors)
        held_out = fit.held_out(folds, rng)
        wrong = labels(problem, result, whole) if parameters == "all" else ()
        return _calibration(problem, fit, held_out, tables, whole, wrong, changes, inputs or {})


def _equations(cell: Cell, tables: tuple[Measurements, ...]) -> Rows:
    """The equations of all measurements; raises InputError if there is none, or joints are in degrees."""
    for table in tables:
        cell.robot.require_radians(table.q)
    rows = equations(cell, tables)
    if not len(rows):
        raise InputError("there is nothing to identify from: no touch of status hit, no position; make some first")
    return rows


@dataclass(frozen=True, eq=False)
class _Fit:
    """A problem, its estimate, and what the joint errors add."""

    problem: Problem
    estimate: Estimate
    choice: tuple[Term, ...]
    joint_errors: JointErrors | None = None

    def covariance(self) -> Float[np.ndarray, "unknowns unknowns"]:
        """Of all unknowns, in units of their priors."""
        if self.joint_errors is not None:
            return self.joint_errors.posterior.covariance
        return self.problem.of_unknowns(self.problem.covariance(self.estimate.x, self.estimate.weight))

    def discrepancy(self) -> Discrepancy:
        """Noise, and factors on the priors, by which this arm differs from what was stated."""
        if self.joint_errors is None:
            return Discrepancy(self.estimate.noise)
        models = self.joint_errors.models
        return Discrepancy(models.noise, models.geometry, models.errors)

    def held_out(self, folds: int, rng: np.random.Generator) -> Float[np.ndarray, " measured"] | None:
        """Errors at touches of regions left out of the fit, each in its turn; None if none can be spared."""
        if folds < 2:
            return None
        problem, x = self.problem, self.estimate.x
        tip = problem.cell.kinematics.tip(problem.rows.q, problem.theta(x))[0]
        label = regions(tip, folds, rng)
        errors = [problem.rows.take(out).distances(residual) for out, residual in self._left_out(label)]
        return np.concatenate(errors) if errors else None

    def _left_out(
        self, label: Int[np.ndarray, " rows"]
    ) -> Iterator[tuple[Bool[np.ndarray, " rows"], Float[np.ndarray, " out"]]]:
        """The rows of each region, and their residuals by the estimate from all others."""
        problem, result = self.problem, self.estimate
        for region in np.unique(label):
            out = (label == region) & result.used
            weight = np.where(out, 0.0, result.weight)
            if not out.any() or not problem.determined(result.x, weight):
                continue
            if self.joint_errors is not None:
                yield out, self.joint_errors.without(out)
            else:
                yield out, problem.residual(problem.solve(result.x, weight, "linear").x)[out]


def _calibration(
    geometry: Problem,
    fit: _Fit,
    held_out: Float[np.ndarray, " measured"] | None,
    tables: tuple[Measurements, ...],
    recorded: Rows,
    wrong: tuple[Label, ...],
    changes: tuple[Change, ...],
    inputs: Mapping[str, str],
) -> Calibration:
    problem, result = fit.problem, fit.estimate
    unknowns, count = problem.unknowns, len(problem.unknowns.parameters)
    names = problem.cell.robot.parameters
    covariance = fit.covariance() * np.outer(unknowns.scale, unknowns.scale)
    x, residual = problem.unknown(result.x), problem.residual(result.x)
    unit = dict(zip(names, problem.cell.robot.parameter_unit(), strict=True))
    combinations = {} if problem.structure is None else problem.structure.combinations
    deviation, significant = scatter(problem, result)
    places = coordinates(problem.cell, problem.theta(result.x), problem.rows.q[result.used])
    values, deviations = unknowns.origin + x * unknowns.scale, np.sqrt(np.diag(covariance))
    calibration = Calibration(
        cell=problem.cell,
        theta=problem.theta(result.x),
        start=_start(geometry, problem),
        estimated=tuple(unknowns.names[:count]),
        combinations={
            name: {carrier: c * unit[name] / unit[carrier] for carrier, c in terms.items()}
            for name, terms in combinations.items()
        },
        covariance=covariance[:count, :count],
        shared=_shared(unknowns, values),
        shared_covariance=covariance[count:],
        discrepancy=fit.discrepancy(),
        scatter=deviation,
        scatter_significant=significant,
        weak=problem.weak(result.x, result.weight),
        outliers=_worst(problem.rows, residual, ~result.used & problem.rows.counted),
        fit=summarize(problem.rows.take(result.used).distances(residual[result.used])),
        held_out=None if held_out is None else summarize(held_out),
        residuals=_residuals(problem.rows, geometry.before, residual, result.used),
        fingerprints=frozenset(fingerprints(recorded.q, recorded.offset[:, None])),
        iterations=result.iterations,
        solve_s=result.seconds,
        choice=fit.choice,
        findings=(
            *_wrong_faces(wrong),
            *_doubtful(problem.rows),
            *(change.finding(unknowns, values, deviations) for change in changes),
            *diagnose(problem, result, tables),
            *_frames(geometry),
        ),
        inputs=dict(inputs),
        spans={name: (float(value.min()), float(value.max())) for name, value in places.items()},
    )
    return replace(calibration, findings=(*place_findings(calibration), *calibration.findings))


def _wrong_faces(wrong: tuple[Label, ...]) -> Iterator[Finding]:
    for label in wrong:
        yield Finding(
            "wrong face",
            f"touch {label.touch} is recorded on '{label.recorded}', {abs(label.off):.1f} mm from where its tip was, "
            f"and lies on '{label.face}': it was used there; correct its face in the file",
            (label.touch,),
        )


def _doubtful(rows: Rows) -> tuple[Finding, ...]:
    """Touches beside an edge, in words."""
    names = tuple(rows.ids[owner] for owner in np.unique(rows.owner[~rows.counted]))
    if not names:
        return ()
    words = (
        f"{len(names)} of {len(rows.ids)} touches lie so near an edge that they may have met the next face, and were "
        f"not used: {', '.join(names)}; plan them farther from the edges"
    )
    return (Finding("edge", words, names),)


def _frames(problem: Problem) -> tuple[Finding, ...]:
    """What is a choice of frame, in words."""
    words = gauge_words(problem.unknowns, problem.basis) if problem.unknowns.named else ""
    return (Finding("frame", words),) if words else ()


def _shared(unknowns: Unknowns, values: Float[np.ndarray, " unknowns"]) -> tuple[SharedValue, ...]:
    """What measurements share: offsets of faces, wires, drift, frames and points."""
    shared = list(zip(unknowns.names, unknowns.units, values, unknowns.scale, strict=True))
    return tuple(
        SharedValue(name, "deg" if unit == "deg" else "mm", float(v), float(s))
        for name, unit, v, s in shared[len(unknowns.parameters) :]
    )


def _start(geometry: Problem, problem: Problem) -> Float[np.ndarray, " parameters"]:
    """Where the search began, with joint errors of zero beside it."""
    before = dict(zip(geometry.cell.robot.parameters, geometry.start, strict=True))
    return np.array([before.get(name, 0.0) for name in problem.cell.robot.parameters])


def _worst(rows: Rows, residual: Float[np.ndarray, " rows"], these: Bool[np.ndarray, " rows"]) -> dict[str, float]:
    """The largest residual of each touch or position among some rows, by id."""
    order = np.argsort(np.abs(residual), kind="stable")  # the largest comes last, and stays
    order = order[these[order]]
    worst = np.full(len(rows.ids), -1)
    worst[rows.owner[order]] = order
    return {rows.ids[owner]: float(residual[worst[owner]]) for owner in np.flatnonzero(worst >= 0)}


def _residuals(
    rows: Rows,
    before: Float[np.ndarray, " rows"],
    after: Float[np.ndarray, " rows"],
    inliers: Bool[np.ndarray, " rows"],
) -> dict[str, Residual]:
    """What every touch said before and after, in the order of the rows."""
    everywhere = np.ones(len(rows), dtype=bool)
    was, now = (_worst(rows, r, everywhere) for r in (before, after))
    names = {rows.ids[owner] for owner in np.unique(rows.owner[inliers])}
    return {name: Residual(was[name], now[name], name in names) for name in rows.ids}
