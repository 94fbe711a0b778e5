"""From touches to parameters: elimination, Ipopt, outliers, uncertainty, and errors where the fit has not looked."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.least_squares import LOSSES, LeastSquares, Objective, Part, Solution
from identify.model.calibration import Calibration, Residual, fingerprints, summarize
from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.identifiability import Identifiability, Sight, sight, still_joints, structure
from identify.model.measurement import Rows, measurement_model, rows
from identify.model.touch import Positions, Touches
from identify.regions import regions
from identify.starting import starting_point

PART = 8192  # rows handled at a time
FALSE_ALARM = 0.01  # chance that one of all good touches is called an outlier


class CalibrationFailed(RuntimeError):
    """The solver did not find an answer; there is no number to give."""


def calibrate(
    cell: Cell,
    *measured: Touches | Positions,
    loss: str = "huber",
    priors: bool = True,
    folds: int = 5,
    rng: np.random.Generator | None = None,
    inputs: Mapping[str, str] | None = None,
) -> Calibration:
    """Identify the parameters that put every touch on its face.

    `loss` is a row of LOSSES; `priors` adds the cell's tolerances to the touches (maximum a posteriori); `folds`
    regions are held out in turn; `inputs` are the hashes of the files. Raises InputError where the touches cannot
    determine the parameters, and CalibrationFailed where Ipopt does not converge.
    """
    problem = _Problem.pose(cell, rows(cell.wire, measured, cell.robot.temperature), loss, priors)
    estimate = problem.estimate()
    seen = problem.sight(estimate.x, estimate.weight)
    problem.require_rank(seen, "at the solution")
    held_out = _held_out(problem, estimate, folds, np.random.default_rng(0) if rng is None else rng)
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
        covariance=np.linalg.inv(problem.precision(estimate.x, estimate.weight)),
        scatter=scatter,
        scatter_significant=significant,
        weak=seen.weak,
        outliers=_worst(problem.rows, residual, ~estimate.used),
        fit=summarize(problem.rows.take(estimate.used).distances(residual[estimate.used])),
        held_out=None if held_out is None else summarize(held_out),
        residuals=_residuals(problem, residual, estimate.used),
        fingerprints=frozenset(fingerprints(problem.rows.q, problem.rows.offset[:, None])),
        iterations=estimate.iterations,
        solve_s=estimate.seconds,
        inputs=dict(inputs or {}),
    )


def _worst(rows: Rows, residual: Float[np.ndarray, " rows"], these: Bool[np.ndarray, " rows"]) -> dict[str, float]:
    """The largest residual of each touch or position among some rows, by id."""
    order = np.argsort(np.abs(residual), kind="stable")  # the largest comes last, and stays
    return {rows.ids[rows.owner[i]]: float(residual[i]) for i in order if these[i]}


def _residuals(
    problem: "_Problem", after: Float[np.ndarray, " rows"], used: Bool[np.ndarray, " rows"]
) -> dict[str, Residual]:
    """What every touch said before and after, in the order of the rows."""
    rows, everywhere = problem.rows, np.ones(len(problem.rows), dtype=bool)
    before = problem.model.residual(problem.start, rows)
    worst = (_worst(rows, r, everywhere) for r in (before, after))
    was, now = worst
    kept = {rows.ids[owner] for owner in np.unique(rows.owner[used])}
    return {name: Residual(was[name], now[name], name in kept) for name in rows.ids}


@dataclass(frozen=True, eq=False)
class _Estimate:
    """An estimate, the rows that it rests on, and what it took."""

    x: Float[np.ndarray, " kept"]
    used: Bool[np.ndarray, " rows"]
    weight: Float[np.ndarray, " rows"]  # 1 / (sigma scatter), 0 where not used
    iterations: int
    seconds: float


@dataclass(eq=False)
class _Problem:
    """The least squares problem of a cell and its rows; x is the change of the kept parameters from the start."""

    cell: Cell
    rows: Rows
    start: Float[np.ndarray, " parameters"]
    structure: Identifiability
    priors: bool
    loss: str

    @classmethod
    def pose(cls, cell: Cell, rows: Rows, loss: str, priors: bool) -> "_Problem":
        if loss not in LOSSES:
            raise InputError(f"loss '{loss}' is not known; choose one of {', '.join(LOSSES)}")
        start = starting_point(cell, rows)
        found = structure(cell, start, still_joints(rows), rows.conditions)
        if len(rows) < found.rank:
            raise InputError(
                f"{len(rows)} equations cannot determine {found.rank} parameters; make at least "
                f"{found.rank - len(rows)} more touches, better {2 * found.rank - len(rows)}, spread over all faces "
                "and the range of every joint"
            )
        problem = cls(cell, rows, start, found, priors, loss)
        problem.require_rank(problem.sight(np.zeros(found.rank), 1 / rows.sigma), "at these touches")
        return problem

    def __post_init__(self) -> None:
        self.model = measurement_model(self.cell.robot)
        self._residual_at = np.full(1, np.nan), np.empty(0)
        self.kept = np.array(self.structure.kept, dtype=int)
        self.names = [self.structure.names[i] for i in self.kept]
        fitted = np.isinf(self.cell.prior[self.kept])
        self.prior = np.where(fitted | (not self.priors), np.inf, self.cell.scale[self.kept])
        self.objective = Objective(self.linearized, self.prior, 1 / self.rows.sigma)
        lower, upper = self._bounds()
        self.solver = LeastSquares(self.objective, np.zeros(len(self.kept)), lower, upper)

    def _bounds(self) -> tuple[Float[np.ndarray, " kept"], Float[np.ndarray, " kept"]]:
        bounds = [self.cell.bounds.get(name, (-np.inf, np.inf)) for name in self.names]
        lower, upper = (np.array(side) - self.start[self.kept] for side in zip(*bounds, strict=True))
        return lower, upper

    def theta(self, x: Float[np.ndarray, " kept"]) -> Float[np.ndarray, " parameters"]:
        theta = self.start.copy()
        theta[self.kept] += x
        return theta

    def linearized(self, x: Float[np.ndarray, " kept"]) -> Iterator[Part]:
        """Residuals and their Jacobian, part by part: memory stays bounded whatever the number of touches."""
        theta = self.theta(x)
        for start in range(0, len(self.rows), PART):
            part = slice(start, min(start + PART, len(self.rows)))
            r, J = self.model.linearize(theta, self.rows.take(np.arange(part.start, part.stop)))
            yield part, r, J[:, self.kept]

    def residual(self, x: Float[np.ndarray, " kept"]) -> Float[np.ndarray, " rows"]:
        if not np.array_equal(x, self._residual_at[0]):
            self._residual_at = x.copy(), np.concatenate([r for _, r, _ in self.linearized(x)])
        return self._residual_at[1]

    def sight(self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"]) -> Sight:
        R = np.empty((0, len(self.kept)))
        for part, _, J in self.linearized(x):
            R = np.asarray(np.linalg.qr(np.vstack([R, J * weight[part, None]]), mode="r"))
        return sight(R * self.cell.scale[self.kept], self.names)

    def require_rank(self, seen: Sight, where: str) -> None:
        """Raise InputError, naming what suffers and what to add, where the touches do not determine every parameter."""
        if seen.rank < len(self.kept):
            raise InputError(
                f"{where}, {len(self.kept) - seen.rank} of {len(self.kept)} directions are not seen: "
                f"{', '.join(seen.lost)} cannot be told apart; {_cure(self.rows)}"
            )

    def precision(
        self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"]
    ) -> Float[np.ndarray, "kept kept"]:
        self.objective.reweigh(weight, "linear")
        return self.objective.at(x)[2].copy()

    def solve(self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"], loss: str) -> Solution:
        """Minimise from x; raises CalibrationFailed with Ipopt's own word where it does not converge."""
        self.objective.reweigh(weight, loss)
        solution = self.solver.solve(x)
        if not solution.converged or not np.isfinite(solution.x).all():
            raise CalibrationFailed(
                f"Ipopt stopped with {solution.status} after {solution.iterations} iterations; no parameters given. "
                "Check base and tool in cell.yaml, the zero and the sign of every joint, and the names of the faces"
            )
        return solution

    def estimate(self) -> _Estimate:
        """Least squares on the touches that agree: a robust fit finds those that do not, and they are left out."""
        weight, used = 1 / self.rows.sigma, np.ones(len(self.rows), dtype=bool)
        solutions = [self.solve(np.zeros(len(self.kept)), weight, "linear")]
        for _ in range(6 if self.loss != "linear" else 0):
            scale = self._scale(solutions[-1].x, used)
            solutions.append(self.solve(solutions[-1].x, weight / scale, self.loss))
            agreeing = self._agreeing(solutions[-1].x, weight / self._scale(solutions[-1].x, used))
            if np.array_equal(agreeing, used):
                break
            used = agreeing
        for _ in range(2):  # the scatter sets how much the priors weigh, and the priors change the scatter a little
            scale = self._deviation(solutions[-1].x, used)
            solutions.append(self.solve(solutions[-1].x, weight * used / max(scale, 1.0), "linear"))
        iterations, seconds = sum(s.iterations for s in solutions), sum(s.seconds for s in solutions)
        return _Estimate(solutions[-1].x, used, weight * used / max(scale, 1.0), iterations, seconds)

    def _scale(self, x: Float[np.ndarray, " kept"], used: Bool[np.ndarray, " rows"]) -> float:
        """Robust scatter in units of sigma, at least 1: the median absolute residual, corrected for the parameters."""
        r = (self.residual(x) / self.rows.sigma)[used]
        freedom = max(len(r) - len(self.kept), 1)
        return max(1.0, 1.4826 * float(np.quantile(np.abs(r), 0.5)) * np.sqrt(len(r) / freedom))

    def _agreeing(self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"]) -> Bool[np.ndarray, " rows"]:
        """Rows of touches whose residual is within what chance makes of a good touch, leverage considered."""
        L = np.linalg.cholesky(self.precision(x, weight))
        size = np.empty(len(self.rows))
        for part, r, J in self.linearized(x):
            w = weight[part]
            leverage = (np.linalg.solve(L, J.T * w) ** 2).sum(axis=0)
            size[part] = np.abs(r) * w / np.sqrt(np.clip(1 - leverage, 0.05, 1))
        limit = NormalDist().inv_cdf(1 - FALSE_ALARM / (2 * len(size)))
        worst = np.zeros(len(self.rows.ids))
        np.maximum.at(worst, self.rows.owner, size)
        return (worst <= limit)[self.rows.owner]

    def _deviation(self, x: Float[np.ndarray, " kept"], used: Bool[np.ndarray, " rows"]) -> float:
        """Root of chi-square a degree of freedom, in units of sigma."""
        r = (self.residual(x) / self.rows.sigma)[used]
        return float(np.sqrt(r @ r / max(len(r) - len(self.kept), 1)))

    def scatter(self, estimate: _Estimate) -> tuple[float, bool]:
        """Scatter in units of sigma, and whether chance explains its distance from 1 (Wilson and Hilferty 1931)."""
        freedom = int(estimate.used.sum()) - len(self.kept)
        scatter = self._deviation(estimate.x, estimate.used)
        if freedom < 1:
            return scatter, False
        normal = (scatter ** (2 / 3) - (1 - 2 / (9 * freedom))) / np.sqrt(2 / (9 * freedom))
        return scatter, bool(abs(normal) > NormalDist().inv_cdf(0.995))


def _cure(rows: Rows) -> str:
    """What to add to touches that leave directions unseen."""
    U, s, _ = np.linalg.svd(rows.normal.T @ rows.normal)
    missing = ["xyz"[int(np.argmax(np.abs(U[:, k])))] for k in range(3) if s[k] < 1e-6 * s[0]]
    if missing:
        return f"no face looks along {' or '.join(missing)}: touch faces whose normals do"
    still = [f"joint {i + 1}" for i in still_joints(rows)]
    moving = f" ({', '.join(still)} never moves)" if still else ""
    return f"add touches with other wrist angles, on other faces and at other heights{moving}"


def _held_out(
    problem: _Problem, estimate: _Estimate, folds: int, rng: np.random.Generator
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
    problem: _Problem, estimate: _Estimate, label: Int[np.ndarray, " rows"]
) -> Iterator[tuple[Bool[np.ndarray, " rows"], Float[np.ndarray, " kept"]]]:
    for region in np.unique(label):
        out = (label == region) & estimate.used
        weight = np.where(out, 0.0, estimate.weight)
        enough = np.count_nonzero(weight) >= len(problem.kept) and out.any()
        if enough and problem.sight(estimate.x, weight).rank == len(problem.kept):
            yield out, problem.solve(estimate.x, weight, "linear").x
