"""What happens to a criterion when one touch of a set is swapped for another: every pair at once, one table.

With C = M^-1, rows x of the touch that goes and y of the one that comes, and B = C W C, a swap changes

    det M      by the factor  (1 + y'Cy)(1 - x'Cx) + (x'Cy)^2                                      (Fedorov 1972)
    tr(W C)    by  -[(1 - x'Cx) y'By + 2 x'Cy x'By - (1 + y'Cy) x'Bx] / that factor

so D and the traces need covariances of the set with the pool, which follow each swap by a low-rank update. Any other
criterion is ranked to first order (`oed.criteria.first_order_swaps`). Tables are single precision: they rank. Where
there are no more touches than parameters, 1 - x'Cx is next to nothing: they need double.
"""

from abc import ABC, abstractmethod
from copy import copy
from typing import Any, ClassVar, Self

import numpy as np
from jaxtyping import Float, Int

Members = Int[np.ndarray, " _"]  # touches of a set; sets of several sizes meet in one signature
Square = Float[np.ndarray, "p p"]
Table = Float[np.ndarray, "touches pool"]
Precision = type[Any]  # np.float32 or np.float64

NEVER = -np.inf  # table entry of a swap that a rule forbids
TINY = 1e-12
REFRESH = 50  # swaps between two recomputations of an updated table
NEEDED = 1e-3  # where less of a direction is seen without a touch, its update is a difference of nearly equal numbers
HARDLY_SEEN = 1e5  # variance of a direction, in units of the pool's, above which updates lose digits in double, too
LOST = 10.0  # roundings: a swap that leaves less of the determinant cannot be told from a ruinous one
AT_ONCE = 4  # a quarter of the touches in excess go at once


