"""The least squares problem of a cell and its touches: which unknowns, what start, how it is solved."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from identify.estimation.gauge import without_gauge
from identify.estimation.initial_guess import starting_point
from identify.estimation.least_squares import LOSSES, LeastSquares, Objective, Part, Solution
from identify.estimation.placement_guess import with_further
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
    visible,
    weak,
)
from identify.model.measurement import Rows
from identify.uncertainty.unknowns import Shared, Unknowns

PART = 8192  # rows handled at a time
BLIND = 0.01  # [prior deviations] that a direction left out may move the solution


def with_face_scatter(cell: Cell, rows: Rows) -> Rows:
    """Rows whose scatter holds the tolerance of the face, for estimates in which faces are no unknowns."""
    faces = {} if cell.jig is None else cell.jig.by_name
    tolerance = [faces[name].tolerance if name in faces else 0.0 for name in rows.face]
    return replace(rows, sigma=np.hypot(rows.sigma, tolerance)) if tolerance else rows


class CalibrationFailed(RuntimeError):
    """The solver did not find an answer; there is no number to give."""


@dataclass(eq=False)
class Problem:
    """Half the squares of the weighted residuals and of the unknowns, over coordinates x in a basis of the unknowns.

    The unknowns, in units of their priors, are origin + basis @ x. With all unknowns the basis is orthonormal and
    leaves out what no measurement can show of any robot near the drawing: there the most probable value is the
    prior's. If single parameters are eliminated, as in the paper, the basis holds the others.
    """

    cell: Cell
    rows: Rows
    unknowns: Unknowns
    origin: Float[np.ndarray, " unknowns"]
    basis: Float[np.ndarray, "unknowns size"]
    structure: Identifiability | None  # of single parameters; None: all unknowns
    priors: bool
    loss: str
    deviation: Float[np.ndarray, " size"] | None = None  # of the priors of the coordinates, if not the stated ones

    @classmethod
    def pose(cls, cell: Cell, rows: Rows, loss: str, priors: bool, eliminate: bool = True) -> "Problem":
        """The problem of a cell and its rows; raises InputError if these cannot determine the unknowns.

        `eliminate` drops single parameters by the structure of the drawing. Without it all unknowns are estimated.
        """
        if loss not in LOSSES:
            raise InputError(f"loss '{loss}' is not known; choose one of {', '.join(LOSSES)}")
        start = starting_point(cell, rows)
        if eliminate:
            problem = cls._of_single_parameters(cell, with_face_scatter(cell, rows), start, loss, priors)
        else:
            if not priors:
                everything(cell, priors)
            problem = cls._of_all(cell, rows, start, loss)
        least = len(problem.required)
        if len(rows) < max(least, 1):
            raise InputError(
                f"{len(rows)} equations cannot determine {least} parameters; make at least "
                f"{max(least, 1) - len(rows)} more touches, better {2 * least - len(rows)}, spread over all faces "
                "and the range of every joint"
            )
        problem.require_rank(np.zeros(problem.size), 1 / problem.rows.sigma, "at these touches")
        return problem

    @classmethod
    def _of_single_parameters(
        cls, cell: Cell, rows: Rows, start: Float[np.ndarray, " parameters"], loss: str, priors: bool
    ) -> "Problem":
        """The paper's problem: parameters that the drawing makes dependent are dropped, faces are noise."""
        dependencies = structure(cell, start, still_joints(rows), rows.conditions)
        unknowns = Unknowns(cell, np.array(dependencies.kept, dtype=int))
        origin = (start - cell.theta)[unknowns.parameters] / unknowns.scale
        return cls(cell, rows, unknowns, origin, np.eye(len(unknowns)), dependencies, priors, loss)

    @classmethod
    def _of_all(cls, cell: Cell, rows: Rows, start: Float[np.ndarray, " parameters"], loss: str) -> "Problem":
        """All unknowns, in the directions that measurements can show."""
        unknowns = Unknowns.of(cell)
        some = unknowns.parameters
        origin = np.zeros(len(unknowns))
        origin[: len(some)] = (start - cell.theta)[some] / unknowns.scale[: len(some)]
        basis = np.eye(len(unknowns))
        if not cell.bounds:
            shares = visible(cell, start, some, still_joints(rows), rows.conditions, bool(rows.radius.any()))
            further = len(unknowns) - len(some)
            basis = np.zeros((len(unknowns), shares.shape[1] + further))
            basis[: len(some), : shares.shape[1]] = shares
            basis[len(some) :, shares.shape[1] :] = np.eye(further)
        origin = with_further(unknowns, origin, rows, start)
        return cls(cell, rows, unknowns, origin, without_gauge(unknowns, origin, basis, rows), None, True, loss)

    def __post_init__(self) -> None:
        self.size = self.basis.shape[1]
        self._plain = self.basis.shape[0] == self.size and np.array_equal(self.basis, np.eye(self.size))
        self._residual_at = np.full(1, np.nan), np.empty(0)
        self._freedom_at = b"", 0.0
        self._linearized_at: tuple[np.ndarray, tuple[Part, ...]] = np.full(1, np.nan), ()
        with_prior = (self.unknowns.precision[:, None] * np.abs(self.basis)).sum(axis=0) > 0
        stated = np.where(with_prior & self.priors, 1.0, np.inf)
        self.prior = stated if self.deviation is None else self.deviation  # of the coordinates
        self.required = np.flatnonzero(self._required())
        self.objective = Objective(self.linearized, self.prior, 1 / self.rows.sigma)
        lower, upper = self._bounds()
        self.solver = LeastSquares(self.objective, np.zeros(self.size), lower, upper)
        self.before = self.residual(np.zeros(self.size))  # [mm], of the start

    def _required(self) -> Bool[np.ndarray, " size"]:
        """Coordinates that the rows have to determine: priors do not."""
        if self.structure is None:
            return np.isinf(self.prior)
        beyond = {name for name, _, _ in self.cell.robot.error_parameters if self.priors}
        return np.array([name not in beyond for name in self.unknowns.names], dtype=bool)

    def _bounds(self) -> tuple[Float[np.ndarray, " size"], Float[np.ndarray, " size"]]:
        if not self.cell.bounds:
            return np.full(self.size, -np.inf), np.full(self.size, np.inf)
        bounds = [self.cell.bounds.get(name, (-np.inf, np.inf)) for name in self.unknowns.names]
        zero = np.zeros(len(self.unknowns))
        zero[: len(self.unknowns.parameters)] = self.cell.theta[self.unknowns.parameters]
        lower, upper = ((np.array(side) - zero) / self.unknowns.scale for side in zip(*bounds, strict=True))
        return lower - self.origin, upper - self.origin

    @property
    def start(self) -> Float[np.ndarray, " parameters"]:
        """Parameters from which the search begins [mm, rad]."""
        return self.theta(np.zeros(self.size))

    def unknown(self, x: Float[np.ndarray, " size"]) -> Float[np.ndarray, " unknowns"]:
        """All unknowns at coordinates, in units of their priors."""
        return self.origin + (x if self._plain else self.basis @ x)

    def coordinates(self, theta: Float[np.ndarray, " parameters"]) -> Float[np.ndarray, " size"]:
        """Coordinates of a robot [mm, rad] to begin a search at; what measurements share is as on the drawing."""
        some = self.unknowns.parameters
        x = np.zeros(len(self.unknowns))
        x[: len(some)] = (theta - self.cell.theta)[some] / self.unknowns.scale[: len(some)]
        return self.basis.T @ (x - self.origin)

    def theta(self, x: Float[np.ndarray, " size"]) -> Float[np.ndarray, " parameters"]:
        """All parameters of the robot [mm, rad]."""
        return self.unknowns.theta(self.unknown(x))

    def linearized(self, x: Float[np.ndarray, " size"]) -> Iterable[Part]:
        """Residuals and their Jacobian, part by part: memory stays bounded whatever the number of touches."""
        if len(self.rows) > PART:
            return self._parts(x)
        if not np.array_equal(x, self._linearized_at[0]):
            self._linearized_at = x.copy(), tuple(self._parts(x))
        return self._linearized_at[1]

    def _parts(self, x: Float[np.ndarray, " size"]) -> Iterator[Part]:
        everything, whole = self.unknown(x), len(self.rows) <= PART
        for start in range(0, len(self.rows), PART):
            part = slice(start, min(start + PART, len(self.rows)))
            rows = self.rows if whole else self.rows.take(np.arange(part.start, part.stop))
            r, J = self.unknowns.linearize(everything, rows)
            yield part, r, J if self._plain else J @ self.basis

    def residual(self, x: Float[np.ndarray, " size"]) -> Float[np.ndarray, " rows"]:
        """What is left of every row [mm]."""
        if not np.array_equal(x, self._residual_at[0]):
            self._residual_at = x.copy(), np.concatenate([r for _, r, _ in self.linearized(x)])
        return self._residual_at[1]

    def weak(self, x: Float[np.ndarray, " size"], weight: Float[np.ndarray, " rows"]) -> tuple[str, ...]:
        """Unknowns in directions that the touches see less well than the priors do."""
        G = sum((J.T * weight[part] ** 2) @ J for part, _, J in self.linearized(x))
        return weak(self.basis @ G @ self.basis.T, self.unknowns.names)

    def geometry(self, x: Float[np.ndarray, " size"], weight: Float[np.ndarray, " rows"]) -> Sight:
        """What the touches see of the parameters that they have to determine."""
        R = self._triangle(x, weight)
        if self.structure is None:
            loose = np.flatnonzero(self.unknowns.precision == 0)
            return sight(R @ self.basis.T[:, loose], [self.unknowns.names[i] for i in loose])
        return sight(R[:, self.required], [self.unknowns.names[i] for i in self.required])

    def _triangle(
        self, x: Float[np.ndarray, " size"], weight: Float[np.ndarray, " rows"]
    ) -> Float[np.ndarray, "order size"]:
        R = np.empty((0, self.size))
        for part, _, J in self.linearized(x):
            R = np.asarray(np.linalg.qr(np.vstack([R, J * weight[part, None]]), mode="r"))
        return R

    def require_rank(self, x: Float[np.ndarray, " size"], weight: Float[np.ndarray, " rows"], where: str) -> None:
        """Raise InputError, naming what suffers and what to add, if the touches do not determine what they have to."""
        if not self.determined(x, weight):
            geometry = self.geometry(x, weight)
            raise InputError(
                f"{where}, {len(self.required) - min(geometry.rank, len(self.required))} of {len(self.required)} "
                f"directions are not seen: {', '.join(geometry.lost)} cannot be told apart; {_cure(self.rows)}"
            )

    def determined(self, x: Float[np.ndarray, " size"], weight: Float[np.ndarray, " rows"]) -> bool:
        """Whether rows with these weights determine the coordinates that they have to."""
        least = len(self.required)
        if least == 0:
            return True
        return int(np.count_nonzero(weight)) >= least and rank_of(self._triangle(x, weight)[:, self.required]) == least

    def precision(self, x: Float[np.ndarray, " size"], weight: Float[np.ndarray, " rows"]) -> Float[np.ndarray, "s s"]:
        """Inverse covariance of the coordinates, priors included."""
        self.objective.reweigh(weight, "linear")
        return self.objective.at(x)[2].copy()

    def covariance(self, x: Float[np.ndarray, " size"], weight: Float[np.ndarray, " rows"]) -> Float[np.ndarray, "s s"]:
        """Covariance of the coordinates, inverted in units of their own: some are seen far better than others."""
        P = self.precision(x, weight)
        unit = 1 / np.sqrt(np.diag(P))
        C = np.linalg.inv(P * np.outer(unit, unit)) * np.outer(unit, unit)
        return np.asarray((C + C.T) / 2)

    def of_unknowns(self, C: Float[np.ndarray, "s s"]) -> Float[np.ndarray, "unknowns unknowns"]:
        """Covariance of all unknowns, in units of their priors; in directions left out it is that of the prior."""
        if self._plain:
            return C
        out = np.diag(self.unknowns.precision) * (np.eye(len(self.unknowns)) - self.basis @ self.basis.T)
        return self.basis @ C @ self.basis.T + out

    def solve(self, x: Float[np.ndarray, " size"], weight: Float[np.ndarray, " rows"], loss: str) -> Solution:
        """Minimise from x; raises CalibrationFailed with Ipopt's own word if it does not converge."""
        self.objective.reweigh(weight, loss)
        solution = self.solver.solve(x)
        if not solution.converged or not np.isfinite(solution.x).all():
            raise CalibrationFailed(
                f"Ipopt stopped with {solution.status} after {solution.iterations} iterations; no parameters given. "
                "Check base and tool in cell.yaml, the zero and the sign of every joint, and the names of the faces"
            )
        return solution

    def is_stationary(self, x: Float[np.ndarray, " size"], weight: Float[np.ndarray, " rows"]) -> bool:
        """Whether x is the minimum over all unknowns: in directions left out, no row has a say at the solution."""
        if self._plain:
            return True
        gradient = np.zeros(len(self.unknowns))
        for start in range(0, len(self.rows), PART):
            part = slice(start, min(start + PART, len(self.rows)))
            r, J = self.unknowns.linearize(self.unknown(x), self.rows.take(np.arange(part.start, part.stop)))
            gradient += J.T @ (weight[part] ** 2 * r)
        rest = gradient - self.basis @ (self.basis.T @ gradient)
        return bool(np.abs(rest * self.unknowns.precision).max() < BLIND)

    def with_shared(self, shared: Sequence[Shared]) -> "Problem":
        """The same problem with further unknowns that measurements share."""
        unknowns, more = self.unknowns, len(shared)
        place = len(unknowns.parameters) + len(unknowns.shared)
        basis = np.zeros((len(unknowns) + more, self.size + more))
        basis[place : place + more, self.size :] = np.eye(more)
        basis[:place, : self.size] = self.basis[:place]
        basis[place + more :, : self.size] = self.basis[place:]
        return replace(
            self,
            unknowns=replace(unknowns, shared=(*unknowns.shared, *shared)),
            origin=np.insert(self.origin, place, np.zeros(more)),
            basis=basis,
            deviation=None if self.deviation is None else np.append(self.deviation, np.ones(more)),
        )

    def complete(self) -> "Problem":
        """The same problem without a direction left out."""
        loose = self.unknowns.precision == 0
        basis = np.hstack([self.basis[:, ~np.isfinite(self.prior)], np.eye(len(loose))[:, ~loose]])
        return replace(self, basis=basis)


def _cure(rows: Rows) -> str:
    """What to add to touches that leave directions unseen."""
    U, s, _ = np.linalg.svd(rows.normal.T @ rows.normal)
    missing = ["xyz"[int(np.argmax(np.abs(U[:, k])))] for k in range(3) if s[k] < 1e-6 * s[0]]
    if missing:
        return f"no face looks along {' or '.join(missing)}: touch faces whose normals do"
    still = [f"joint {i + 1}" for i in still_joints(rows)]
    moving = f" ({', '.join(still)} never moves)" if still else ""
    return f"add touches with other wrist angles, on other faces and at other heights{moving}"
