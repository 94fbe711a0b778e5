"""Swaps for a criterion without a formula of its own: ranked to first order, and the best of them computed.

With S the gradient of the logarithm of the criterion, the trace that touches it falls by x'Sx / (1 + x'Cx) with a
touch x. A criterion with kinks, such as the smallest eigenvalue or the worst pose, has its gradient averaged over a
small neighbourhood, then over wider ones as long as no swap helps.
"""

import numpy as np
from jaxtyping import Int

from oed.criteria.swaps import NEVER, Members, Square, Swaps, Table

FEW = 16  # swaps that are computed


class FirstOrderSwaps(Swaps):
    """Any criterion."""

    exact = False
    blur = 0  # which of the criterion's neighbourhoods is looked at

    def slope(self, M: Square) -> Square:
        """The gradient, blurred."""
        slope: Square = self.criterion.blurred_slope(M, self.criterion.blurs[self.blur])
        return slope

    def load(self, members: Members) -> None:
        """Begin again with the smallest neighbourhood."""
        super().load(members)
        self.blur = 0

    def look_wider(self) -> bool:
        """The next neighbourhood, if there is one."""
        self.blur = (self.blur + 1) % len(self.criterion.blurs)
        return self.blur > 0

    def table(self) -> Table:
        """First-order gain in logarithm of every swap."""
        M, X = self.information(self.members), self.low[self.members]
        B, C = (Q.astype(self.precision) for Q in (self.slope(M), np.linalg.inv(M)))
        CY, BY = C @ self.low_t, B @ self.low_t
        d, b = np.einsum("ij,ij->j", self.low_t, CY), np.einsum("ij,ij->j", self.low_t, BY)
        G, falls = X @ CY, X @ BY
        room = np.maximum(1 - d[self.members], 1e-6)[:, None]
        falls *= 2 * G
        falls += room * b - b[self.members][:, None] * (1 + d)
        falls /= G * G + room * (1 + d)
        return falls

    def growth(self, table: Table) -> Table:
        """The table itself."""
        return table

    def best(self, table: Table) -> tuple[int, int, float]:
        """The best of the most promising swaps, with its true factor."""
        a, j = promising(table)
        if not len(a):
            return 0, 0, 0.0
        logs = self.logs_after(a, j)
        k = int(np.argmax(logs))
        return int(a[k]), int(j[k]), float(np.exp(logs[k] - self.log(self.members)))


def promising(table: Table) -> tuple[Int[np.ndarray, " few"], Int[np.ndarray, " few"]]:
    """Touches and rows of the swaps that a table ranks best, without those that a rule forbids."""
    few = min(FEW, table.size)
    picked = np.argpartition(-table, few - 1, axis=None)[:few]
    a, j = np.divmod(picked[table.ravel()[picked] > NEVER], table.shape[1])
    return a, j