class Swaps(ABC):
    """Sets of rows of one pool, beside the information before them; rows are scaled to about unit information.

    The `criterion` is one of `oed.criteria.criterion`, in the basis of the rows.
    """

    still: ClassVar[float] = 0.0  # table entry of a swap that changes nothing
    exact: ClassVar[bool] = True  # whether a table tells what a swap changes, or ranks swaps only
    population: ClassVar[int] = 8  # sets that a search holds for 50 touches: more where a table costs less

    def __init__(
        self, rows: Float[np.ndarray, "pool p"], before: Square, criterion: Any, precision: Precision = np.float32
    ):
        self.before, self.criterion, self.precision = before, criterion, precision
        self._hold(rows)

    def _hold(self, rows: Float[np.ndarray, "pool p"]) -> None:
        self.rows, self.low = rows, rows.astype(self.precision)
        self.low_t = np.ascontiguousarray(self.low.T)
        self.members: Members = np.zeros(0, int)

    def among(self, index: Int[np.ndarray, " some"]) -> Self:
        """The same for some of the rows."""
        other = copy(self)
        other._hold(self.rows[index])
        return other

    def log(self, members: Members) -> float:
        """Logarithm of the criterion, homogeneous of degree one and larger being better, in double precision."""
        return float(self.criterion.log(self.information(members)))

    def slope(self, M: Square) -> Square:
        """Gradient of that logarithm."""
        slope: Square = self.criterion.slope(M)
        return slope

    @abstractmethod
    def table(self) -> Table:
        """How good every swap is; the caller may write into it."""

    @abstractmethod
    def growth(self, table: Table) -> Table:
        """A table as the growth of the logarithm of the criterion."""

    @abstractmethod
    def best(self, table: Table) -> tuple[int, int, float]:
        """The best swap of a table: touch, row, and the factor by which the criterion grows."""

    def logs_after(self, a: Int[np.ndarray, " k"], j: Int[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Logarithm of the criterion after each of some swaps of a touch for a row, in double precision."""
        M = self.information(self.members)
        logs: np.ndarray = self.criterion.logs_after(M, self.rows[self.members[a]], self.rows[j])
        return logs

    def look_wider(self) -> bool:
        """Whether there is another table to look at, when the best swap of this one does not help."""
        return False

    def information(self, members: Members) -> Square:
        """Information of a set, with that before it."""
        X = self.rows[members]
        return self.before + X.T @ X

    def load(self, members: Members) -> None:
        """Make a set the present one."""
        self.members = np.array(members)

    def swap(self, a: int, j: int) -> None:
        """Let row j of the pool take the place of touch a."""
        self.members[a] = j
        self.load(self.members)

    def gains(self, members: Members) -> Float[np.ndarray, " pool"]:
        """What each row of the pool would add to a set: x'Sx / (1 + x'Cx), of the trace that touches the criterion."""
        M = self.information(members)
        return forms(self.rows, self.slope(M)) / (1 + forms(self.rows, np.linalg.inv(M)))

    def losses(self, members: Members) -> Float[np.ndarray, " touches"]:
        """What a set would lose with each of its touches, in the same measure."""
        M, X = self.information(members), self.rows[members]
        return forms(X, self.slope(M)) / np.maximum(1 - forms(X, np.linalg.inv(M)), 1e-9)

    def thinned(self, members: Members, n: int, heat: float, rng: np.random.Generator) -> Members:
        """The n touches that are left when those that matter least go, a few at once, with `heat` for variety."""
        noise = heat * rng.gumbel(size=len(members))
        while len(members) > n:
            few = 1 + (len(members) - n) // AT_ONCE
            stay = np.sort(np.argpartition(self.losses(members) + noise, few)[few:])
            members, noise = members[stay], noise[stay]
        return members


class DeterminantSwaps(Swaps):
    """det(M)^(1/p); the table holds the factors of the determinant."""

    still = 1.0
    population = 40

    def gains(self, members: Members) -> Float[np.ndarray, " pool"]:
        """Logarithm of the factor of the determinant."""
        return np.log1p(forms(self.rows, np.linalg.inv(self.information(members))))

    def losses(self, members: Members) -> Float[np.ndarray, " touches"]:
        """The same for a touch that goes."""
        X = self.rows[members]
        return -np.log(np.maximum(1 - forms(X, np.linalg.inv(self.information(members))), 1e-9))

    def load(self, members: Members) -> None:
        """Covariances of the set with the pool, and variances of the pool."""
        super().load(members)
        (n, p), m = (len(members), self.low.shape[1]), len(self.low)
        C = np.linalg.inv(self.information(self.members))
        self.C = C.astype(self.precision)
        self.G = (self.low[self.members] @ self.C) @ self.low_t
        self.plus = np.ones((2, m), self.precision)  # 1 + d as a product of two rows, faster than an outer product
        self.d = np.einsum("ij,ij->j", self.low_t, self.C @ self.low_t, out=self.plus[1])
        self.minus = np.empty((n, 2), self.precision)
        self.work, self.spare = np.empty_like(self.G), np.empty_like(self.G)
        self.c, self.P = np.empty((2, p), self.precision), np.empty((2, m), self.precision)
        self.age = 0

    def factors(self) -> Table:
        """(1 + y'Cy)(1 - x'Cx) + (x'Cy)^2 of every swap."""
        self.minus[:] = (1 - self.d[self.members])[:, None]
        np.multiply(self.G, self.G, out=self.work)
        self.work += np.matmul(self.minus, self.plus, out=self.spare)
        return self.work

    def table(self) -> Table:
        """The factors of the determinant."""
        return self.factors()

    def growth(self, table: Table) -> Table:
        """Logarithm of the factor, over the number of parameters."""
        return np.log(np.maximum(table, TINY)) / self.rows.shape[1]

    def best(self, table: Table) -> tuple[int, int, float]:
        """The largest factor; the p-th root of it is what the criterion gains."""
        a, j = divmod(int(table.argmax()), table.shape[1])
        return a, j, float(max(table[a, j], 0)) ** (1 / self.rows.shape[1])

    def swap(self, a: int, j: int) -> None:
        """Low-rank update of covariances and variances; recomputed now and then, and where an update would be lost."""
        self.age += 1
        shaky = 1 - self.d[self.members[a]] < NEEDED or self.C.diagonal().max() > HARDLY_SEEN
        if self.age > REFRESH or shaky:
            super().swap(a, j)
        else:
            self.update(a, j)

    def update(self, a: int, j: int) -> Float[np.ndarray, "2 2"]:
        """C loses c'Ac with c = C [x y], so G and d lose the same seen from the set and the pool; returns A."""
        i, c, P = self.members[a], self.c, self.P
        np.matmul(self.C, self.low[i], out=c[0])
        np.matmul(self.C, self.low[j], out=c[1])
        P[0] = self.G[a]
        np.matmul(c[1], self.low_t, out=P[1])
        x, y, xy = P[0, i], P[1, j], P[0, j]
        A = np.array([[-1 - y, xy], [xy, 1 - x]], self.precision) / ((1 + y) * (1 - x) + xy * xy)
        AP = A @ P
        self.members[a] = j
        self.C -= c.T @ (A @ c)
        self.d -= np.einsum("ij,ij->j", P, AP)
        self.G[a] = P[1]
        self.G -= np.matmul(P[:, self.members].T, AP, out=self.spare)
        return A


class TraceSwaps(DeterminantSwaps):
    """1 / tr(W C); the table holds by how much of itself the trace falls."""

    still = 0.0
    population = 20

    gains, losses = Swaps.gains, Swaps.losses

    def __init__(
        self, rows: Float[np.ndarray, "pool p"], before: Square, criterion: Any, precision: Precision = np.float32
    ):
        super().__init__(rows, before, criterion, precision)
        self.low_W = criterion.W.astype(precision)

    def load(self, members: Members) -> None:
        """Covariances, and the same with B in the place of C."""
        super().load(members)
        CW = self.C @ self.low_W
        self.B = (self.low[self.members] @ (CW @ self.C)) @ self.low_t
        self.b = np.einsum("ij,ij->j", self.low_t, (CW @ self.C) @ self.low_t)
        self.R = np.empty_like(self.P)
        self.falls = np.empty_like(self.G)

    def table(self) -> Table:
        """Fall of the trace over the trace, for every swap."""
        factors, falls = self.factors(), self.falls
        trace = float(np.sum(self.C * self.low_W))
        rest, own = self.minus[:, :1], self.b[self.members][:, None]
        np.multiply(self.G, self.B, out=falls)
        falls *= 2
        falls += np.matmul(
            np.concatenate([rest, -own, -own], axis=1), np.concatenate([self.b[None], self.plus]), out=self.spare
        )
        least = LOST * np.finfo(self.precision).eps
        lost = factors < least
        np.maximum(factors, least, out=factors)
        factors *= trace
        falls /= factors
        falls[lost] = NEVER
        return falls

    def growth(self, table: Table) -> Table:
        """Trace before over trace after, as a logarithm."""
        return -np.log(np.maximum(1 - table, TINY))

    def best(self, table: Table) -> tuple[int, int, float]:
        """The deepest fall, and trace before over trace after."""
        a, j = divmod(int(table.argmax()), table.shape[1])
        return a, j, 1 / max(1 - float(table[a, j]), TINY)

    def update(self, a: int, j: int) -> Float[np.ndarray, "2 2"]:
        """B changes by [P R]' [[A S A, -A], [-A, 0]] [P R], R = [x y]'B and S = [x y]'B[x y]."""
        i, R = self.members[a], self.R
        R[0] = self.B[a]
        CWy = self.C @ (self.low_W @ (self.C @ self.low[j]))
        np.matmul(CWy, self.low_t, out=R[1])
        A = super().update(a, j)
        mix = np.zeros((4, 4), self.precision)
        mix[:2, :2], mix[:2, 2:], mix[2:, :2] = A @ R[:, [i, j]] @ A, -A, -A
        PR = np.concatenate([self.P, R])
        change = mix @ PR
        self.b += np.einsum("ij,ij->j", PR, change)
        self.B[a] = R[1]
        self.B += np.matmul(PR[:, self.members].T, change, out=self.spare)
        return A


def forms(X: Float[np.ndarray, "k p"], Q: Square) -> Float[np.ndarray, " k"]:
    """The number x'Qx of every row."""
    return np.einsum("ij,ij->i", X @ Q, X)
