"""The order of touches: little travel between approaches, on ways that are clear, and the minutes that it takes."""

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from jaxtyping import Float, Int

from identify.model.cell import Cell
from identify.model.touch import Plan
from probe.motion.settings import Settings

USUAL = Settings()
RAMP = USUAL.ramp  # [s]
KICKS = 5000  # a tour of 50 places is broken at random and repaired 100 times, one of 100 places 50 times
DETOUR = 60.0  # [s], what a way that is not clear costs: more than any that is
BOUND = 1e4  # [s], what binds the beginning of a tour to its end
SAMPLES = 17  # of a way, for its length


@dataclass(frozen=True, eq=False)
class Order:
    """An order of touches, the postures between them, and what it costs."""

    index: Int[np.ndarray, " touches"]
    via: Float[np.ndarray, "touches vias joints"]  # on the way to each touch in this order; NaN where there is none
    minutes: float
    blocked: tuple[int, ...]  # places in the order from which the way to the next touch is not clear


def order(
    D: Float[np.ndarray, "touches touches"],
    rng: np.random.Generator,
    *,
    first: Float[np.ndarray, " touches"] | None = None,
    start: Int[np.ndarray, " touches"] | None = None,
    kicks: int | None = None,
) -> tuple[Int[np.ndarray, " touches"], Int[np.ndarray, " blocked"]]:
    """The order that takes the least seconds, and the places in it from which there is no way to the next touch.

    D are the seconds between touches, inf where there is no way: such a step is taken only where there is no order
    without. `first` are the seconds to each from where the robot stands, `start` is an order to begin with, `kicks` how
    often the search is shaken up.
    """
    cost = np.minimum(D, DETOUR)
    tour = shortest(cost, rng, start, kicks=kicks, first=None if first is None else np.minimum(first, DETOUR))
    return tour, np.flatnonzero(cost[tour[:-1], tour[1:]] >= DETOUR)


def travel(cell: Cell, q: Float[np.ndarray, "poses joints"]) -> Float[np.ndarray, "poses poses"]:
    """Seconds from every pose to every other, all joints moving at once and none above its speed."""
    return np.abs((q[:, None] - q[None]) / cell.robot.speed).max(axis=2)


def minutes(
    cell: Cell, plan: Plan, off: Float[np.ndarray, " touches"] | None = None, settings: Settings = USUAL
) -> float:
    """What the touches of a plan take in their order: travel, search, retract and the wait for the signal to clear.

    `off` is how far each contact may be from where those before it predict it [mm, 1 sigma]: the search begins that
    near. Without it, and without the way to the first touch.
    """
    path = np.concatenate([plan.way(i) for i in range(len(plan))])[len(plan.way(0)) - 1 :]
    travelling = seconds(cell, path[:-1], path[1:], settings.move_speed).sum()
    off = np.full(len(plan), np.inf) if off is None else off
    searched = settings.sure * off + settings.disagreement + settings.near  # [mm]
    share = np.minimum(searched / cell.touch.approach, 1.0)[:, None]
    near = plan.q + share * (plan.approach - plan.q)
    nearing = seconds(cell, plan.approach, near, settings.near_speed).sum()
    searching = seconds(cell, near, plan.q, settings.search_speed or cell.touch.speed).sum()
    returning = seconds(cell, plan.q, plan.approach, settings.retract_speed).sum()
    moving = (travelling + nearing + returning) / settings.override
    return float((moving + searching + (settings.rest + settings.clears) * len(plan)) / 60)


def seconds(
    cell: Cell, start: Float[np.ndarray, "ways joints"], end: Float[np.ndarray, "ways joints"], speed: float
) -> Float[np.ndarray, " ways"]:
    """What straight ways in joint space take, from rest to rest, neither joints nor tip [mm/s] too fast."""
    joints = np.maximum(np.abs((end - start) / cell.robot.speed).max(axis=1, initial=0.0), 1e-9)
    tip = cell.kinematics.tip(between(start, end, SAMPLES).reshape(-1, start.shape[1]), cell.theta)[0]
    way = np.linalg.norm(np.diff(tip.reshape(-1, SAMPLES, 3), axis=1), axis=2).sum(axis=1)
    cruise = np.maximum(joints, way / speed)
    ramp = RAMP * joints / cruise  # to the speed of the cruise
    return np.where(ramp <= cruise, cruise + ramp, 2 * np.sqrt(RAMP * joints))


