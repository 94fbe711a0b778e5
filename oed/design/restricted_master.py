"""The restricted master: best weights of a few hundred touches, by a primal-dual interior point method."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from oed.criteria.criterion import Criterion

TO_BOUNDARY = 0.95  # share of the way to the nearest limit that a step may go
SHRINK = 0.1  # of the barrier from one Newton step to the next
STEPS = 80


@dataclass(frozen=True, eq=False)
class Master:
    """Maximise objective.smooth(base + X' diag(w) X) over weights w >= 0 with sum one, caps and shares."""

    objective: Criterion
    X: Float[np.ndarray, "rows p"]
    base: Float[np.ndarray, "p p"]
    capped: Int[np.ndarray, " capped"]  # which columns have a cap, and the cap
    cap: Float[np.ndarray, " capped"]
    shared: Float[np.ndarray, "shares k"]  # 1 where a column is of a face with a limit below or above
    low: Float[np.ndarray, " shares"]
    high: Float[np.ndarray, " shares"]
    owner: Int[np.ndarray, " rows"] | None = None  # the weight of each row of X; None: each has its own

    def information(self, w: Float[np.ndarray, " k"]) -> Float[np.ndarray, "p p"]:
        """Information of the weights."""
        return self.base + (self.X.T * (w if self.owner is None else w[self.owner])) @ self.X

    def _by_weight(self, of_rows: np.ndarray) -> np.ndarray:
        """Sums over the rows of each weight, along every axis."""
        if self.owner is None:
            return of_rows
        first = np.flatnonzero(np.diff(self.owner, prepend=-1))
        for axis in range(of_rows.ndim):
            of_rows = np.add.reduceat(of_rows, first, axis=axis)
        return of_rows

    def distances(self, w: Float[np.ndarray, " k"]) -> Float[np.ndarray, " limits"]:
        """How far the weights are from every limit."""
        share = self.shared @ w
        return np.concatenate([w, self.cap - w[self.capped], share - self.low, self.high - share])

    def _rates(self, dw: Float[np.ndarray, " k"]) -> Float[np.ndarray, " limits"]:
        """How a step changes the distances."""
        share = self.shared @ dw
        return np.concatenate([dw, -dw[self.capped], share, -share])

    def _pulled(self, u: Float[np.ndarray, " limits"]) -> Float[np.ndarray, " k"]:
        """Transpose of `_rates`."""
        w, cap, low, high = self._parts(u)
        out = w + (low - high) @ self.shared
        out[self.capped] -= cap
        return out

    def _parts(self, u: Float[np.ndarray, " limits"]) -> list[Float[np.ndarray, " some"]]:
        """One number per limit, as numbers per weight, cap, low and high share."""
        count = len(self.X) if self.owner is None else int(self.owner[-1]) + 1
        ends = np.cumsum([count, len(self.cap), len(self.low)])
        return np.split(u, ends)

    def _merit(self, w: Float[np.ndarray, " k"], distances: Float[np.ndarray, " limits"], barrier: float) -> float:
        return self.objective.smooth(self.information(w)) + barrier * float(np.log(distances).sum())

    def _direction(
        self,
        w: Float[np.ndarray, " k"],
        s: Float[np.ndarray, " limits"],
        z: Float[np.ndarray, " limits"],
        barrier: float,
    ) -> tuple[Float[np.ndarray, " k"], float]:
        """Newton step of the barrier problem along sum(w) = 1, and how much it promises."""
        M = self.information(w)
        K = self._by_weight(self.objective.curvature(M, self.X))
        weight, cap, low, high = self._parts(z / s)
        weight[self.capped] += cap
        K[np.diag_indices(len(w))] += weight
        K += (self.shared.T * (low + high)) @ self.shared
        gains = np.einsum("ij,ij->i", self.X @ self.objective.slope(M), self.X)
        gradient = self._by_weight(gains) + self._pulled(barrier / s)
        step, unit = np.linalg.solve(K, np.stack([gradient, np.ones(len(w))], axis=1)).T
        dw = step - unit * (step.sum() / unit.sum())
        return dw, float(gradient @ dw)

    def solve(self, w: Float[np.ndarray, " k"], target: float, start: float) -> Float[np.ndarray, " k"]:
        """Weights at the barrier `target`, coming down from `start`; the duality gap is about target * limits."""
        barrier = max(start, target)
        s = self.distances(w)
        z = barrier / s
        for _ in range(STEPS):
            dw, promise = self._direction(w, s, z, barrier)
            ds = self._rates(dw)
            length = min(1.0, TO_BOUNDARY / max(1e-300, float((-ds / s).max())))
            before = self._merit(w, s, barrier)
            while (
                length > 1e-6
                and self._merit(w + length * dw, s + length * ds, barrier) < before + 1e-4 * length * promise - 1e-13
            ):
                length /= 2
            dz = barrier / s - z - z / s * ds
            z = z + min(1.0, TO_BOUNDARY / max(1e-300, float((-dz / z).max()))) * dz
            w = w + length * dw
            w /= w.sum()
            s = self.distances(w)
            if barrier <= target and promise < barrier:
                break
            if length > 0.3:
                barrier = max(target, barrier * SHRINK)
        return w
