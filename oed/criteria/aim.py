"""What one touch more is worth: how a criterion grows with a rank-one update of the information."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class Aim:
    """A smooth criterion: log det M, or, where B is given, -log tr(B M^-1); the larger the better.

    A touch with row f added to information M, C = M^-1, raises det M by 1 + f'Cf and lowers tr(B C) by
    f'CBCf / (1 + f'Cf).
    """

    B: Float[np.ndarray, "kept kept"] | None = None

    def value(self, M: Float[np.ndarray, "kept kept"]) -> float:
        """Of information."""
        if self.B is None:
            return float(np.linalg.slogdet(M)[1])
        return -float(np.log(np.trace(np.linalg.solve(M, self.B))))

    def weight(self, C: Float[np.ndarray, "kept kept"]) -> Float[np.ndarray, "kept kept"]:
        """W with which a touch is worth f'Wf / (1 + f'Cf), up to a function that only grows."""
        return C if self.B is None else C @ self.B @ C

    def gains(
        self, rows: Float[np.ndarray, "touches kept"], C: Float[np.ndarray, "kept kept"]
    ) -> Float[np.ndarray, " touches"]:
        """What each touch would add to `value`."""
        plus = 1 + ((rows @ C) * rows).sum(axis=1)
        if self.B is None:
            return np.log(plus)
        less = ((rows @ self.weight(C)) * rows).sum(axis=1) / plus
        return -np.log1p(-less / np.trace(self.B @ C))


def mean_square(tip: Float[np.ndarray, "poses 3 kept"]) -> Float[np.ndarray, "kept kept"]:
    """B with which tr(B C) is the mean tip variance."""
    return np.einsum("pik,pil->kl", tip, tip, optimize=True) / len(tip)
