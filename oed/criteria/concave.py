"""Concave functions of the information that certify a design.

Each phi is concave and homogeneous of degree one, so a supporting matrix S at M gives phi(M') <= tr(S M') for every M'
there is: that is the whole certificate (Kiefer and Wolfowitz 1960; Pukelsheim 1993). `log`, `slope` and `curvature`
drive the interior point; for the smallest eigenvalue and the worst pose, which have kinks, they belong to a smooth
stand-in that is sharpened by its `exponent`, while `support` stays valid for the criterion itself.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

Square = Float[np.ndarray, "p p"]


class Concave(Protocol):
    """What the relaxation needs of a criterion."""

    def log(self, M: Square) -> float:
        """Logarithm of the smooth function; minus infinity where M is singular."""

    def slope(self, M: Square) -> Square:
        """Gradient of `log`: a touch x raises it by x' slope x per unit of weight."""

    def curvature(self, M: Square, X: Float[np.ndarray, "k p"]) -> Float[np.ndarray, "k k"]:
        """Minus the Hessian of `log` in the weights of the touches X."""

    def support(self, M: Square) -> tuple[float, Square]:
        """The criterion phi(M), and an S with phi(M') <= tr(S M') for every M'."""


@dataclass(frozen=True)
class Determinant:
    """det(M)^(1/p)."""

    def log(self, M: Square) -> float:
        """Logarithm of the function."""
        sign, logdet = np.linalg.slogdet(M)
        return float(logdet) / len(M) if sign > 0 else -np.inf

    def slope(self, M: Square) -> Square:
        """M^-1 / p."""
        return np.linalg.inv(M) / len(M)

    def curvature(self, M: Square, X: Float[np.ndarray, "k p"]) -> Float[np.ndarray, "k k"]:
        """Squared covariances of the touches, over p."""
        return (X @ np.linalg.inv(M) @ X.T) ** 2 / len(M)

    def support(self, M: Square) -> tuple[float, Square]:
        """The arithmetic mean of the eigenvalues of M^-1 M' bounds their geometric mean."""
        phi = float(np.exp(self.log(M)))
        return phi, phi * self.slope(M)


@dataclass(frozen=True)
class Trace:
    """1 / tr(W M^-1), W = K' K."""

    K: Float[np.ndarray, "rows p"]

    def log(self, M: Square) -> float:
        """Logarithm of the function."""
        return -float(np.log(np.sum(self.K * np.linalg.solve(M, self.K.T).T)))

    def slope(self, M: Square) -> Square:
        """M^-1 W M^-1 over the trace."""
        KC = self.K @ np.linalg.inv(M)
        return KC.T @ KC / np.sum(KC * self.K)

    def curvature(self, M: Square, X: Float[np.ndarray, "k p"]) -> Float[np.ndarray, "k k"]:
        """2 (x' C x') (x' C W C x') over the trace, minus the square of the gradient."""
        B = X @ self.slope(M) @ X.T
        return 2 * (X @ np.linalg.inv(M) @ X.T) * B - np.multiply.outer(np.diag(B), np.diag(B))

    def support(self, M: Square) -> tuple[float, Square]:
        """1 / trace is concave and homogeneous, so its tangent bounds it."""
        phi = float(np.exp(self.log(M)))
        return phi, phi * self.slope(M)


