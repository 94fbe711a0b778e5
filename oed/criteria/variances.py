"""Criteria of predicted variances, tr(J M^-1 J') at every pose: of the tip in the weld zone, or of all parameters."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from jaxtyping import Float

from oed.criteria.criterion import Batch, FunctionCriterion, Rows, Squares
from oed.criteria.eigenvalues import GENTLE, SHARPEST
from oed.criteria.swaps import Square, Swaps, TraceSwaps

UNSEEN = 1e-6  # of the zone's tip rows, in a direction that no row sees: none
Poses = Float[np.ndarray, "poses axes p"]


@dataclass(frozen=True, eq=False)
class VarianceCriterion(FunctionCriterion):
    """A function of the variances at the poses of a zone."""

    J: Poses | None = None  # how the tip moves there with the parameters
    needs_zone: ClassVar[bool] = True
    moments: ClassVar[bool] = False  # whether the mean over the poses of J'J says all

    def on(self, zone: np.ndarray | None, parameters: int) -> Self:
        """The criterion for the poses of a zone: (poses, axes, parameters), or a matrix of their moments."""
        if zone is None and self.J is not None and self.J.shape[2] == parameters:
            return self
        if zone is None:
            raise ValueError(f"criterion '{self.name}' scores the weld zone; give `zone`, its whitened tip Jacobians")
        zone = np.asarray(zone, dtype=float)
        if zone.shape == (parameters, parameters):
            if not self.moments:
                raise ValueError(f"criterion '{self.name}' needs every pose of the zone, not their moment matrix")
            eigenvalues, V = np.linalg.eigh(zone)
            zone = (np.sqrt(np.maximum(eigenvalues, 0))[:, None] * V.T)[None]
        if zone.ndim != 3 or zone.shape[2] != parameters or not np.isfinite(zone).all():
            raise ValueError(f"zone: shape {zone.shape}, expected finite numbers of shape (poses, 3, {parameters})")
        return replace(self, J=zone)

    @property
    def poses(self) -> Poses:
        """The Jacobians at the poses."""
        assert self.J is not None, f"criterion '{self.name}' is not yet that of a zone"
        return self.J

    def numbers(self, M: Squares) -> Float[np.ndarray, "*batch poses"]:
        """Variances at every pose of the zone [mm^2], infinite where M is singular."""
        eigenvalues, V = np.linalg.eigh(M)
        spread = (self.poses.reshape(-1, self.poses.shape[-1]) @ V) ** 2  # (*batch, poses * axes, p)
        spread = spread.reshape(*M.shape[:-2], *self.poses.shape).sum(axis=-2)
        inverse = np.where(eigenvalues > 0, 1 / np.where(eigenvalues > 0, eigenvalues, 1), np.inf)
        return (spread @ inverse[..., None])[..., 0]

    def at(self, numbers: Float[np.ndarray, "*batch poses"]) -> Batch:
        """The function of variances."""
        return self.function(numbers)

    def along(self, M: Square, rates: Callable[[Float[np.ndarray, " poses"]], Float[np.ndarray, " poses"]]) -> Square:
        """C W C, W the moment matrices of the poses, each by how fast the function falls with its variance."""
        t, JC = self._variances(M)
        F = (JC * np.sqrt(np.maximum(-rates(t), 0) / t)[:, None, None]).reshape(-1, JC.shape[-1])
        return F.T @ F

    def in_basis(self, T: Float[np.ndarray, "p q"]) -> Self:
        """The zone changes along with the rows."""
        return replace(self, J=self.poses @ T)

    def needs(self, unseen_space: Float[np.ndarray, "p u"], seen_space: Float[np.ndarray, "p s"]) -> bool:
        """Whether the tip in the zone moves along directions that no row sees."""
        return bool(
            np.abs(self.poses @ unseen_space).max(initial=0.0)
            >= UNSEEN * np.abs(self.poses @ seen_space).max(initial=0.0)
        )

    def logs_after(
        self, M: Square, x: Float[np.ndarray, "k p"], y: Float[np.ndarray, "k p"]
    ) -> Float[np.ndarray, " k"]:
        """By the formula of the trace, for every pose."""
        C, J = np.linalg.inv(M), self.poses.reshape(-1, len(M)).T
        shape = (len(x), *self.poses.shape[:2])
        Cx, Cy = x @ C, y @ C
        Zx, Zy = (Cx @ J).reshape(shape), (Cy @ J).reshape(shape)
        xx, yy, xy = (np.einsum("ij,ij->i", u, w)[:, None] for u, w in ((Cx, x), (Cy, y), (Cx, y)))
        before = np.sum((self.poses @ C) * self.poses, axis=(1, 2))
        fall = (1 - xx) * (Zy**2).sum(axis=2) + 2 * xy * (Zx * Zy).sum(axis=2) - (1 + yy) * (Zx**2).sum(axis=2)
        return self.power(self.at(before - fall / ((1 + yy) * (1 - xx) + xy**2)))

    def _variances(self, M: Square) -> tuple[Float[np.ndarray, " poses"], Poses]:
        """Variance at every pose, and J M^-1."""
        JC = self.poses @ np.linalg.inv(M)
        return np.sum(JC * self.poses, axis=(1, 2)), JC


@dataclass(frozen=True, eq=False)
class MeanVariance(VarianceCriterion):
    """phi = 1 / tr(W M^-1), W the mean moment matrix of the poses."""

    moments: ClassVar[bool] = True
    formula: ClassVar[type[Swaps]] = TraceSwaps

    @cached_property
    def W(self) -> Square:
        """With which the trace is the mean variance."""
        F = self.poses.reshape(-1, self.poses.shape[-1]) / np.sqrt(len(self.poses))
        return F.T @ F

    @cached_property
    def K(self) -> Float[np.ndarray, "rows p"]:
        """A root of W, K' K = W."""
        return np.linalg.qr(self.poses.reshape(-1, self.poses.shape[-1]), "r") / np.sqrt(len(self.poses))

    def log(self, M: Square) -> float:
        """Minus the logarithm of the trace; minus infinity where M is singular."""
        try:
            trace = float(np.sum(self.K * np.linalg.solve(M, self.K.T).T))
        except np.linalg.LinAlgError:
            return -np.inf
        return -float(np.log(trace)) if trace > 0 else -np.inf

    def slope(self, M: Square) -> Square:
        """M^-1 W M^-1 over the trace."""
        KC = self.K @ np.linalg.inv(M)
        return KC.T @ KC / np.sum(KC * self.K)

    def curvature(self, M: Square, X: Rows) -> Float[np.ndarray, "k k"]:
        """2 (x' C x') (x' C W C x') over the trace, minus the square of the gradient."""
        B = X @ self.slope(M) @ X.T
        return 2 * (X @ np.linalg.inv(M) @ X.T) * B - np.multiply.outer(np.diag(B), np.diag(B))


