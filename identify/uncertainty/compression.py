"""Rows of candidate touches in fewer coordinates, without loss: what no touches could show is a constant."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identify.uncertainty.information import Information, triangular

TOUCHES = 1000  # of the candidate that shows a direction best
SHOWN = 1e-2  # of the prior deviation of a direction, by which so many touches shorten it if it is worth keeping


@dataclass(frozen=True, eq=False)
class Compression:
    """Coordinates y in which the prior is the identity, and rows of touches have few columns.

    x = basis y + (what no touches show). The last coordinate stands for the latter: rows of touches are 0 there, and
    rows of the tip hold the deviation that remains whatever is touched.
    """

    basis: Float[np.ndarray, "unknowns coordinates"]
    rest: Float[np.ndarray, "unknowns others"]

    def rows(self, rows: Float[np.ndarray, "rows unknowns"]) -> Float[np.ndarray, "rows coordinates"]:
        """Rows of touches."""
        return rows @ self.basis

    def tip_rows(self, rows: Float[np.ndarray, "poses 3 unknowns"]) -> Float[np.ndarray, "poses 3 coordinates"]:
        """Rows of the tip at poses [mm], with the same variance at each pose as all unknowns have."""
        out = rows @ self.basis
        out[:, 0, -1] = np.sqrt(((rows @ self.rest) ** 2).sum(axis=(1, 2)))
        return np.asarray(out)


def compression(prior: Information, rows: Float[np.ndarray, "candidates unknowns"]) -> Compression:
    """The right singular directions of candidate rows, in units of the prior, that touches could show.

    A direction counts if TOUCHES touches of the candidate that sees it best shorten its deviation by SHOWN.
    """
    whitened = prior.root(rows)
    _, _, Vt = np.linalg.svd(triangular(whitened))
    best = (np.abs(whitened @ Vt.T).max(axis=0, initial=0.0)) ** 2
    shown = 1 / np.sqrt(1 + TOUCHES * best) < 1 - SHOWN
    inverse = prior.root(np.eye(len(Vt)))  # R^-1
    empty = np.zeros((len(Vt), 1))
    return Compression(np.hstack([inverse @ Vt[shown].T, empty]), inverse @ Vt[~shown].T)
