"""Column generation: a restricted master holds a few hundred candidates, and all candidates are priced with its answer.

The best of those that would improve it join, no two alike; idle ones leave as long as the answer improves. The bound of
every round covers all candidates: see `oed.criteria.criterion`.
"""

import numpy as np
from jaxtyping import Float, Int

from oed.criteria.criterion import Criterion
from oed.design.matrix import blocks, information, sensitivities
from oed.design.owners import Owners
from oed.design.restricted_master import Master
from oed.design.weight_limits import Admissible

ROUNDS = 60  # 7 to 15 are usual
SAMPLE = 5_000  # candidates that the starting columns are drawn from
ALIKE = 0.8  # squared cosine of two candidates, as they are priced, above which only the better one joins in a round
CARRIED = 1e-3  # of the largest weight: columns with less do not begin the next search
NEARLY = 0.1  # gap of weights that another search found, on other candidates: hardly ever is it more
POOL, BLOCK = 50_000, 4096  # candidates that may join, best first, and how many of them are compared at once


class Search:
    """Columns and weights go from one objective to the next."""

    def __init__(
        self,
        rows: np.ndarray,
        basis: np.ndarray,
        prior: np.ndarray,
        touches: int,
        allowed: Admissible,
        blind: bool,
        owner: Owners | None = None,
        start: Float[np.ndarray, " candidates"] | None = None,
    ):
        """Weights of `start` are nearly the best, if most of them are given.

        With `blind`, a share of the weight stays on all candidates.

        Weights that are best for a zone may leave open what the zone does not see, and the prices of their information
        are then no bound. The share, a part of the gap, keeps information regular and costs no more than itself.
        """
        self.rows, self.basis, self.allowed, self.touches = rows, basis, allowed, touches
        self.owners = Owners.single(len(rows)) if owner is None else owner
        self.prior = basis.T @ prior @ basis
        start = None if start is None or start.sum() < 0.5 else start
        self.columns = self._start() if start is None else self._carried(start)
        self.weights = allowed.centre(self.columns) if start is None else start[self.columns]
        self.smooth = 1.0 if start is None else NEARLY  # gap of the first master
        self.level, self.bound, self.rounds = 0.0, np.inf, 0
        self.everywhere = self._everywhere() if blind else None
        self.spread = 0.0  # that share
        self.found = (self.columns, self.weights, self.spread)
        self.information = self.prior  # of the weights found, in the basis
        self.closeness = np.empty(0)
        self.support = self.prior  # S of the best bound, in the basis
        self._tidied = 0.0  # level at which idle columns left last

    @property
    def gap(self) -> float:
        """By how much the best bound exceeds the best weights, of all rounds."""
        return self.bound / self.level - 1 if self.level else np.inf

    def _lifted(self, index: Int[np.ndarray, " k"]) -> Float[np.ndarray, "rows p"]:
        """Rows of candidates in the new basis, times the root of the number of touches."""
        return np.sqrt(self.touches) * (self.rows[self.owners.rows(index)] @ self.basis)

    def _everywhere(self) -> Float[np.ndarray, "p p"]:
        """Information of weights on all candidates, well inside every limit."""
        everyone = np.arange(len(self.owners))
        w = self.allowed.centre(everyone)
        parts = (
            information(self._lifted(everyone[part]), self.owners.each(everyone[part], w[part]))
            for part in blocks(len(w))
        )
        return np.sum(list(parts), axis=0)

    def all_weights(self) -> Float[np.ndarray, " candidates"]:
        """The weights found, on all candidates."""
        columns, w, spread = self.found
        count = len(self.owners)
        out = spread * self.allowed.centre(np.arange(count)) if spread else np.zeros(count)
        out[columns] += (1 - spread) * w
        return out

    def _start(self) -> Int[np.ndarray, " columns"]:
        """Candidates on which a few steps of the multiplicative algorithm, on a sample, put the most weight."""
        count, p = len(self.owners), self.basis.shape[1]
        sample = np.unique(np.linspace(0, count - 1, min(count, SAMPLE)).astype(int))
        X, w = self._lifted(sample), np.full(len(sample), 1 / len(sample))
        for _ in range(8):
            M = self.prior + information(X, self.owners.each(sample, w))
            w *= self.owners.summed(sample, sensitivities(X, np.linalg.pinv(M, hermitian=True))) ** 2
            w /= w.sum()
        rest = np.ones(count, bool)
        rest[sample] = False
        order = np.concatenate([sample[np.argsort(-w, kind="stable")], np.flatnonzero(rest)])
        return self._regular(order, 6 * p)

    def _carried(self, start: Float[np.ndarray, " candidates"]) -> Int[np.ndarray, " columns"]:
        """Candidates that carry weight already."""
        return self._regular(np.argsort(-start, kind="stable"), int((start > CARRIED * start.max()).sum()))

    def _regular(self, order: Int[np.ndarray, " candidates"], few: int) -> Int[np.ndarray, " columns"]:
        """The first candidates of an order: a few, or as many as make information regular and hold all weight."""
        few = max(few, self.basis.shape[1])
        while few < len(order) and np.linalg.eigvalsh(self._mean(order[:few]))[0] < 1e-9:
            few *= 2
        return np.unique(np.concatenate([order[:few], self.allowed.enough(order)]))

    def _mean(self, index: Int[np.ndarray, " k"]) -> Float[np.ndarray, "p p"]:
        return self.prior + information(self._lifted(index)) / len(index)

    def _master(self, objective: Criterion) -> Master:
        allowed, columns = self.allowed, self.columns
        capped = np.flatnonzero(allowed.capped[columns])
        limited = np.flatnonzero((allowed.low > 0) | (allowed.high < 1))
        base = self.prior if self.everywhere is None else self.prior + self.spread * self.everywhere
        return Master(
            objective,
            np.sqrt(1 - self.spread) * self._lifted(columns),
            base,
            capped,
            allowed.cap[columns][capped],
            (allowed.group[columns] == limited[:, None]).astype(float),
            np.where(allowed.low > 0, allowed.low, -1)[limited],
            allowed.high[limited],
            self.owners.local(columns),
        )

    def run(self, objective: Criterion, gap: float) -> None:
        """Rounds of master and pricing until the bound is met, or the objective cannot tell more."""
        smooth = self.smooth
        for _ in range(ROUNDS):
            self.rounds += 1
            self.spread = 0.0 if self.everywhere is None else max(min(0.01 * smooth, 0.01), 0.25 * gap)
            master = self._master(objective)
            barrier = max(min(0.005 * smooth, 1e-2), 0.3 * gap) / len(self.columns)
            self.weights = self._inside(master, smooth)
            self.weights = master.solve(self.weights, barrier, 30 * barrier)
            gain, need, S, smooth = self._price(objective, master)
            if self.gap <= gap or smooth <= max(gap, 0.05 * self.gap):
                return
            if not self._exchange(gain, need, S) and barrier <= 0.3 * gap / len(self.columns):
                return

    def _price(self, objective: Criterion, master: Master) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """Gain of all candidates, the gain that each needs to carry weight, their S, and the smooth objective's gap."""
        M = master.information(self.weights)
        level, S = objective.phi(M), objective.support(M)
        gain = self.touches * self.owners.summed(None, sensitivities(self.rows, self.basis @ S @ self.basis.T))
        top, _ = self.allowed.best(gain)
        own_gain = np.full(len(gain), -np.inf)
        own_gain[self.columns] = gain[self.columns]
        _, least = self.allowed.best(own_gain)
        need, bound = least[self.allowed.group], top + float(np.sum(S * self.prior))
        if level > self.level:
            self.level, self.found, self.information = level, (self.columns, self.weights, self.spread), M
        if bound < self.bound:
            self.bound, self.closeness, self.support = bound, gain / need, S
        return gain, need, S, bound / float(np.sum(S * M)) - 1

    def _exchange(self, gain: np.ndarray, need: np.ndarray, S: Float[np.ndarray, "p p"]) -> int:
        """Let idle columns go and the best of the others in; how many came.

        Where the criterion bends sharply, prices jump from round to round: then none go until the answer is better, or
        the same ones would come and go for ever.
        """
        if self.level > self._tidied:
            self._tidied, mean = self.level, self.weights @ gain[self.columns]
            idle = (self.weights < 0.05 / len(self.columns)) & (gain[self.columns] < 0.97 * mean)
            self.columns, self.weights = self.columns[~idle], self.weights[~idle]
        surplus = gain - need
        surplus[self.columns] = -np.inf
        new = self._best(surplus, S)
        self.columns = np.concatenate([self.columns, new])
        self.weights = np.concatenate([self.weights, np.zeros(len(new))])
        return len(new)

    def _best(self, surplus: Float[np.ndarray, " candidates"], S: Float[np.ndarray, "p p"]) -> Int[np.ndarray, " new"]:
        """The best candidates that would improve the master, no two alike; where weights are capped, others too."""
        few = 2 * self.basis.shape[1]
        good = np.flatnonzero(surplus > 0)
        if len(good) > POOL:
            good = good[np.argpartition(-surplus[good], POOL)[:POOL]]
        good = good[np.argsort(-surplus[good], kind="stable")]
        eigenvalues, V = np.linalg.eigh(S)
        Y = self.rows[self.owners.first[good]] @ (self.basis @ (V * np.sqrt(np.maximum(eigenvalues, 0))))
        return np.union1d(good[_unlike(Y, few)], good[: self.touches // 4])

    def _inside(self, master: Master, smooth: float) -> Float[np.ndarray, " columns"]:
        """The weights, moved towards the centre as little as leaves them inside every limit."""
        centre = self.allowed.centre(self.columns)
        for share in (min(0.1, 3 * smooth), 0.01, 0.1, 0.5):
            mixed = (1 - share) * self.weights / self.weights.sum() + share * centre
            if master.distances(mixed).min() > 0:
                return mixed
        return centre


def _unlike(Y: Float[np.ndarray, "k p"], few: int) -> list[int]:
    """The first rows of which no two are ALIKE, at most a `few`."""
    if len(Y) <= few:
        return list(range(len(Y)))
    Y, basis = Y / np.linalg.norm(Y, axis=1, keepdims=True), list[int]()
    for part in blocks(len(Y), BLOCK):
        rows = Y[part]
        rest = ((rows @ Y[basis].T) ** 2 < ALIKE).all(axis=1)
        while rest.any() and len(basis) < few:
            k = int(np.argmax(rest))
            basis.append(part.start + k)
            rest &= (rows @ rows[k]) ** 2 < ALIKE
    return basis
