"""Swaps for a criterion without a formula of its own: a trace that touches it ranks them, the best are computed.

The gradient S of the logarithm of the criterion gives W = M S M, and the fall of tr(W C) is what a swap gains to first
order. A criterion with kinks, such as the smallest eigenvalue or the worst pose, has its gradient averaged over a small
neighbourhood, then over wider ones as long as no swap helps.
"""

import numpy as np
from jaxtyping import Float

from oed.criteria.criteria import Criterion, checked_zone, score
from oed.design.constraints import Members
from oed.design.swaps import NEVER, Precision, Square, Swaps, Table

BLURS = (0.05, 0.2, 0.6)  # relative spread of the neighbourhoods
SAMPLES = 16  # points in each
FEW = 16  # swaps that are computed
STEP = 1e-5  # of the finite differences, relative


class ScreenedSwaps(Swaps):
    """Any criterion of the table."""

    def __init__(
        self, rows: Float[np.ndarray, "pool p"], known: Square, basis: Square, criterion: Criterion,
        zone: np.ndarray | None, rng: np.random.Generator, precision: Precision = np.float32,
    ):  # fmt: skip
        super().__init__(rows, known, precision)
        self.criterion = criterion
        self.back = np.linalg.inv(basis)  # information in the units that came in is back' M back
        self.tip = checked_zone(criterion, zone, len(basis)) @ basis if criterion.needs_zone else None
        self.draws = rng.standard_normal((SAMPLES, len(basis) if self.tip is None else len(self.tip)))
        self.blur = 0

    def _log_of(self, value: np.ndarray) -> np.ndarray:
        with np.errstate(divide="ignore"):
            return np.log(value) / (self.criterion.degree or 1.0)

    def _logs(self, values: Float[np.ndarray, "*batch k"]) -> np.ndarray:
        """Logarithm of the criterion for eigenvalues of the information, or for tip variances."""
        if self.tip is None:
            values = np.sqrt(np.maximum(np.sort(values, axis=-1)[..., ::-1], 0))
        with np.errstate(divide="ignore"):
            return self._log_of(self.criterion.function(values))

    def log(self, members: Members) -> float:
        """Logarithm of the criterion, by the table itself."""
        M = self.back.T @ self.information(members) @ self.back
        return float(self._log_of(score(self.criterion, M, 1, self.tip @ self.back if self.tip is not None else None)))

    def weight(self, M: Square) -> Square | None:
        """W = M S M, S the blurred gradient of the logarithm."""
        if self.tip is not None:
            t = np.sum((self.tip @ np.linalg.inv(M)) * self.tip, axis=(1, 2))
            pull = np.sqrt(np.maximum(-self._slopes(t), 0) / t)
            F = (self.tip * pull[:, None, None]).reshape(-1, len(M))
            return F.T @ F
        eigenvalues, V = np.linalg.eigh(self.back.T @ M @ self.back)
        F = M @ self.back @ V
        return (F * (self._slopes(eigenvalues) / eigenvalues)) @ F.T

    def _slopes(self, at: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Derivatives of the logarithm by the logarithms of what the criterion is a function of."""
        total, bump = np.zeros(len(at)), 1 + STEP * np.eye(len(at))
        for point in at * np.exp(BLURS[self.blur] * self.draws):
            total += self._logs(point * bump) - self._logs(point)
        return total / (STEP * SAMPLES)

    def load(self, members: Members) -> None:
        """Begin again with the smallest neighbourhood."""
        super().load(members)
        self.blur = 0

    def look_wider(self) -> bool:
        """The next neighbourhood, if there is one."""
        self.blur = (self.blur + 1) % len(BLURS)
        return self.blur > 0

    def table(self) -> Table:
        """First-order gain in logarithm of every swap."""
        M, X = self.information(self.members), self.low[self.members]
        W, C = self.weight(M), np.linalg.inv(M)
        B = (C @ W @ C).astype(self.precision)
        C = C.astype(self.precision)
        CY, BY = C @ self.low_t, B @ self.low_t
        d, b = np.einsum("ij,ij->j", self.low_t, CY), np.einsum("ij,ij->j", self.low_t, BY)
        G, falls = X @ CY, X @ BY
        left = np.maximum(1 - d[self.members], 1e-6)[:, None]
        falls *= 2 * G
        falls += left * b - b[self.members][:, None] * (1 + d)
        falls /= G * G + left * (1 + d)
        return falls

    def growth(self, table: Table) -> Table:
        """The table itself."""
        return table

    def best(self, table: Table) -> tuple[int, int, float]:
        """The best of the most promising swaps, with its true factor."""
        few = min(FEW, table.size)
        picked = np.argpartition(-table, few - 1, axis=None)[:few]
        picked = picked[table.ravel()[picked] > NEVER]
        if not len(picked):
            return 0, 0, 0.0
        a, j = np.divmod(picked, table.shape[1])
        M, x, y = self.information(self.members), self.rows[self.members[a]], self.rows[j]
        if self.tip is None:
            swapped = M - x[:, :, None] * x[:, None, :] + y[:, :, None] * y[:, None, :]
            logs = self._logs(np.linalg.eigvalsh(self.back.T @ swapped @ self.back))
        else:
            logs = self._logs(self._variances(np.linalg.inv(M), x, y))
        k = int(np.argmax(logs))
        return int(a[k]), int(j[k]), float(np.exp(logs[k] - self.log(self.members)))

    def _variances(
        self, C: Square, x: Float[np.ndarray, "k p"], y: Float[np.ndarray, "k p"]
    ) -> Float[np.ndarray, "k poses"]:
        """Tip variances at every pose after each of some swaps, by the formula of the trace."""
        assert self.tip is not None
        J = self.tip.reshape(-1, len(C)).T
        shape = (len(x), *self.tip.shape[:2])
        Cx, Cy = x @ C, y @ C
        Zx, Zy = (Cx @ J).reshape(shape), (Cy @ J).reshape(shape)
        xx, yy, xy = (np.einsum("ij,ij->i", u, w)[:, None] for u, w in ((Cx, x), (Cy, y), (Cx, y)))
        before = np.sum((self.tip @ C) * self.tip, axis=(1, 2))
        fall = (1 - xx) * (Zy**2).sum(axis=2) + 2 * xy * (Zx * Zy).sum(axis=2) - (1 + yy) * (Zx**2).sum(axis=2)
        return before - fall / ((1 + yy) * (1 - xx) + xy**2)