def shortest(
    D: Float[np.ndarray, "places places"],
    rng: np.random.Generator,
    start: Int[np.ndarray, " places"] | None = None,
    *,
    kicks: int | None = None,
    first: Float[np.ndarray, " places"] | None = None,
) -> Int[np.ndarray, " places"]:
    """A short open path through all places, never longer than `start`; `first` is what it costs to begin at each.

    Nearest neighbour, then 2-opt (Croes 1958) and the moving of segments (Or 1976), then broken at random and repaired
    (double bridge; Martin, Otto and Felten 1991). An added place at distance 0 from all others closes the tour; where
    it begins somewhere, that is a place, too, and bound to the added one.
    """
    n = len(D)
    begin = 0.0 if first is None else first
    if n < 4:
        return _by_trial(D, np.zeros(n) + begin)
    closed = np.zeros((n + 2, n + 2))
    closed[:n, :n] = D
    closed[n, :n] = closed[:n, n] = begin
    closed[n, n + 1] = closed[n + 1, n] = -BOUND
    starts = [_nearest_neighbour(closed)] + ([] if start is None else [np.array([n + 1, n, *start])])
    best = min((_improved(closed, tour) for tour in starts), key=lambda tour: _length(closed, tour))
    for _ in range(0 if n < 7 else min(100, KICKS // n) if kicks is None else kicks):
        trial = _improved(closed, _kicked(best, rng))
        if _length(closed, trial) < _length(closed, best) - 1e-12:
            best = trial
    path = np.roll(best, -int(np.flatnonzero(best == n + 1)[0]))
    path = path if path[1] == n else np.roll(path[::-1], 1)
    return path[2:]


def _by_trial(D: Float[np.ndarray, "places places"], first: Float[np.ndarray, " places"]) -> Int[np.ndarray, " places"]:
    paths = [np.array(p, dtype=int) for p in permutations(range(len(D)))]
    return min(paths, key=lambda p: float(D[p[:-1], p[1:]].sum() + first[p[:1]].sum()))


def _length(D: Float[np.ndarray, "places places"], tour: Int[np.ndarray, " places"]) -> float:
    return float(D[tour, np.roll(tour, -1)].sum())


def _nearest_neighbour(D: Float[np.ndarray, "places places"]) -> Int[np.ndarray, " places"]:
    tour, rest = [len(D) - 1], np.ones(len(D), dtype=bool)
    for _ in range(len(D) - 1):
        rest[tour[-1]] = False
        tour.append(int(np.argmin(np.where(rest, D[tour[-1]], np.inf))))
    return np.array(tour)


def _improved(D: Float[np.ndarray, "places places"], tour: Int[np.ndarray, " places"]) -> Int[np.ndarray, " places"]:
    """The tour after the best reversal, or the best shift where none helps, again and again."""
    while True:
        gain, better = _best_reversal(D, tour)
        for k in (1, 2, 3):
            if gain > -1e-9:
                gain, better = _best_shift(D, tour, k)
        if gain > -1e-9:
            return tour
        tour = better


def _best_reversal(
    D: Float[np.ndarray, "places places"], tour: Int[np.ndarray, " places"]
) -> tuple[float, Int[np.ndarray, " places"]]:
    """What the best reversal of a part of the tour changes, and the tour after it (2-opt)."""
    after = _turned(tour, 1)
    step = D[tour, after]
    change = np.triu(D[tour[:, None], tour] + D[after[:, None], after] - step[:, None] - step, 1)
    i, j = np.unravel_index(np.argmin(change), change.shape)
    better = tour.copy()
    better[i + 1 : j + 1] = tour[i + 1 : j + 1][::-1]
    return float(change[i, j]), better


def _best_shift(
    D: Float[np.ndarray, "places places"], tour: Int[np.ndarray, " places"], k: int
) -> tuple[float, Int[np.ndarray, " places"]]:
    """What moving k places elsewhere changes at best, turned around or not, and the tour after it (or-opt)."""
    n = len(tour)
    if n < k + 3:
        return 0.0, tour
    first, last, before, behind = (_turned(tour, shift) for shift in (0, k - 1, -1, k))
    saved = D[before, first] + D[last, behind] - D[before, behind]
    here, there = tour[:, None], _turned(tour, 1)[:, None]  # inserted between these
    straight, turned = D[here, first] + D[last, there], D[here, last] + D[first, there]
    change = np.minimum(straight, turned) - D[here, there] - saved
    offset = (np.arange(n)[:, None] - np.arange(n)) % n
    change[(offset < k) | (offset == n - 1)] = 0.0  # into itself, or where it is already
    at, i = np.unravel_index(np.argmin(change), change.shape)
    rolled = _turned(tour, int(i))
    segment, rest = rolled[:k], rolled[k:]
    if turned[at, i] < straight[at, i]:
        segment = segment[::-1]
    place = int(offset[at, i]) - k + 1
    return float(change[at, i]), np.concatenate([rest[:place], segment, rest[place:]])


def _turned(tour: Int[np.ndarray, " places"], shift: int) -> Int[np.ndarray, " places"]:
    """The tour begun `shift` places later."""
    return np.concatenate([tour[shift:], tour[:shift]])


def _kicked(tour: Int[np.ndarray, " places"], rng: np.random.Generator) -> Int[np.ndarray, " places"]:
    a, b, c = np.sort(rng.choice(np.arange(1, len(tour)), 3, replace=False))
    return np.concatenate([tour[:a], tour[b:c], tour[a:b], tour[c:]])


def between(
    start: Float[np.ndarray, "ways joints"], end: Float[np.ndarray, "ways joints"], samples: int
) -> Float[np.ndarray, "ways samples joints"]:
    """Poses along straight ways, ends included."""
    s = np.linspace(0.0, 1.0, samples)[:, None]
    return start[:, None] + s * (end - start)[:, None]
