"""Column generation over the manifold of touches, and how good a plan is against the best that any touches could be.

A concave criterion lies below its tangent (Kiefer and Wolfowitz 1960): with S from the best weights on some candidates,
prior information P and touch rows f, no n touches have more than

    phi(M)  <=  tr(S M)  <=  tr(S P) + n max f'Sf

The maximum runs over the manifold: all postures on faces, within tilt, limits and insets, that can be made. It is
looked for by pricing: all candidates, which lie on a grid of corners and edges, tilts, rolls and branches of the
inverse kinematics, then those that gain most, no two alike, each polished by Ipopt. A polished touch joins the
candidates where it can be made, the best weights are computed again, and so on: the bound falls and the candidates
become better. Polishing from many starts finds many maxima and proves nothing about others: a certificate says how
many touches were priced and polished. A bound that covers more touches may be higher, and the share of it lower, for a
better plan: n = 60 on the library's cell (one seed; by default, with 30 s of one core)

    criterion   value of the touches   share of the bound on all touches
    V           7.42e-3, 7.24e-3       .876, .901 (128 and 672 polished)
    D           2255, 2274             .940, .973
    A           1.041e-3, 1.042e-3     .822, .932
    O5          8.99, 9.05             .812, .940
    E           2686, 2906             .748, .783
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from oed.candidates.candidates import Candidates
from oed.criteria.criterion import Criterion
from oed.design.matrix import sensitivities
from oed.design.relaxation import ApproximateDesign, approximate_design
from oed.refinement.coordinate import Refinement

STARTS = 32  # polished in a round
NEAR = 0.5  # [rad], starts of one face that are nearer than this in every joint would be polished to the same maximum
ROUNDS = 4  # where no time is given
MET = 0.01  # of the bound: candidates this near to it gain nothing that counts
GAP = 3e-3  # of a relaxation: its bound holds at any gap
NEARLY = 0.85  # of the largest gain: polished touches that gain less hardly steady the next prices
CLOSE = 0.8  # of the largest gain: other candidates hardly carry weight in the next round


@dataclass(frozen=True)
class Certificate:
    """What no set of touches that can be made exceeds, as far as touches were priced."""

    level: float  # that phi of the information of n touches does not exceed
    priced: int  # candidates on the grid and polished touches that were compared
    polished: int  # starts of Ipopt
    rounds: int
    joined: int  # polished touches that joined the candidates

    @property
    def covers(self) -> str:
        """One sentence for people."""
        return (
            "all touches of the faces that can be made and that robots surely enough meet, as far as they were priced: "
            f"{self.priced} on a grid of corners, edges, tilts, rolls and branches, {self.polished} of them polished "
            f"in {self.rounds} {'round' if self.rounds == 1 else 'rounds'}; a search, not a proof"
        )


@dataclass(frozen=True, eq=False)
class Manifold:
    """Candidates and the polished touches that joined them, and what bounds them."""

    touches: Candidates
    rows: Float[np.ndarray, "touches kept"]
    relaxation: ApproximateDesign  # of these rows
    certificate: Certificate


def generate_columns(
    refinement: Refinement,
    touches: Candidates,
    rows: Float[np.ndarray, "touches kept"],
    criterion: Criterion,
    relaxation: ApproximateDesign,
    *,
    joined: Callable[[Candidates], Bool[np.ndarray, " touches"]] | None = None,
    rounds: int = ROUNDS,
    seconds: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> Manifold:
    """Column generation: polished touches join the candidates until the bound over the manifold is met.

    It ends after so many rounds at the latest. With `seconds` it goes on after them until these are over, or the bound
    is met and something like each of the best candidates was polished; what it finds then depends on the machine. The
    relaxation is that of the candidates, for the number of touches to choose; `joined` says which touches clear ways
    join to the others, all if not given.
    """
    P, n, begin, polished = refinement.coordinates.precision, relaxation.touches, time.perf_counter(), 0
    count, S, supports, explored = len(touches), relaxation.support, list[np.ndarray](), np.zeros(len(touches), bool)
    weights = relaxation.weights
    while True:
        starts, explored = _starts(touches, sensitivities(rows, S), explored)
        more = _polished(refinement, touches.take(starts), S, NEARLY * float(sensitivities(rows, S).max()))
        more = more if joined is None else more.take(joined(more))
        touches, rows = touches.followed_by(more), np.vstack([rows, _rows(refinement, more)])
        explored, weights = np.append(explored, np.ones(len(more), bool)), np.append(weights, np.zeros(len(more)))
        polished += len(starts)
        supports.append(S)
        gains = [sensitivities(rows, T) for T in supports]
        levels = [float(np.sum(T * P) + n * gain.max()) for T, gain in zip(supports, gains, strict=True)]
        share = min(len(supports) / rounds, 1.0 if seconds is None else (time.perf_counter() - begin) / seconds)
        if progress:
            progress(share)
        close = gains[-1] > CLOSE * gains[-1].max()
        next_design = approximate_design(rows[close], criterion, GAP, touches=n, prior=P, start=weights[close])
        weights[:] = 0.0
        weights[close] = next_design.weights
        met = min(levels) < (1 + MET) * next_design.level
        if share >= 1 or (met and (seconds is None or explored[close].all())):
            break
        S = next_design.support
    relaxation = approximate_design(rows, criterion, GAP, touches=n, prior=P, start=weights)
    certificate = Certificate(min(levels), len(rows), polished, len(supports), len(rows) - count)
    return Manifold(touches, rows, relaxation, certificate)


def _starts(
    touches: Candidates, gains: Float[np.ndarray, " touches"], explored: Bool[np.ndarray, " touches"]
) -> tuple[Int[np.ndarray, " starts"], Bool[np.ndarray, " touches"]]:
    """The touches that gain most, no two alike: half of all, and half of those that nothing alike was polished of.

    Returned with what is explored then.
    """
    first = _unlike(touches, gains, np.zeros(len(touches), bool), STARTS // 2)
    explored = explored | _alike(touches, first)
    second = _unlike(touches, gains, explored, STARTS - len(first))
    return np.concatenate([first, second]), explored | _alike(touches, second)


def _unlike(
    touches: Candidates, gains: Float[np.ndarray, " touches"], without: Bool[np.ndarray, " touches"], many: int
) -> Int[np.ndarray, " starts"]:
    """The touches that gain most, no two alike."""
    remaining, batch = np.where(without, -np.inf, gains), list[int]()
    while len(batch) < many and np.isfinite(best := remaining.max()) and best > 0:
        k = int(np.argmax(remaining))
        batch.append(k)
        remaining[_alike(touches, np.array([k]))] = -np.inf
    return np.array(batch, dtype=int)


def _alike(touches: Candidates, index: Int[np.ndarray, " some"]) -> Bool[np.ndarray, " touches"]:
    """The touches that would be polished to the same maximum as some of them."""
    near = np.zeros(len(touches), bool)
    for i in index:
        some = np.flatnonzero(touches.face == touches.face[i])
        near[some[np.abs(touches.q[some] - touches.q[i]).max(axis=1) < NEAR]] = True
    return near


def _polished(
    refinement: Refinement, touches: Candidates, S: Float[np.ndarray, "kept kept"], least: float
) -> Candidates:
    """The touches that can be made on the way from each one to where Ipopt finds the largest f'Sf.

    The best of each way, if it gains at least so much.
    """
    every = np.broadcast_to(S, (len(touches), *S.shape))
    goals = refinement.best(touches, np.zeros(every.shape), every)
    trials, owner = refinement.approaches(touches, goals)
    if not len(trials):
        return trials
    gains = sensitivities(_rows(refinement, trials), S)
    order = np.lexsort((-gains, owner))
    _, first = np.unique(owner[order], return_index=True)
    best = order[first]
    return trials.take(best[gains[best] >= least])


def _rows(refinement: Refinement, touches: Candidates) -> Float[np.ndarray, "touches kept"]:
    return refinement.coordinates.rows(touches.expected_rows(refinement.cell))
