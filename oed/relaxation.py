"""Approximate designs: the best weights on all candidates, by column generation, with a bound that nothing beats.

A restricted master holds a few hundred candidates; all candidates are priced with one matrix product, the best of those
that would improve it join, idle ones leave. The bound of every round covers all candidates: see `oed.concave`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from oed.admissible import Admissible, admissible
from oed.concave import Concave, Determinant, Power, Smallest, Trace, Worst
from oed.criteria import Criterion, checked_zone, criterion_named, score
from oed.interior import Master
from oed.rows import checked, checked_prior, information, sensitivities, whitener

ROUNDS = 60  # of column generation; 10 to 15 are usual
SAMPLE = 20_000  # candidates that the starting columns are drawn from
SHARPEST = 512.0  # exponent of the smooth stand-ins of E and G
POWER = 0.5  # Kiefer's exponent of O5


@dataclass(frozen=True, eq=False)
class ApproximateDesign:
    """Weights on the candidates, their worth, and what no admissible weights can beat."""

    criterion: str
    weights: Float[np.ndarray, " candidates"]
    value: float  # the criterion of prior + touches * sum of weight * row row'
    bound: float  # the best value that admissible weights, so any admissible set of touches, can have
    gap: float  # by how much the bound exceeds the value, as a share of information
    information: Float[np.ndarray, "parameters parameters"]
    closeness: Float[np.ndarray, " candidates"]  # what a candidate gains over what is needed to carry weight
    level: float  # the bound as phi of the information: the efficiency of a set is its phi over this
    touches: int  # that share the weights
    rounds: int

    @property
    def support(self) -> Int[np.ndarray, " support"]:
        """Candidates that carry weight: more than a millionth, what is below belongs to the method."""
        return np.flatnonzero(self.weights > 1e-6)


def approximate_design(
    rows: Float[np.ndarray, "candidates parameters"],
    criterion: str = "D",
    gap: float = 1e-6,
    *,
    touches: int = 1,
    prior: Float[np.ndarray, "parameters parameters"] | None = None,
    zone: np.ndarray | None = None,
    cap: float | Float[np.ndarray, " candidates"] | None = None,
    face: Int[np.ndarray, " candidates"] | None = None,
    quotas: Mapping[int, tuple[float, float]] | None = None,
) -> ApproximateDesign:
    """Best weights on the candidates to a relative `gap`; the bound holds whether or not the gap was reached.

    `touches` is the number that shares the weights (it matters beside a prior), `cap` the largest weight (1 / touches
    where no touch is repeated), `quotas` the smallest and largest share of weight per face. O2 and O4 have no concave
    form: their weights are those of E, and their bound is nan. E and G have kinks: their gap ends near 1e-3.
    """
    chosen, rows = criterion_named(criterion), checked(rows)
    known = checked_prior(prior, rows.shape[1])
    allowed = admissible(len(rows), cap, face, quotas)
    basis = _basis(chosen, rows, known, touches)
    tip = checked_zone(chosen, zone, rows.shape[1]) if chosen.needs_zone else None
    search = _Search(rows, basis, known, touches, allowed)
    for objective in _objectives(chosen, basis, tip):
        search.run(objective, gap)
        if search.gap <= gap:
            break
    return _result(chosen, search, tip, touches)


def phi(criterion: Criterion, M: Float[np.ndarray, "p p"], zone: np.ndarray | None = None) -> float:
    """The criterion as a function that is homogeneous of degree one in the information, larger being better."""
    value = float(score(criterion, M, 1, zone))
    return value ** (1 / criterion.degree) if criterion.degree else value


def _basis(criterion: Criterion, rows: np.ndarray, prior: np.ndarray, touches: int) -> Float[np.ndarray, "p p"]:
    """Change of parameters that makes the numbers tame; eigenvalues allow no more than a change of unit."""
    T = whitener(prior + touches * information(rows) / len(rows))
    if criterion.keeps == "rotation" and criterion.bound != "trace":
        return np.eye(len(T)) * np.exp(np.linalg.slogdet(T)[1] / len(T))
    return T


def _objectives(
    criterion: Criterion, basis: Float[np.ndarray, "p p"], zone: Float[np.ndarray, "poses axes p"] | None
) -> Iterator[Concave]:
    """The functions to maximise one after the other, in the new basis, each sharper than the one before."""
    if criterion.bound == "determinant":
        yield Determinant()
    elif criterion.bound == "trace":
        yield Trace(basis if zone is None else zone.reshape(-1, len(basis)) @ basis / np.sqrt(len(zone)))
    elif criterion.bound == "power":
        yield Power(POWER)
    else:
        exponent = 2.0
        while exponent <= SHARPEST:
            yield Smallest(exponent) if zone is None else Worst(zone @ basis, exponent)
            exponent *= 4


class _Search:
    """Column generation; columns and weights go from one objective to the next."""

    def __init__(self, rows: np.ndarray, basis: np.ndarray, prior: np.ndarray, touches: int, allowed: Admissible):
        self.rows, self.basis, self.allowed, self.touches = rows, basis, allowed, touches
        self.prior = basis.T @ prior @ basis
        self.columns = self._start()
        self.weights = allowed.centre(self.columns)
        self.level, self.bound, self.rounds = 0.0, np.inf, 0
        self.found: tuple[np.ndarray, np.ndarray] = (self.columns, self.weights)
        self.closeness = np.empty(0)

    @property
    def gap(self) -> float:
        """By how much the best bound exceeds the best weights, of all rounds."""
        return self.bound / self.level - 1 if self.level else np.inf

    def _lifted(self, index: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k p"]:
        """Rows in the new basis, times the root of the number of touches."""
        return np.sqrt(self.touches) * (self.rows[index] @ self.basis)

    def _start(self) -> Int[np.ndarray, " columns"]:
        """Candidates on which a few steps of the multiplicative algorithm, on a sample, put the most weight."""
        count, p = self.rows.shape
        sample = np.unique(np.linspace(0, count - 1, min(count, SAMPLE)).astype(int))
        X, w = self._lifted(sample), np.full(len(sample), 1 / len(sample))
        for _ in range(8):
            d = sensitivities(X, np.linalg.pinv(self.prior + information(X, w), hermitian=True))
            w *= d**2
            w /= w.sum()
        rest = np.ones(count, bool)
        rest[sample] = False
        order = np.concatenate([sample[np.argsort(-w, kind="stable")], np.flatnonzero(rest)])
        few = 6 * p
        while few < count and np.linalg.eigvalsh(self._mean(order[:few]))[0] < 1e-9:
            few *= 2
        return np.unique(np.concatenate([order[:few], self.allowed.enough(order)]))

    def _mean(self, index: Int[np.ndarray, " k"]) -> Float[np.ndarray, "p p"]:
        return self.prior + information(self._lifted(index)) / len(index)

    def _master(self, objective: Concave) -> Master:
        allowed, columns = self.allowed, self.columns
        capped = np.flatnonzero(allowed.capped[columns])
        limited = np.flatnonzero((allowed.low > 0) | (allowed.high < 1))
        return Master(
            objective, self._lifted(columns), self.prior, capped, allowed.cap[columns][capped],
            (allowed.group[columns] == limited[:, None]).astype(float),
            np.where(allowed.low > 0, allowed.low, -1)[limited], allowed.high[limited],
        )  # fmt: skip

    def run(self, objective: Concave, gap: float) -> None:
        """Rounds of master and pricing until the bound is met, or the objective cannot tell more."""
        smooth = 1.0
        for _ in range(ROUNDS):
            self.rounds += 1
            master = self._master(objective)
            barrier = max(min(0.005 * smooth, 1e-2), 0.3 * gap) / len(self.columns)
            self.weights = self._inside(master, smooth)
            self.weights = master.solve(self.weights, barrier, 30 * barrier)
            gain, need, smooth = self._price(objective, master)
            if self.gap <= gap or smooth <= max(gap, 0.05 * self.gap):
                return
            if not self._exchange(gain, need, barrier) and barrier <= 0.3 * gap / len(self.columns):
                return

    def _price(self, objective: Concave, master: Master) -> tuple[np.ndarray, np.ndarray, float]:
        """Gain of every candidate, the gain it needs to carry weight, and the gap of the smooth objective."""
        M = master.information(self.weights)
        level, S = objective.support(M)
        gain = self.touches * sensitivities(self.rows, self.basis @ S @ self.basis.T)
        top, _ = self.allowed.best(gain)
        held = np.full(len(gain), -np.inf)
        held[self.columns] = gain[self.columns]
        _, least = self.allowed.best(held)
        need, bound = least[self.allowed.group], top + float(np.sum(S * self.prior))
        if level > self.level:
            self.level, self.found = level, (self.columns, self.weights)
        if bound < self.bound:
            self.bound, self.closeness = bound, gain / need
        return gain, need, bound / float(np.sum(S * M)) - 1

    def _exchange(self, gain: np.ndarray, need: np.ndarray, barrier: float) -> int:
        """Let idle columns go and the best of the others in; how many came."""
        mean = self.weights @ gain[self.columns]
        idle = (self.weights < 0.05 / len(self.columns)) & (gain[self.columns] < 0.97 * mean)
        self.columns, self.weights = self.columns[~idle], self.weights[~idle]
        surplus = gain - need
        surplus[self.columns] = -np.inf
        few = min(max(2 * self.rows.shape[1], self.touches // 4), len(surplus))
        new = np.argpartition(-surplus, few - 1)[:few]
        new = new[surplus[new] > 0]
        self.columns = np.concatenate([self.columns, new])
        self.weights = np.concatenate([self.weights, np.zeros(len(new))])
        return len(new)

    def _inside(self, master: Master, smooth: float) -> Float[np.ndarray, " columns"]:
        """The weights, moved towards the centre as little as leaves them inside every limit."""
        centre = self.allowed.centre(self.columns)
        for share in (min(0.1, 3 * smooth), 0.01, 0.1, 0.5):
            mixed = (1 - share) * self.weights / self.weights.sum() + share * centre
            if master.distances(mixed).min() > 0:
                return mixed
        return centre


def _result(criterion: Criterion, search: _Search, zone: np.ndarray | None, touches: int) -> ApproximateDesign:
    """The design in the units that came in."""
    weights = np.zeros(len(search.rows))
    columns, w = search.found
    weights[columns] = w
    M = np.linalg.inv(search.basis)
    M = M.T @ (search.prior + search.touches * information(search.rows[columns] @ search.basis, w)) @ M
    value, ratio = float(score(criterion, M, touches, zone)), 1 + search.gap if criterion.bound else np.nan
    return ApproximateDesign(
        criterion=criterion.name, weights=weights, value=value, gap=ratio - 1, information=M, touches=touches,
        bound=value * ratio**criterion.degree if criterion.bound else np.nan, closeness=search.closeness,
        level=phi(criterion, M, zone) * ratio, rounds=search.rounds,
    )  # fmt: skip
