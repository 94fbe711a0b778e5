"""The strategies to compare with: points spread evenly over the faces, as the paper has them, and random ones."""

import numpy as np
from jaxtyping import Bool, Float, Int

from oed.candidates.candidates import Candidates

STEP = np.array([0.7548776662466927, 0.5698402909980532])  # of the plastic number: fills a square evenly (Roberts 2018)


def even(candidates: Candidates, n: int, allowed: Bool[np.ndarray, " touches"] | None = None) -> Int[np.ndarray, " n"]:
    """Touches at points spread evenly over the reachable faces, as many on each as its area asks for.

    The posture is the one that the nearest unused candidate, of those allowed, happens to have.
    """
    some = np.arange(len(candidates)) if allowed is None else np.flatnonzero(allowed)
    return some[_even(candidates.take(some), n)]


def _even(candidates: Candidates, n: int) -> Int[np.ndarray, " n"]:
    touches: list[int] = []
    for face, count in enumerate(quotas(candidates, n)):
        mine = np.flatnonzero(candidates.face == face)
        at = candidates.faces[face].fractions(candidates.point[mine])
        low, high = (at.min(axis=0), at.max(axis=0)) if len(mine) else (np.zeros(2), np.ones(2))
        free = np.ones(len(mine), dtype=bool)
        for k in range(count):
            target = low + ((0.5 + (k + 1) * STEP) % 1) * (high - low)
            distance = np.where(free, np.linalg.norm((at - target) * candidates.faces[face].size, axis=1), np.inf)
            nearest = int(np.argmin(distance))
            free[nearest] = False
            touches.append(int(mine[nearest]))
    return np.array(touches)


def quotas(candidates: Candidates, n: int) -> Int[np.ndarray, " faces"]:
    """How many of n touches each face gets: by the area on which it can be touched, rounded so that the sum is n.

    A face gets no more than it has candidates.
    """
    area: Float[np.ndarray, " faces"] = np.zeros(len(candidates.faces))
    for face, number in enumerate(candidates.number):
        if number:
            at = candidates.faces[face].fractions(candidates.point[candidates.face == face])
            area[face] = max(float((np.ptp(at, axis=0) * candidates.faces[face].size).prod()), 1e-9)
    share = n * area / area.sum()
    count = np.minimum(np.floor(share).astype(int), candidates.number)
    while count.sum() < min(n, len(candidates)):
        room = np.where(count < candidates.number, share - count, -np.inf)
        count[int(np.argmax(room))] += 1
    return count