@dataclass(frozen=True, eq=False)
class ParameterVariance(MeanVariance):
    """The variances of the parameters themselves, each as good as a pose of a zone."""

    needs_zone: ClassVar[bool] = False

    def on(self, zone: np.ndarray | None, parameters: int) -> Self:
        """One pose, at which every parameter is an axis."""
        return replace(self, J=np.eye(parameters)[None])


@dataclass(frozen=True, eq=False)
class LargestVariance(VarianceCriterion):
    """phi = 1 / max over poses of their variance, by way of norms of growing exponent over the poses."""

    exponent: float = GENTLE

    def smooth(self, M: Square) -> float:
        """Minus the logarithm of the norm."""
        t, _ = self._variances(M)
        return -float(np.log(t.max()) + np.log(np.sum(np.exp(self.exponent * np.log(t / t.max())))) / self.exponent)

    def slope(self, M: Square) -> Square:
        """M^-1 W M^-1, W the mean of the poses' moment matrices over their variances."""
        return self.along(M, lambda t: -self._shares(t))

    def curvature(self, M: Square, X: Rows) -> Float[np.ndarray, "k k"]:
        """That of a trace, and (r - 1) times the spread of the poses' gradients."""
        t, JC = self._variances(M)
        share = self._shares(t)
        pull = np.sum((JC @ X.T) ** 2, axis=1) / t[:, None]  # how a touch lowers log t, pose by touch
        B = X @ self.slope(M) @ X.T
        gradient = np.diag(B)
        spread = (pull.T * share) @ pull - np.multiply.outer(gradient, gradient)
        bend = 2 * (X @ np.linalg.inv(M) @ X.T) * B - np.multiply.outer(gradient, gradient)
        return bend + (self.exponent - 1) * spread

    def support(self, M: Square) -> Square:
        """A mean over poses is no worse than the worst pose, and 1 / mean is bounded by its tangent."""
        t, JC = self._variances(M)
        share = self._shares(t) / t
        share /= share.sum()
        F = (JC * np.sqrt(share)[:, None, None]).reshape(-1, JC.shape[-1])
        return F.T @ F / float(share @ t) ** 2

    def sharpened(self) -> Iterator[Self]:
        """Norms of growing exponent."""
        exponent = 2.0
        while exponent <= SHARPEST:
            yield replace(self, exponent=exponent)
            exponent *= 4

    def _shares(self, t: Float[np.ndarray, " poses"]) -> Float[np.ndarray, " poses"]:
        """How much each pose counts: the worst ones, more so with a larger exponent."""
        share = np.exp(self.exponent * np.log(t / t.max()))
        return share / share.sum()