@dataclass(frozen=True)
class Power:
    """(mean of eigenvalue^-q)^(-1/q), Kiefer's matrix mean; with q = 1/2 it orders designs as O5 does."""

    exponent: float

    def log(self, M: Square) -> float:
        """Logarithm of the function."""
        eigenvalues = np.linalg.eigvalsh(M)
        if eigenvalues[0] <= 0:
            return -np.inf
        ratio = np.log(eigenvalues / eigenvalues[0])
        return float(np.log(eigenvalues[0]) - np.log(np.mean(np.exp(-self.exponent * ratio))) / self.exponent)

    def slope(self, M: Square) -> Square:
        """M^-(q+1) / tr(M^-q)."""
        eigenvalues, V = np.linalg.eigh(M)
        share = np.exp(-self.exponent * np.log(eigenvalues / eigenvalues[0]))
        return (V * (share / share.sum() / eigenvalues)) @ V.T

    def curvature(self, M: Square, X: Float[np.ndarray, "k p"]) -> Float[np.ndarray, "k k"]:
        """Divided differences of eigenvalue^-(q+1) (Daleckii and Krein), minus q times the square of the gradient."""
        q = self.exponent
        eigenvalues, V = np.linalg.eigh(M)
        share = np.exp(-q * np.log(eigenvalues / eigenvalues[0]))
        Z = X @ V
        i, j = np.triu_indices(len(M))
        low, gap = eigenvalues[i], np.log(eigenvalues[j] / eigenvalues[i])
        close = gap < 1e-9
        wide = np.where(close, 1, gap)
        divided = np.where(close, q + 1, -np.expm1(-(q + 1) * wide) / np.expm1(wide)) * share[i] / low**2
        U = Z[:, i] * Z[:, j] * np.sqrt(divided * np.where(i == j, 1, 2) / share.sum())
        gradient = (Z**2) @ (share / share.sum() / eigenvalues)
        return U @ U.T - q * np.multiply.outer(gradient, gradient)

    def support(self, M: Square) -> tuple[float, Square]:
        """The tangent, as for the trace."""
        phi = float(np.exp(self.log(M)))
        return phi, phi * self.slope(M)


@dataclass(frozen=True)
class Smallest(Power):
    """Smallest eigenvalue; any S with trace 1 bounds it, and the slope of the matrix mean is a good one."""

    def support(self, M: Square) -> tuple[float, Square]:
        """The smallest eigenvalue is the least mean over directions, so every mean over directions bounds it."""
        S = self.slope(M)
        return float(np.linalg.eigvalsh(M)[0]), S / np.trace(S)


@dataclass(frozen=True)
class Worst:
    """1 / max over poses of tr(J M^-1 J'), by way of the r-norm over the poses."""

    J: Float[np.ndarray, "poses axes p"]
    exponent: float

    def _variances(self, M: Square) -> tuple[Float[np.ndarray, " poses"], Float[np.ndarray, "poses axes p"]]:
        """Tip variance of every pose, and J M^-1."""
        JC = self.J @ np.linalg.inv(M)
        return np.sum(JC * self.J, axis=(1, 2)), JC

    def _shares(self, t: Float[np.ndarray, " poses"]) -> Float[np.ndarray, " poses"]:
        """How much each pose counts: the worst ones, more so with a larger exponent."""
        share = np.exp(self.exponent * np.log(t / t.max()))
        return share / share.sum()

    def log(self, M: Square) -> float:
        """Logarithm of the function."""
        t, _ = self._variances(M)
        return -float(np.log(t.max()) + np.log(np.sum(np.exp(self.exponent * np.log(t / t.max())))) / self.exponent)

    def slope(self, M: Square) -> Square:
        """M^-1 W M^-1, W the mean of the poses' moment matrices over their variances."""
        t, JC = self._variances(M)
        F = (JC * np.sqrt(self._shares(t) / t)[:, None, None]).reshape(-1, JC.shape[-1])
        return F.T @ F

    def curvature(self, M: Square, X: Float[np.ndarray, "k p"]) -> Float[np.ndarray, "k k"]:
        """That of a trace, and (r - 1) times the spread of the poses' gradients."""
        t, JC = self._variances(M)
        share = self._shares(t)
        pull = np.sum((JC @ X.T) ** 2, axis=1) / t[:, None]  # how a touch lowers log t, pose by touch
        B = X @ self.slope(M) @ X.T
        gradient = np.diag(B)
        spread = (pull.T * share) @ pull - np.multiply.outer(gradient, gradient)
        bend = 2 * (X @ np.linalg.inv(M) @ X.T) * B - np.multiply.outer(gradient, gradient)
        return bend + (self.exponent - 1) * spread

    def support(self, M: Square) -> tuple[float, Square]:
        """A mean over poses is no worse than the worst pose, and 1 / mean is bounded by its tangent."""
        t, JC = self._variances(M)
        share = self._shares(t) / t
        share /= share.sum()
        F = (JC * np.sqrt(share)[:, None, None]).reshape(-1, JC.shape[-1])
        return float(1 / t.max()), F.T @ F / float(share @ t) ** 2
