"""Choose touches from an offer: the best of them that the robot can also visit one after the other."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from oed.aim import Aim
from oed.offer import Offer
from oed.passes import swapped
from oed.sequence import Order
from oed.ways import COARSE, astray, like

POOL = 2500  # touches that an exchange looks at
TRIES = 4  # of choosing again where the chosen cannot be visited
MENDS = 6  # of replacing what cannot be visited
LOOKS = 30  # at touches that tell nearly the same
NEIGHBOURS = 4  # clear ways to others that make a touch likely to find its place in an order

Pick = Callable[[Bool[np.ndarray, " touches"], Int[np.ndarray, " n"] | None], Int[np.ndarray, " n"]]


@dataclass(frozen=True, eq=False)
class Visit:
    """Touches on offer that can be visited one after the other."""

    order: Order  # its index counts through the offer
    allowed: Bool[np.ndarray, " touches"]  # of the offer: those that do not lead to blocked ways, as far as was seen


def visited(
    offered: Offer, pick: Pick, rng: np.random.Generator, allowed: Bool[np.ndarray, " touches"] | None = None
) -> Visit:
    """Touches that `pick` chooses among those allowed, until they can be visited on clear ways.

    What leads to blocked ways is given up, with all that is more like it than like what stays; after some tries, it is
    put in the place of what is given up that tells nearly the same and can be visited. The best try is returned where
    none is free of blocked ways.
    """
    cell, at = offered.known.cell, offered.found.approach
    allowed = np.ones(len(at), dtype=bool) if allowed is None else allowed
    chosen, best = pick(allowed, None), None
    for attempt in range(TRIES + MENDS):
        found, clear = offered.visit(offered.found.take(chosen), rng, kicks=0)
        if best is None or len(found.blocked) < len(best.order.blocked):
            best = Visit(replace(found, index=chosen[found.index]), allowed)
        if not found.blocked:
            break
        bad = astray(clear, np.array([found.index[[i, i + 1]] for i in found.blocked]))
        good = np.setdiff1d(np.arange(len(chosen)), bad)
        fewer = allowed & ~like(cell, at, at[chosen[bad]], at[chosen[good]])
        if fewer.sum() < len(chosen):
            break
        allowed = fewer
        chosen = pick(allowed, chosen) if attempt < TRIES else _mended(offered, chosen, bad, allowed)
    assert best is not None
    return best


def _mended(
    offered: Offer,
    chosen: Int[np.ndarray, " n"],
    bad: Int[np.ndarray, " some"],
    allowed: Bool[np.ndarray, " touches"],
) -> Int[np.ndarray, " n"]:
    """The touches with those that lead astray replaced by others that tell nearly the same and have clear ways."""
    at, F = offered.found.approach, offered.rows
    kept = np.delete(chosen, bad)
    F = F @ np.linalg.cholesky(offered.known.covariance(F[chosen]))  # so that distances mean information
    for i in chosen[bad]:
        distance = np.minimum(((F - F[i]) ** 2).sum(axis=1), ((F + F[i]) ** 2).sum(axis=1))
        distance[~allowed] = np.inf
        distance[kept] = np.inf
        near = np.argsort(distance, kind="stable")[:LOOKS]
        pairs = np.array([[a, b] for a in near for b in kept])
        clear = offered.ways.clear(at[pairs[:, 0]], at[pairs[:, 1]], COARSE).reshape(len(near), len(kept)).sum(axis=1)
        kept = np.append(kept, near[int(np.argmax(clear >= min(NEIGHBOURS, clear.max())))])
    return kept


def optimal(offered: Offer, n: int, aim: Aim) -> Pick:
    """Choose what is best by a smooth criterion: greedy, then exchange."""
    P, F = offered.known.precision, offered.rows

    def pick(allowed: Bool[np.ndarray, " touches"], before: Int[np.ndarray, " n"] | None) -> Int[np.ndarray, " n"]:
        some = np.flatnonzero(allowed)
        start = some[greedy(F[some], P, n, aim)] if before is None else before
        C = np.linalg.inv(P + F[start].T @ F[start])
        pool = some[np.argsort(-aim.gains(F[some], C), kind="stable")[:POOL]]
        pool = np.concatenate([start, np.setdiff1d(pool, start)])
        return pool[swapped(F[None, pool], P, np.arange(n), [aim], allowed=allowed[pool])]

    return pick


def robust(offered: Offer, n: int, models: Float[np.ndarray, "models parameters"], zone: bool, worst: bool) -> Pick:
    """Choose what is best over several robots: by the mean of the criterion over them, or with `worst` by the least.

    The criterion is the mean tip variance of each in the `zone`, or else its log det. The first robot is where the
    search begins.
    """
    P, plain = offered.known.precision, Aim()
    aims = [Aim(mean_square(offered.known.tip_rows(offered.zone, theta))) if zone else plain for theta in models]
    all_rows = np.stack([offered.rows_at(theta) for theta in models])

    def pick(allowed: Bool[np.ndarray, " touches"], before: Int[np.ndarray, " n"] | None) -> Int[np.ndarray, " n"]:
        some = np.flatnonzero(allowed)
        start = some[greedy(offered.rows[some], P, n, aims[0])] if before is None else before
        worth = np.zeros(len(some))
        for F, aim in zip(all_rows, aims, strict=True):
            worth += aim.gains(F[some], np.linalg.inv(P + F[start].T @ F[start]))
        pool = some[np.argsort(-worth, kind="stable")[: POOL // 2]]
        pool = np.concatenate([start, np.setdiff1d(pool, start)])
        rows, fit = all_rows[:, pool], allowed[pool]
        alone = swapped(rows[:1], P, np.arange(n), aims[:1], allowed=fit)
        best = swapped(rows, P, alone, aims, allowed=fit)  # the mean leads past sets where the least sticks
        if not worst:
            return pool[best]
        found = [swapped(rows, P, start, aims, allowed=fit, worst=True) for start in (alone, best)]
        least = [min(aim.value(P + F[i].T @ F[i]) for aim, F in zip(aims, rows, strict=True)) for i in found]
        return pool[found[int(np.argmax(least))]]

    return pick


def mean_square(tip: Float[np.ndarray, "poses 3 kept"]) -> Float[np.ndarray, "kept kept"]:
    """B with which tr(B C) is the mean tip variance."""
    return np.einsum("pik,pil->kl", tip, tip, optimize=True) / len(tip)


def greedy(
    F: Float[np.ndarray, "rows kept"], M: Float[np.ndarray, "kept kept"], n: int, aim: Aim
) -> Int[np.ndarray, " n"]:
    """Add the touch that adds most, n times."""
    C = np.linalg.inv(M)
    chosen: list[int] = []
    for _ in range(n):
        gain = aim.gains(F, C)
        gain[chosen] = -1
        i = int(np.argmax(gain))
        chosen.append(i)
        x = C @ F[i]
        C = C - np.outer(x, x) / (1 + F[i] @ x)
    return np.array(chosen)
