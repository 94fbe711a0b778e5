"""The few coordinates in which touches are compared: all unknowns without loss, or the identifiable parameters."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identify.model.identifiability import structure
from identify.model.measurement import Rows
from identify.uncertainty.information import Information, triangular

TOUCHES = 1000  # of the candidate that shows a direction best
LEAST = 1e-2  # of the prior deviation of a direction, by which so many touches shorten it if it is worth keeping


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Linear coordinates of the unknowns: rows f of touches become f basis.

    Of all unknowns, the last coordinate stands for what no touch shows: rows of touches are 0 there, and rows of the
    tip hold the deviation that remains whatever is touched.
    """

    prior: Information
    basis: Float[np.ndarray, "unknowns coordinates"]
    precision: Float[np.ndarray, "coordinates coordinates"]  # before the touches
    names: tuple[str, ...] = ()  # of identifiable parameters
    rest: Float[np.ndarray, "unknowns others"] | None = None  # directions that no touch shows, 1 sigma each

    def __len__(self) -> int:
        return len(self.precision)

    @property
    def theta(self) -> Float[np.ndarray, " parameters"]:
        """The robot at which rows are taken, if no other is given [mm, rad]."""
        return self.prior.theta

    def rows(self, rows: Rows, theta: Float[np.ndarray, " parameters"] | None = None) -> Float[np.ndarray, "rows k"]:
        """Whitened rows of touches at a robot."""
        return self.prior.unknowns.rows(rows, self.theta if theta is None else theta) @ self.basis

    def tip_rows(
        self, q: Float[np.ndarray, "poses joints"], theta: Float[np.ndarray, " parameters"] | None = None
    ) -> Float[np.ndarray, "poses 3 k"]:
        """Rows of the tip at poses [mm]."""
        return self.of_tip(self.prior.unknowns.tip_rows(q, self.theta if theta is None else theta))

    def of_tip(self, rows: Float[np.ndarray, "poses 3 unknowns"]) -> Float[np.ndarray, "poses 3 k"]:
        """Rows of points by all unknowns [mm], in these coordinates; the variance at each point stays the same."""
        out = np.asarray(rows @ self.basis)
        if self.rest is not None:
            out[:, 0, -1] = np.sqrt(((rows @ self.rest) ** 2).sum(axis=(1, 2)))
        return out

    def information(self, rows: Float[np.ndarray, "rows k"]) -> Float[np.ndarray, "k k"]:
        """Information after touches."""
        return self.precision + rows.T @ rows


def of_all_unknowns(prior: Information, rows: Float[np.ndarray, "candidates unknowns"]) -> Coordinates:
    """The right singular directions of candidate rows, in units of the prior, that touches could show.

    A direction counts if TOUCHES touches of the candidate that sees it best shorten its deviation by LEAST. The prior
    is the identity.
    """
    whitened = prior.root(rows)
    _, _, Vt = np.linalg.svd(triangular(whitened))
    best = np.abs(whitened @ Vt.T).max(axis=0, initial=0.0) ** 2
    visible = 1 / np.sqrt(1 + TOUCHES * best) < 1 - LEAST
    inverse = prior.root(np.eye(len(Vt)))  # R^-1
    basis = np.hstack([inverse @ Vt[visible].T, np.zeros((len(Vt), 1))])
    return Coordinates(prior, basis, np.eye(basis.shape[1]), rest=inverse @ Vt[~visible].T)


def of_identifiable(prior: Information) -> Coordinates:
    """The parameters that tip positions of the drawn robot determine, each with what it carries of the others.

    In this basis designs compare with the literature: faces stand where they are drawn, and the eliminated parameters
    are combined with those that carry them.
    """
    unknowns, cell = prior.unknowns, prior.unknowns.cell
    analysis = structure(cell)
    place = {name: i for i, name in enumerate(unknowns.names)}
    names = [name for i in analysis.kept if (name := analysis.names[i]) in place]
    row = {name: i for i, name in enumerate(names)}
    A = np.zeros((len(names), len(unknowns)))
    A[range(len(names)), [place[name] for name in names]] = 1.0
    for name, terms in analysis.combinations.items():
        for carrier, coefficient in terms.items():
            if name in place and carrier in row:
                i, k = place[name], place[carrier]
                A[row[carrier], i] = coefficient * unknowns.scale[i] / unknowns.scale[k]
    basis = np.eye(len(unknowns))[:, [place[name] for name in names]]
    R = triangular(prior.root(A).T)
    inverse = np.linalg.inv(R)
    return Coordinates(prior, basis, inverse @ inverse.T, tuple(names))
