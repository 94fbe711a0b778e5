"""How good a plan is against the best that any touches could be, not only the candidates.

A concave criterion lies below its tangent (Kiefer and Wolfowitz 1960): with S from the best weights on the candidates,
prior information P and touch rows f, no n touches have more than

    phi(M)  <=  tr(S M)  <=  tr(S P) + n max f'Sf

The maximum runs over the whole manifold of touches: postures on faces within tilt, limits and insets. It is looked for
from the candidates that gain most, which are structured to hold its maxima, each polished by Ipopt. Clearance is not
asked of them, which can only raise the bound; a maximum in no basin of these starts would be missed.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from oed.candidates.candidates import Candidates
from oed.design.matrix import sensitivities
from oed.refinement.coordinate import Refinement

STARTS = 32
NEAR = 0.5  # [rad], starts of one face that are nearer than this in every joint would be polished to the same maximum


@dataclass(frozen=True)
class Certificate:
    """What no set of touches can beat, as far as it was looked for."""

    level: float  # that phi of the information of n touches does not exceed
    starts: int  # touches polished to find the one that gains most
    gain: float  # of the best touch on the manifold over the best candidate, less 1


def certify(
    refinement: Refinement,
    touches: Candidates,
    rows: Float[np.ndarray, "touches kept"],
    S: Float[np.ndarray, "kept kept"],
    n: int,
) -> Certificate:
    """Bound the criterion that S supports for n touches, over the manifold around candidates with their rows.

    The bound is tight where S supports at nearly the best information that there is.
    """
    gains = sensitivities(rows, S)
    starts = _starts(touches, gains)
    best = max(gains.max(), _polished(refinement, touches.take(starts), S))
    level = float(np.sum(S * refinement.coordinates.precision) + n * best)
    return Certificate(level, len(starts), float(best / gains.max() - 1))


def _starts(touches: Candidates, gains: Float[np.ndarray, " touches"]) -> np.ndarray:
    """The touches that gain most, no two alike."""
    chosen = list[int]()
    for i in np.argsort(-gains, kind="stable")[: 50 * STARTS]:
        same = [k for k in chosen if touches.face[k] == touches.face[i]]
        if not same or np.abs(touches.q[same] - touches.q[i]).max(axis=1).min() > NEAR:
            chosen.append(int(i))
        if len(chosen) == STARTS:
            break
    return np.array(chosen)


def _polished(refinement: Refinement, touches: Candidates, S: Float[np.ndarray, "kept kept"]) -> float:
    """The largest f'Sf that Ipopt finds from touches."""
    every = np.broadcast_to(S, (len(touches), *S.shape))
    q = refinement.best(touches, np.zeros(every.shape), every)
    moved = replace(touches, q=q, approach=touches.approach + q - touches.q)
    f = refinement.coordinates.rows(moved.rows(refinement.cell))
    return float(sensitivities(f, S).max())
