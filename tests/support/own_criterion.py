"""A criterion of one's own: the geometric mean of others, as a user would write it."""

from dataclasses import dataclass, replace

import numpy as np

from oed.criteria.criterion import Criterion


@dataclass(frozen=True, eq=False)
class Compromise(Criterion):
    """Geometric mean of some criteria."""

    parts: tuple[Criterion, ...]

    def raw(self, M):
        return np.exp(np.mean([part.power(part.raw(M)) for part in self.parts], axis=0))

    def slope(self, M):
        return np.mean([part.slope(M) for part in self.parts], axis=0)

    def curvature(self, M, X):
        return np.mean([part.curvature(M, X) for part in self.parts], axis=0)

    def on(self, zone, parameters):
        return replace(self, parts=tuple(part.on(zone, parameters) for part in self.parts))

    def in_basis(self, T):
        return replace(self, parts=tuple(part.in_basis(T) for part in self.parts))
