"""Criteria of the eigenvalues of the information: concave functions, with derivatives, behind published indices."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from jaxtyping import Float

from oed.criteria.criterion import Batch, Criterion, FunctionCriterion, Rows, Squares
from oed.criteria.swaps import DeterminantSwaps, Square, Swaps

ROUNDING = 1e-15  # of the largest eigenvalue
SHARPEST = 512.0  # exponent of a power mean that stands for the least eigenvalue, or the largest variance
GENTLE = 8.0  # exponent where a direction is asked for and not a bound


@dataclass(frozen=True, eq=False)
class EigenvalueCriterion(FunctionCriterion):
    """A function of the singular values of the rows, in descending order."""

    back: Square | None = None  # rows in the units that came in are X back

    def numbers(self, M: Squares) -> Float[np.ndarray, "*batch p"]:
        """Eigenvalues, in ascending order; zero where they are rounding."""
        eigenvalues = np.linalg.eigvalsh(M if self.back is None else self.back.T @ M @ self.back)
        return np.where(eigenvalues > ROUNDING * eigenvalues[..., -1:], eigenvalues, 0.0)

    def at(self, numbers: Float[np.ndarray, "*batch p"]) -> Batch:
        """The function of singular values."""
        return self.function(np.sqrt(np.sort(numbers, axis=-1)[..., ::-1]))

    def along(self, M: Square, rates: Callable[[Float[np.ndarray, " p"]], Float[np.ndarray, " p"]]) -> Square:
        """V diag(rates / eigenvalues) V'."""
        eigenvalues, V = self._eigen(M)
        return (V * (rates(eigenvalues) / eigenvalues)) @ V.T

    def in_basis(self, T: Square) -> Self:
        """Eigenvalues stay those of the information in the units that came in."""
        back = np.linalg.inv(T)
        return replace(self, back=back if self.back is None else back @ self.back)

    def basis(self, T: Square) -> Square:
        """Eigenvalues allow no more than a change of unit."""
        return np.eye(len(T)) * np.exp(np.linalg.slogdet(T)[1] / len(T))

    def _eigen(self, M: Square) -> tuple[Float[np.ndarray, " p"], Square]:
        """Eigenvalues, and the directions V with x' V V' x the size of a row."""
        if self.back is None:
            return np.linalg.eigh(M)
        eigenvalues, V = np.linalg.eigh(self.back.T @ M @ self.back)
        return eigenvalues, self.back @ V


@dataclass(frozen=True, eq=False)
class GeometricMean(EigenvalueCriterion):
    """phi = det(M)^(1/p)."""

    per_touch: ClassVar[bool] = True
    formula: ClassVar[type[Swaps]] = DeterminantSwaps

    def log(self, M: Square) -> float:
        """Log det over the number of parameters."""
        sign, logdet = np.linalg.slogdet(M)
        return self._unit + float(logdet) / len(M) if sign > 0 else -np.inf

    def slope(self, M: Square) -> Square:
        """M^-1 / p."""
        return np.linalg.inv(M) / len(M)

    def curvature(self, M: Square, X: Rows) -> Float[np.ndarray, "k k"]:
        """Squared covariances of the touches, over p."""
        return (X @ np.linalg.inv(M) @ X.T) ** 2 / len(M)

    def basis(self, T: Square) -> Square:
        """Any: a determinant changes by a factor."""
        return T

    @cached_property
    def _unit(self) -> float:
        """`log` of the identity, in the units that came in."""
        return 0.0 if self.back is None else 2 * float(np.linalg.slogdet(self.back)[1]) / len(self.back)


@dataclass(frozen=True, eq=False)
class PowerMean(EigenvalueCriterion):
    """phi = (sum of eigenvalue^-q)^(-1/q), Kiefer's matrix mean but for a factor; O5 is that of q = 1/2."""

    exponent: float = 0.5

    def __post_init__(self) -> None:
        """Raise ValueError if the function is not the mean of this order: its bound would be that of another one."""
        samples = np.array([[1.0, 2.0, 5.0], [0.1, 3.0, 4.0]])
        if type(self) is PowerMean and self.back is None:
            first, second = (float(self.power(self.at(x))) - self.smooth(np.diag(x)) for x in samples)
            if abs(first - second) > 1e-9:
                raise ValueError(
                    f"{self.name}: its function is no power mean of the eigenvalues of order {self.exponent:g} to the "
                    f"power of {self.degree:g}; correct the function, its degree or its exponent"
                )

    def smooth(self, M: Square) -> float:
        """Logarithm of the sum, to the power of -1/q."""
        eigenvalues = self.numbers(M)
        if eigenvalues[0] <= 0:
            return -np.inf
        ratio = np.log(eigenvalues / eigenvalues[0])
        return float(np.log(eigenvalues[0]) - np.log(np.sum(np.exp(-self.exponent * ratio))) / self.exponent)

    def slope(self, M: Square) -> Square:
        """M^-(q+1) / tr(M^-q)."""
        return self.along(M, lambda eigenvalues: (share := self._powers(eigenvalues)) / share.sum())

    def curvature(self, M: Square, X: Rows) -> Float[np.ndarray, "k k"]:
        """Divided differences of eigenvalue^-(q+1) (Daleckii and Krein), minus q times the square of the gradient."""
        q = self.exponent
        eigenvalues, V = self._eigen(M)
        share = self._powers(eigenvalues)
        Z = X @ V
        i, j = np.triu_indices(len(M))
        low, gap = eigenvalues[i], np.log(eigenvalues[j] / eigenvalues[i])
        close = gap < 1e-9
        wide = np.where(close, 1, gap)
        divided = np.where(close, q + 1, -np.expm1(-(q + 1) * wide) / np.expm1(wide)) * share[i] / low**2
        U = Z[:, i] * Z[:, j] * np.sqrt(divided * np.where(i == j, 1, 2) / share.sum())
        gradient = (Z**2) @ (share / share.sum() / eigenvalues)
        return U @ U.T - q * np.multiply.outer(gradient, gradient)

    def _powers(self, eigenvalues: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
        """eigenvalue^-q, in units of the largest of them."""
        return np.exp(-self.exponent * np.log(eigenvalues / eigenvalues[0]))


@dataclass(frozen=True, eq=False)
class Smallest(PowerMean):
    """phi = the smallest eigenvalue, by way of power means of growing exponent."""

    exponent: float = GENTLE

    def support(self, M: Square) -> Square:
        """The smallest eigenvalue is the least mean over directions, so every mean over directions bounds it."""
        S = self.slope(M)
        return S / np.trace(S if self.back is None else np.linalg.solve(self.back, np.linalg.solve(self.back, S).T))

    def sharpened(self) -> Iterator[Self]:
        """Power means of growing exponent."""
        exponent = 2.0
        while exponent <= SHARPEST:
            yield replace(self, exponent=exponent)
            exponent *= 4


@dataclass(frozen=True, eq=False)
class Conditioning(EigenvalueCriterion):
    """A function of the smallest and the largest eigenvalue that is not concave: the best weights are those of E."""

    certified: ClassVar[bool] = False

    @property
    def relaxed(self) -> Criterion:
        """The smallest eigenvalue."""
        return Smallest("E", 1.0, "rotation", self.source, lambda sigma: sigma[..., -1] ** 2, self.back)

    def slope(self, M: Square) -> Square:
        """The blurred one."""
        return self.blurred_slope(M, self.blurs[0])

    def curvature(self, M: Square, X: Rows) -> Float[np.ndarray, "k k"]:
        """That of the smallest eigenvalue."""
        return self.relaxed.curvature(M, X)
