"""What is known: the square root of the information about all unknowns, grown by QR."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.uncertainty.unknowns import Unknowns

UNDETERMINED = 1e-12  # of the largest singular value of R: below it a direction is not determined
ROUNDING = 1e-13  # of a correlation that was written to a file
LEAST = 1e-9  # share of a function that lies in such directions, below which rounding made it


@dataclass(frozen=True, eq=False)
class Information:
    """A normal distribution of the unknowns around an estimate, by an upper triangular R with R'R its precision.

    Rows of measurements are taken at `theta`, the parameters of the estimate.
    """

    unknowns: Unknowns
    theta: Float[np.ndarray, " parameters"]  # [mm, rad]
    R: Float[np.ndarray, "unknowns unknowns"]  # of x, in units of the priors

    @classmethod
    def prior(cls, unknowns: Unknowns) -> "Information":
        """What drawing and tolerances say."""
        return cls(unknowns, unknowns.cell.theta, np.diag(np.sqrt(unknowns.precision)))

    @classmethod
    def of_covariance(
        cls,
        unknowns: Unknowns,
        theta: Float[np.ndarray, " parameters"],
        names: Sequence[str],
        covariance: Float[np.ndarray, "names names"],
    ) -> "Information":
        """What a covariance [mm, rad] of some unknowns says; of the others the priors hold."""
        index = unknowns.index(names)
        C = covariance / np.outer(unknowns.scale[index], unknowns.scale[index])
        R = np.diag(np.sqrt(unknowns.precision))
        R[:, index] = 0.0
        R[index, :] = 0.0
        R[np.ix_(index, index)] = _precision_root(C)
        return cls(unknowns, theta, triangular(R))

    def updated(self, rows: Float[np.ndarray, "rows unknowns"]) -> "Information":
        """The information after measurements of these whitened rows."""
        return replace(self, R=triangular(np.vstack([self.R, rows])))

    def at(self, theta: Float[np.ndarray, " parameters"]) -> "Information":
        """The same information about a robot with other parameters."""
        return replace(self, theta=theta)

    def root(self, functions: Float[np.ndarray, "*rows unknowns"]) -> Float[np.ndarray, "*rows unknowns"]:
        """B with B B' the covariance of linear functions A x of the unknowns; infinite if not determined.

        B = A R^-1, by one triangular solve.
        """
        A = functions.reshape(-1, len(self.R))
        if self._null is None:
            B = solve_triangular(self.R, A.T, trans="T", check_finite=False).T
        else:
            directions, inverse = self._null
            B = A @ inverse
            open_ = np.linalg.norm(A @ directions, axis=1) > LEAST * np.linalg.norm(A, axis=1)
            B[open_] = np.inf
        return np.asarray(B.reshape(functions.shape))

    def variance(self, functions: Float[np.ndarray, "*rows unknowns"]) -> Float[np.ndarray, " *rows"]:
        """Variances of linear functions of the unknowns; infinite if the measurements do not determine one."""
        return np.asarray((self.root(functions) ** 2).sum(axis=-1))

    def covariance(self, names: Sequence[str] | None = None) -> Float[np.ndarray, "names names"]:
        """Joint covariance [mm, rad] of some unknowns, of all if not named."""
        index = range(len(self.R)) if names is None else self.unknowns.index(names)
        B = self.unknowns.scale[list(index), None] * self.root(np.eye(len(self.R))[list(index)])
        return B @ B.T

    def parameter_root(self) -> Float[np.ndarray, "parameters unknowns"]:
        """B with B B' the covariance of all parameters of the robot [mm, rad]; 0 for what is not unknown."""
        some = self.unknowns.parameters
        B = np.zeros((len(self.theta), len(self.R)))
        B[some] = self.unknowns.scale[: len(some), None] * self.root(np.eye(len(self.R))[: len(some)])
        return B

    def draws(self, count: int, rng: np.random.Generator) -> Float[np.ndarray, "count unknowns"]:
        """Draws of x around the estimate, in units of the priors; raises InputError if one is not determined."""
        if self._null is not None:
            raise InputError(
                f"{', '.join(self.undetermined())}: nothing is known of it before the touches, and they do not "
                "determine it"
            )
        z = rng.standard_normal((count, len(self.R)))
        return np.asarray(solve_triangular(self.R, z.T, check_finite=False).T)

    def robots(self, count: int, rng: np.random.Generator) -> Float[np.ndarray, "count parameters"]:
        """Parameters [mm, rad] of robots drawn from what is known."""
        some = self.unknowns.parameters
        theta = np.tile(self.theta, (count, 1))
        theta[:, some] += self.unknowns.scale[: len(some)] * self.draws(count, rng)[:, : len(some)]
        return theta

    def undetermined(self) -> tuple[str, ...]:
        """Names of the unknowns that neither priors nor measurements determine."""
        infinite = np.isinf(self.variance(np.eye(len(self.R))))
        return tuple(name for name, no in zip(self.unknowns.names, infinite, strict=True) if no)

    @cached_property
    def _null(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Directions that are not determined, and a pseudo-inverse of R; None if R is regular."""
        if self.unknowns.precision.all():
            return None
        U, s, Vt = np.linalg.svd(self.R)
        open_ = s <= UNDETERMINED * s[0]
        if not open_.any():
            return None
        return Vt[open_].T, (Vt[~open_].T / s[~open_]) @ U[:, ~open_].T


def triangular(rows: Float[np.ndarray, "rows unknowns"]) -> Float[np.ndarray, "unknowns unknowns"]:
    """The upper triangular factor of a QR decomposition, with a diagonal that is not negative."""
    R = np.asarray(np.linalg.qr(rows, mode="r"))
    return R * np.where(np.diag(R) < 0, -1.0, 1.0)[:, None]


def _precision_root(C: Float[np.ndarray, "names names"]) -> Float[np.ndarray, "names names"]:
    """An upper triangular R with R'R = C^-1: C = U U' by a Cholesky decomposition from the last row up, R = U^-1."""
    deviation = np.sqrt(np.diag(C))
    correlation = C / deviation / deviation[:, None] + ROUNDING * np.eye(len(C))
    U = deviation[:, None] * np.linalg.cholesky(correlation[::-1, ::-1])[::-1, ::-1]
    return np.asarray(solve_triangular(U, np.eye(len(C)), check_finite=False))


def prior_information(cell: Cell) -> Information:
    """What drawing and tolerances say of a cell; raises InputError if base or tool stand nowhere yet."""
    for name, pose in (("base", cell.base), ("tool", cell.tool)):
        if pose is None:
            raise InputError(
                f"{name}: fit says nothing about the place of the {name}, and touches cannot be planned for a robot "
                "that may be anywhere; write its nominal pose in cell.yaml, or give an earlier calibration with --after"
            )
    return Information.prior(replace(Unknowns.of(cell), named=()))


def map_step(
    residual: Float[np.ndarray, " rows"],
    J: Float[np.ndarray, "rows parameters"],
    sigma: Float[np.ndarray, " rows"],
    offset: Float[np.ndarray, " parameters"],
    prior: Float[np.ndarray, " parameters"],
) -> tuple[Float[np.ndarray, " parameters"], Float[np.ndarray, "parameters parameters"]]:
    """The Gauss-Newton step to the most probable parameters, and their precision, both in units of the `prior`.

    `offset` is what the parameters lie beside the middle of the prior now.
    """
    W = J * prior / sigma[:, None]
    M = W.T @ W + np.eye(len(prior))
    return np.linalg.solve(M, -offset / prior - W.T @ (residual / sigma)), M
