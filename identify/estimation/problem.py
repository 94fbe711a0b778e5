"""The least squares problem of a cell and its touches: which parameters, what start, what agrees, how it is solved."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool, Float

from identify.estimation.initial_guess import starting_point
from identify.estimation.least_squares import LOSSES, LeastSquares, Objective, Part, Solution
from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.identifiability import (
    Identifiability,
    Sight,
    everything,
    rank_of,
    sight,
    still_joints,
    structure,
    weak,
)
from identify.model.measurement import Rows, measurement_model

PART = 8192  # rows handled at a time
FALSE_ALARM = 0.01  # chance that one of all good touches is called an outlier
SURE = 0.98  # of the limit of an outlier: closer to it a robust fit decides


def with_face_scatter(cell: Cell, rows: Rows) -> Rows:
    """Rows whose scatter holds the tolerance of the face: until faces are unknowns here, they count as noise."""
    faces = {} if cell.jig is None else cell.jig.by_name
    tolerance = [faces[name].tolerance if name in faces else 0.0 for name in rows.face]
    return replace(rows, sigma=np.hypot(rows.sigma, tolerance)) if tolerance else rows


class CalibrationFailed(RuntimeError):
    """The solver did not find an answer; there is no number to give."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """An estimate, the rows that it rests on, and what it took."""

    x: Float[np.ndarray, " kept"]
    used: Bool[np.ndarray, " rows"]
    weight: Float[np.ndarray, " rows"]  # 1 / (sigma scatter), 0 where not used
    iterations: int
    seconds: float


@dataclass(eq=False)
class Problem:
    """The least squares problem of a cell and its rows; x is the change of the kept parameters from the start."""

    cell: Cell
    rows: Rows
    start: Float[np.ndarray, " parameters"]
    structure: Identifiability
    priors: bool
    loss: str
    eliminate: bool

    @classmethod
    def pose(cls, cell: Cell, rows: Rows, loss: str, priors: bool, eliminate: bool = True) -> "Problem":
        """The problem of a cell and its rows; raises InputError where these cannot determine the parameters."""
        if loss not in LOSSES:
            raise InputError(f"loss '{loss}' is not known; choose one of {', '.join(LOSSES)}")
        start = starting_point(cell, rows)
        still = still_joints(rows)
        found = structure(cell, start, still, rows.conditions) if eliminate else everything(cell, priors)
        problem = cls(cell, rows, start, found, priors, loss, eliminate)
        needed = len(problem.required)
        if len(rows) < needed:
            raise InputError(
                f"{len(rows)} equations cannot determine {needed} parameters; make at least "
                f"{needed - len(rows)} more touches, better {2 * needed - len(rows)}, spread over all faces "
                "and the range of every joint"
            )
        problem.require_rank(np.zeros(found.rank), 1 / rows.sigma, "at these touches")
        return problem

    def __post_init__(self) -> None:
        self.model = measurement_model(self.cell.robot)
        self._residual_at = np.full(1, np.nan), np.empty(0)
        self._freedom_at = b"", 0.0
        self._linearized_at: tuple[np.ndarray, tuple[Part, ...]] = np.full(1, np.nan), ()
        self.kept = np.array(self.structure.kept, dtype=int)
        self.names = [self.structure.names[i] for i in self.kept]
        fitted = np.isinf(self.cell.prior[self.kept])
        self.prior = np.where(fitted | (not self.priors), np.inf, self.cell.scale[self.kept])
        beyond = {name for name, _, _ in self.cell.robot.error_parameters if self.priors}
        required = [self.eliminate and name not in beyond for name in self.names]  # the priors hold the others
        self.required = np.flatnonzero(required)
        self.objective = Objective(self.linearized, self.prior, 1 / self.rows.sigma)
        lower, upper = self._bounds()
        self.solver = LeastSquares(self.objective, np.zeros(len(self.kept)), lower, upper)
        self.before = self.residual(np.zeros(len(self.kept)))  # [mm], of the start

    def _bounds(self) -> tuple[Float[np.ndarray, " kept"], Float[np.ndarray, " kept"]]:
        bounds = [self.cell.bounds.get(name, (-np.inf, np.inf)) for name in self.names]
        lower, upper = (np.array(side) - self.start[self.kept] for side in zip(*bounds, strict=True))
        return lower, upper

    def theta(self, x: Float[np.ndarray, " kept"]) -> Float[np.ndarray, " parameters"]:
        """All parameters [mm, rad]."""
        theta = self.start.copy()
        theta[self.kept] += x
        return theta

    def linearized(self, x: Float[np.ndarray, " kept"]) -> Iterable[Part]:
        """Residuals and their Jacobian, part by part: memory stays bounded whatever the number of touches."""
        if len(self.rows) > PART:
            return self._parts(x)
        if not np.array_equal(x, self._linearized_at[0]):
            self._linearized_at = x.copy(), tuple(self._parts(x))
        return self._linearized_at[1]

    def _parts(self, x: Float[np.ndarray, " kept"]) -> Iterator[Part]:
        theta, whole, every = self.theta(x), len(self.rows) <= PART, len(self.kept) == len(self.start)
        for start in range(0, len(self.rows), PART):
            part = slice(start, min(start + PART, len(self.rows)))
            rows = self.rows if whole else self.rows.take(np.arange(part.start, part.stop))
            r, J = self.model.linearize(theta, rows)
            yield part, r, J if every else J[:, self.kept]

    def residual(self, x: Float[np.ndarray, " kept"]) -> Float[np.ndarray, " rows"]:
        """What is left of every row [mm]."""
        if not np.array_equal(x, self._residual_at[0]):
            self._residual_at = x.copy(), np.concatenate([r for _, r, _ in self.linearized(x)])
        return self._residual_at[1]

    def weak(self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"]) -> tuple[str, ...]:
        """Parameters in directions that the touches see less well than the priors do."""
        scale = self.cell.scale[self.kept]
        G = sum((J.T * weight[part] ** 2) @ J for part, _, J in self.linearized(x)) * np.outer(scale, scale)
        return weak(G, self.names)

    def geometry(self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"]) -> Sight:
        """What the touches see of the parameters that they have to determine."""
        return sight(self._triangle(x, weight)[:, self.required], [self.names[i] for i in self.required])

    def _triangle(
        self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"]
    ) -> Float[np.ndarray, "order kept"]:
        R = np.empty((0, len(self.kept)))
        for part, _, J in self.linearized(x):
            R = np.asarray(np.linalg.qr(np.vstack([R, J * weight[part, None]]), mode="r"))
        return R * self.cell.scale[self.kept]

    def require_rank(self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"], where: str) -> None:
        """Raise InputError, naming what suffers and what to add, where the touches do not determine every parameter."""
        if not self.determined(x, weight):
            seen = self.geometry(x, weight)
            raise InputError(
                f"{where}, {len(self.required) - seen.rank} of {len(self.required)} directions are not seen: "
                f"{', '.join(seen.lost)} cannot be told apart; {_cure(self.rows)}"
            )

    def determined(self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"]) -> bool:
        """Whether rows with these weights determine the parameters that they have to."""
        needed = len(self.required)
        if needed == 0:
            return True
        return (
            int(np.count_nonzero(weight)) >= needed and rank_of(self._triangle(x, weight)[:, self.required]) == needed
        )

    def precision(
        self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"]
    ) -> Float[np.ndarray, "kept kept"]:
        """Inverse covariance of the kept parameters, priors included."""
        self.objective.reweigh(weight, "linear")
        return self.objective.at(x)[2].copy()

    def covariance(
        self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"]
    ) -> Float[np.ndarray, "kept kept"]:
        """Covariance of the kept parameters, inverted in units of their own: lengths and ratios lie far apart."""
        P = self.precision(x, weight)
        unit = 1 / np.sqrt(np.diag(P))
        C = np.linalg.inv(P * np.outer(unit, unit)) * np.outer(unit, unit)
        return np.asarray((C + C.T) / 2)

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

    def estimate(self, start: Float[np.ndarray, " parameters"] | None = None) -> Estimate:
        """Least squares on the touches that agree: a robust fit finds those that do not, and they are left out."""
        weight, used = 1 / self.rows.sigma, np.ones(len(self.rows), dtype=bool)
        x = np.zeros(len(self.kept)) if start is None else (start - self.start)[self.kept]
        solutions, weighed = [self._first(x, weight)], weight
        near, unanimous = self._foreseen(solutions[-1].x, weight)
        if not unanimous:
            for _ in range(6):
                scale = self._scale(solutions[-1].x, used)
                solutions.append(self.solve(near, weight / scale, self.loss))
                near = solutions[-1].x
                agreeing = self._agreeing(solutions[-1].x, weight / self._scale(solutions[-1].x, used))
                weighed = np.zeros_like(weight)  # by no plain fit
                if np.array_equal(agreeing, used):
                    break
                used = agreeing
        for _ in range(2):  # the scatter sets how much the priors weigh, and the priors change the scatter a little
            final = weight * used / max(self._deviation(solutions[-1].x, used), 1.0)
            if np.array_equal(final, weighed):
                break
            solutions.append(self.solve(solutions[-1].x, final, "linear"))
            weighed = final
        iterations, seconds = sum(s.iterations for s in solutions), sum(s.seconds for s in solutions)
        return Estimate(solutions[-1].x, used, weighed, iterations, seconds)

    def _first(self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"]) -> Solution:
        """Plain least squares; where touches far from all others keep these from an end, the robust loss at once."""
        try:
            return self.solve(x, weight, "linear")
        except CalibrationFailed:
            if self.loss == "linear":
                raise
            return self.solve(x, weight, self.loss)

    def _foreseen(
        self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"]
    ) -> tuple[Float[np.ndarray, " kept"], bool]:
        """Where a robust fit will end, by the equations as they are near a plain one, linear; whether all agree there.

        If they clearly do, the robust fit of the equations themselves need not be made.
        """
        if self.loss == "linear":
            return x, True
        if len(self.rows) > PART:
            return x, False
        ((part, r, J),) = self.linearized(x)
        everyone = np.ones(len(r), dtype=bool)
        scaled = weight / self._scale(x, everyone)
        y = self.solver.near(Objective(lambda y: [(part, r + J @ (y - x), J)], self.prior, scaled, self.loss), x)
        if y is None:
            return x, False
        left = r + J @ (y - x)
        sizes = self._sizes(x, weight / self._scale(x, everyone, left), left)
        return y, bool((sizes <= SURE * self._limit).all())

    def _scale(
        self, x: Float[np.ndarray, " kept"], used: Bool[np.ndarray, " rows"],
        residual: Float[np.ndarray, " rows"] | None = None,
    ) -> float:  # fmt: skip
        """Robust scatter in units of sigma, at least 1: the median absolute residual, corrected for the parameters."""
        r = ((self.residual(x) if residual is None else residual) / self.rows.sigma)[used]
        freedom = max(self.freedom(x, used / self.rows.sigma), 1)
        return max(1.0, 1.4826 * float(np.median(np.abs(r))) * np.sqrt(len(r) / freedom))

    def _agreeing(self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"]) -> Bool[np.ndarray, " rows"]:
        """Rows of touches whose residual is within what chance makes of a good touch, leverage considered."""
        return (self._sizes(x, weight) <= self._limit)[self.rows.owner]

    @property
    def _limit(self) -> float:
        return NormalDist().inv_cdf(1 - FALSE_ALARM / (2 * len(self.rows)))

    def _sizes(
        self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"],
        residual: Float[np.ndarray, " rows"] | None = None,
    ) -> Float[np.ndarray, " measured"]:  # fmt: skip
        """The largest residual of each touch in units of what chance makes of a good one, leverage considered."""
        C, size = self.covariance(x, weight), np.empty(len(self.rows))
        for part, r, J in self.linearized(x):
            w = weight[part]
            leverage = w**2 * ((J @ C) * J).sum(axis=1)
            size[part] = np.abs(r if residual is None else residual[part]) * w / np.sqrt(np.clip(1 - leverage, 0.05, 1))
        worst = np.zeros(len(self.rows.ids))
        np.maximum.at(worst, self.rows.owner, size)
        return worst

    def _deviation(self, x: Float[np.ndarray, " kept"], used: Bool[np.ndarray, " rows"]) -> float:
        """Root of chi-square a degree of freedom, in units of sigma."""
        r = (self.residual(x) / self.rows.sigma)[used]
        return float(np.sqrt(r @ r / max(self.freedom(x, used / self.rows.sigma), 1)))

    def freedom(self, x: Float[np.ndarray, " kept"], weight: Float[np.ndarray, " rows"]) -> float:
        """Rows in use less the parameters that they, and not the priors, determine."""
        asked = x.tobytes() + weight.tobytes()
        if asked != self._freedom_at[0]:
            determined = float(len(self.kept))
            if len(self.required) < len(self.kept):
                determined -= float(np.diag(np.linalg.inv(self.precision(x, weight))) @ (1 / self.prior**2))
            self._freedom_at = asked, np.count_nonzero(weight) - determined
        return self._freedom_at[1]

    def scatter(self, estimate: Estimate) -> tuple[float, bool]:
        """Scatter in units of sigma, and whether chance explains its distance from 1 (Wilson and Hilferty 1931)."""
        freedom = self.freedom(estimate.x, estimate.weight)
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
