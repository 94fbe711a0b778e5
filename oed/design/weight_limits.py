"""Admissible weights: they sum to one, none exceeds its cap, and each face gets a share between two limits."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

SLACK = 1e-6  # limits are widened by this share, for an interior; a bound over the wider set holds for the narrower


@dataclass(frozen=True, eq=False)
class Admissible:
    """A set of weights; by `SLACK` larger than what was asked for, never smaller."""

    cap: Float[np.ndarray, " candidates"]  # largest weight of each candidate, 1 if there is none
    group: Int[np.ndarray, " candidates"]  # 0 ... groups - 1
    low: Float[np.ndarray, " groups"]
    high: Float[np.ndarray, " groups"]
    members: tuple[Int[np.ndarray, " some"], ...]  # candidates of each group

    @property
    def capped(self) -> Bool[np.ndarray, " candidates"]:
        """Candidates whose cap can matter."""
        return self.cap < 1

    def best(self, gain: Float[np.ndarray, " candidates"]) -> tuple[float, Float[np.ndarray, " groups"]]:
        """Largest sum of weight * gain over the set, and the gain below which a group takes no more.

        Exact: the limits are nested, so it is best to take what each group must have, then what gains most and fits.
        """
        index = np.concatenate([self._head(gain, group) for group in range(len(self.members))])
        index = index[np.argsort(-gain[index], kind="stable")]
        gains, groups, room = gain[index].tolist(), self.group[index].tolist(), self.cap[index].tolist()
        weight, last = np.zeros(len(self.low)), np.full(len(self.low), np.inf)
        total, rest, margin = 0.0, 1.0, np.inf
        for limit in (self.low, self.high):
            if not (limit > 0).any():
                continue
            for k, (value, group) in enumerate(zip(gains, groups, strict=True)):
                step = min(room[k], limit[group] - weight[group], rest)
                if step > 0:
                    room[k] -= step
                    weight[group] += step
                    rest -= step
                    total += step * value
                    last[group] = value
                    margin = value if limit is self.high else margin
                if rest <= 0:
                    break
        bound = (weight >= self.high) | ((weight <= self.low) & (self.low > 0))
        return total, np.where(bound, last, margin)

    def _head(self, gain: Float[np.ndarray, " candidates"], group: int) -> Int[np.ndarray, " some"]:
        """The candidates of a group that fill its share, best ones, in no order."""
        members = self.members[group]
        few = int(np.ceil(min(self.high[group], 1.0) / self.cap[members].min())) + 1
        if few >= len(members):
            return members
        if few <= 2:
            return members[[int(np.argmax(gain[members]))]]
        return members[np.argpartition(-gain[members], few)[:few]]

    def centre(self, columns: Int[np.ndarray, " columns"]) -> Float[np.ndarray, " columns"]:
        """Weights on some candidates, well inside every limit."""
        capacity = np.bincount(self.group[columns], self.cap[columns], len(self.low))
        high = np.minimum(np.where(self.high < 1, self.high, np.inf), capacity)
        low = np.minimum(np.maximum(self.low, 0), high)
        share = low + (high - low) * (1 - low.sum()) / (high - low).sum()
        return share[self.group[columns]] * self.cap[columns] / capacity[self.group[columns]]

    def enough(self, order: Int[np.ndarray, " candidates"]) -> Int[np.ndarray, " columns"]:
        """The first candidates of an order that, together, leave room inside every limit."""
        need = np.minimum(np.where(self.low > 0, 2 * self.low, 0), 1)
        filled = _filled(self.cap[order], self.group[order], len(need)) < need[self.group[order]]
        filled |= np.cumsum(self.cap[order]) - self.cap[order] < 2
        return order[filled]


def _filled(cap: Float[np.ndarray, " k"], group: Int[np.ndarray, " k"], groups: int) -> Float[np.ndarray, " k"]:
    """What the candidates before each one, of the same group, can hold together."""
    before = np.empty(len(cap))
    for g in range(groups):
        mine = group == g
        before[mine] = np.cumsum(cap[mine]) - cap[mine]
    return before


def admissible(
    count: int,
    cap: float | Float[np.ndarray, " candidates"] | None = None,
    face: Int[np.ndarray, " candidates"] | None = None,
    quotas: Mapping[int, tuple[float, float]] | None = None,
) -> Admissible:
    """Weights on `count` candidates with a cap each and, per face, a smallest and a largest share of the whole."""
    caps = np.minimum(np.broadcast_to(np.asarray(1.0 if cap is None else cap, dtype=float), (count,)), 1.0)
    caps = np.where(caps < 1, caps * (1 + SLACK), 1.0)
    if caps.min() <= 0:
        raise ValueError(f"cap: {caps.min():.3g} for candidate {int(caps.argmin())}, expected more than 0")
    if caps.sum() < 1:
        raise ValueError(
            f"cap: {count} candidates hold a weight of {caps.sum():.3g} together, expected 1; add candidates"
        )
    names, group, members = _groups(count, face, quotas)
    quotas = quotas or {}
    limits = np.array([quotas.get(int(name), (0.0, 1.0)) for name in names], dtype=float).reshape(-1, 2)
    low, high = limits[:, 0] - SLACK * (limits[:, 0] > 0), limits[:, 1] + SLACK
    room = np.bincount(group, caps, len(names))
    for name, (least, most), has in zip(names, limits, room, strict=True):
        if not 0 <= least <= most:
            raise ValueError(f"quota of face {name}: {least:.3g} to {most:.3g}, expected 0 <= smallest <= largest")
        if has < least:
            raise ValueError(f"quota of face {name}: its candidates hold {has:.3g} of the {least:.3g} asked for")
    if low.sum() > 1 or np.minimum(high, room).sum() < 1:
        raise ValueError(
            f"quotas: the faces take between {limits[:, 0].sum():.3g} and {np.minimum(limits[:, 1], room).sum():.3g} "
            "of the touches, expected a range around 1; loosen a quota"
        )
    return Admissible(caps, group, low, high, members)


def _groups(
    count: int, face: Int[np.ndarray, " candidates"] | None, quotas: Mapping[int, tuple[float, float]] | None
) -> tuple[Int[np.ndarray, " groups"], Int[np.ndarray, " candidates"], tuple[Int[np.ndarray, " some"], ...]]:
    """Names of the groups, the group of each candidate, the candidates of each group; one group if nothing is asked."""
    if not quotas:
        return np.zeros(1, int), np.zeros(count, int), (np.arange(count),)
    if face is None or np.shape(face) != (count,):
        raise ValueError(f"quotas: they need `face`, the face of each of the {count} candidates")
    names, group = np.unique(np.asarray(face), return_inverse=True)
    for name, (least, _) in quotas.items():
        if name not in names and least > 0:
            raise ValueError(f"quota of face {name}: no candidate lies on it")
    return names, group, tuple(np.flatnonzero(group == g) for g in range(len(names)))
