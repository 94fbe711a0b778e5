"""How good a plan is against the best that any touches could be, not only those on offer.

Kiefer and Wolfowitz (1960): a concave criterion lies below its tangent at any information M0, so no design of n touches
beats the tangent where every touch is the one that gains most. With C = M0^-1, prior information P and touch rows f,

    det(M)^(1/p)   <=  det(M0)^(1/p) (tr(C P) + n max f'Cf) / p
    1 / tr(B M^-1) <=  (tr(C B C P) + n max f'CBCf) / tr(B C)^2

The maximum runs over the whole manifold of touches: postures on faces within tilt, limits and insets. It is looked for
from the best touches on offer, which are structured to hold its maxima, each polished by Ipopt. Clearance is not
asked of them, which can only raise the bound; a maximum in no basin of these starts would be missed.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from oed.criteria.aim import Aim
from oed.planning.candidate_set import Offer
from oed.refinement.coordinate import Refinement

STARTS = 32
NEAR = 0.5  # [rad], starts of one face that are nearer than this in every joint would be polished to the same maximum


@dataclass(frozen=True)
class Certificate:
    """What no set of touches can beat, as far as it was looked for."""

    level: float  # of det(M)^(1/p), or of 1 / tr(B M^-1)
    starts: int  # touches polished to find the one that gains most
    gain: float  # of the best touch on the manifold over the best one on offer, less 1

    def efficiency(self, aim: Aim, M: Float[np.ndarray, "kept kept"]) -> float:
        """Share of the best possible that touches of total information M reach."""
        return float(level(aim, M) / self.level)


def level(aim: Aim, M: Float[np.ndarray, "kept kept"]) -> float:
    """The criterion as a function that grows in proportion to the information."""
    value = aim.value(M)
    return float(np.exp(value / len(M) if aim.B is None else value))


def certify(
    offered: Offer,
    refinement: Refinement,
    aim: Aim,
    M0: Float[np.ndarray, "kept kept"],
    n: int,
    allowed: Bool[np.ndarray, " touches"] | None = None,
) -> Certificate:
    """Bound n touches by the tangent at information M0, over the manifold of touches.

    The bound is tight where M0 is nearly the best that there is. Where not all touches on offer are `allowed`, it is
    the bound over those like the allowed ones.
    """
    F, P = offered.rows, offered.known.precision
    C = np.linalg.inv(M0)
    S = aim.weight(C)
    gains = ((F @ S) * F).sum(axis=1)
    if allowed is not None:
        gains[~allowed] = 0.0
    starts = _starts(offered, gains)
    best = max(gains.max(), _polished(offered, refinement, starts, S))
    total = np.trace(S @ P) + n * best
    scale = len(M0) if aim.B is None else float(np.trace(aim.B @ C))
    return Certificate(level(aim, M0) * total / scale, len(starts), float(best / gains.max() - 1))


def _starts(offered: Offer, gains: Float[np.ndarray, " touches"]) -> list[int]:
    """The touches that gain most, no two alike."""
    found, chosen = offered.found, list[int]()
    for i in np.argsort(-gains, kind="stable")[: 50 * STARTS]:
        same = [k for k in chosen if found.face[k] == found.face[i]]
        if not same or np.abs(found.q[same] - found.q[i]).max(axis=1).min() > NEAR:
            chosen.append(int(i))
        if len(chosen) == STARTS:
            break
    return chosen


def _polished(offered: Offer, refinement: Refinement, starts: list[int], S: Float[np.ndarray, "kept kept"]) -> float:
    """The largest f'Sf that Ipopt finds from touches."""
    index = np.array(starts)
    touches = offered.found.take(index)
    q = refinement.best(touches, np.zeros((len(index), *S.shape)), np.broadcast_to(S, (len(index), *S.shape)))
    f = offered.known.rows(q, touches.normal, offered.sigma[index], approach=touches.approach + q - touches.q)
    return float(((f @ S) * f).sum(axis=1).max())
