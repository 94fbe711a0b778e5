"""What makes one set of touches better than another: one function and one row of the table each.

An index of observability is a function of the singular values of the whitened rows, in descending order; a criterion
for the weld zone is a function of the predicted tip variances at its poses. Both take a batch: the last axis counts.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

Batch = Float[np.ndarray, "*batch"]
Sigma = Float[np.ndarray, "*batch parameters"]
Variances = Float[np.ndarray, "*batch poses"]


def o1(sigma: Sigma) -> Batch:
    """Geometric mean of the singular values, taken per touch."""
    return np.exp(np.log(sigma).mean(axis=-1))


def o2(sigma: Sigma) -> Batch:
    """Inverse condition number."""
    return sigma[..., -1] / sigma[..., 0]


def o3(sigma: Sigma) -> Batch:
    """Smallest singular value."""
    return sigma[..., -1]


def o4(sigma: Sigma) -> Batch:
    """Noise amplification index, smallest singular value squared over largest."""
    return sigma[..., -1] ** 2 / sigma[..., 0]


def o5(sigma: Sigma) -> Batch:
    """Inverse of the sum of inverse singular values."""
    return 1 / (1 / sigma).sum(axis=-1)


def d(sigma: Sigma) -> Batch:
    """D-value det(X'X / n)^(1/p), the volume of the confidence ellipsoid, taken per touch."""
    return np.exp(2 * np.log(sigma).mean(axis=-1))


def a(sigma: Sigma) -> Batch:
    """Sum of the parameter variances."""
    return (sigma**-2).sum(axis=-1)


def e(sigma: Sigma) -> Batch:
    """Smallest eigenvalue of the information."""
    return sigma[..., -1] ** 2


def v(variances: Variances) -> Batch:
    """Mean tip variance over the zone [mm^2]."""
    return variances.mean(axis=-1)


def g(variances: Variances) -> Batch:
    """Largest tip variance in the zone [mm^2]."""
    return variances.max(axis=-1)


@dataclass(frozen=True)
class Criterion:
    """One way to score the information of a set of touches.

    `degree` says how the value grows when the information is scaled, as information**degree; with a positive or zero
    degree larger is better. `keeps` is what survives a change of units or of base frame, that is rows X T for a regular
    T: the ranking of all designs, the value itself (the zone changes along), or nothing unless T is a rotation. `swaps`
    names the formula that drives the exchange: determinants and traces have one of their own, all others are screened.
    `bound` names the concave function that certifies it (see `oed.criteria.concave`); without
    one there is no efficiency.
    """

    name: str
    function: Callable[[np.ndarray], np.ndarray]
    of: Literal["singular values", "tip variances"]
    degree: float
    keeps: Literal["ranking", "value", "rotation"]
    source: str
    per_touch: bool = False
    swaps: Literal["determinant", "trace", "screened"] = "screened"
    bound: Literal["determinant", "trace", "power", "smallest", "worst", None] = None

    @property
    def larger_is_better(self) -> bool:
        """Whether a plan wants this value large."""
        return self.degree >= 0

    @property
    def needs_zone(self) -> bool:
        """Whether the poses of the weld zone are needed to score."""
        return self.of == "tip variances"

    @property
    def meaning(self) -> str:
        """One sentence for people."""
        return (self.function.__doc__ or "").split("\n")[0]


BORM = "Borm and Menq 1991"
DRIELS = "Driels and Pathre 1990"
NAHVI = "Nahvi, Hollerbach and Hayward 1994"
AMPLIFICATION = "Nahvi and Hollerbach 1996"
SUN = "Sun and Hollerbach 2008"
PUKELSHEIM = "Pukelsheim 1993"
SIGMA: Literal["singular values"] = "singular values"
ZONE: Literal["tip variances"] = "tip variances"

CRITERIA = {
    c.name: c
    for c in (
        Criterion("O1", o1, SIGMA, 0.5, "ranking", BORM, per_touch=True, swaps="determinant", bound="determinant"),
        Criterion("O2", o2, SIGMA, 0.0, "rotation", DRIELS),
        Criterion("O3", o3, SIGMA, 0.5, "rotation", NAHVI, bound="smallest"),
        Criterion("O4", o4, SIGMA, 0.5, "rotation", AMPLIFICATION),
        Criterion("O5", o5, SIGMA, 0.5, "rotation", SUN, bound="power"),
        Criterion("D", d, SIGMA, 1.0, "ranking", PUKELSHEIM, per_touch=True, swaps="determinant", bound="determinant"),
        Criterion("A", a, SIGMA, -1.0, "rotation", PUKELSHEIM, swaps="trace", bound="trace"),
        Criterion("E", e, SIGMA, 1.0, "rotation", PUKELSHEIM, bound="smallest"),
        Criterion("V", v, ZONE, -1.0, "value", PUKELSHEIM, swaps="trace", bound="trace"),
        Criterion("G", g, ZONE, -1.0, "value", PUKELSHEIM, bound="worst"),
    )
}


def criterion_named(name: str) -> Criterion:
    """The row of the table called `name`."""
    if name not in CRITERIA:
        raise ValueError(f"criterion '{name}' is unknown; choose one of {', '.join(CRITERIA)}")
    return CRITERIA[name]


def checked_zone(criterion: Criterion, zone: np.ndarray | None, parameters: int) -> Float[np.ndarray, "poses axes p"]:
    """The zone as tip Jacobians (poses, axes, parameters); a moment matrix, one pose of the same mean."""
    if zone is None:
        raise ValueError(f"criterion '{criterion.name}' scores the weld zone; give `zone`, its whitened tip Jacobians")
    zone = np.asarray(zone, dtype=float)
    if zone.shape == (parameters, parameters):
        if criterion.function is not v:
            raise ValueError(f"criterion '{criterion.name}' needs every pose of the zone, not their moment matrix")
        eigenvalues, V = np.linalg.eigh(zone)
        zone = (np.sqrt(np.maximum(eigenvalues, 0))[:, None] * V.T)[None]
    if zone.ndim != 3 or zone.shape[2] != parameters or not np.isfinite(zone).all():
        raise ValueError(f"zone: shape {zone.shape}, expected finite numbers of shape (poses, 3, {parameters})")
    return zone


def score(
    criterion: str | Criterion,
    M: Float[np.ndarray, "*batch p p"],
    touches: int = 1,
    zone: np.ndarray | None = None,
) -> np.ndarray:
    """Value of the criterion for total information M of `touches` touches; a batch of matrices gives a batch of values.

    Only O1 and D are per touch, by definition; the others score all touches together, so V and G are mm^2 of this plan.
    """
    criterion = criterion_named(criterion) if isinstance(criterion, str) else criterion
    M = np.asarray(M, dtype=float) / (touches if criterion.per_touch else 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        if criterion.of == SIGMA:
            return criterion.function(np.sqrt(np.maximum(np.linalg.eigvalsh(M), 0))[..., ::-1])
        zone = checked_zone(criterion, zone, M.shape[-1])
        return criterion.function(tip_variances(M, zone))


def tip_variances(
    M: Float[np.ndarray, "*batch p p"], zone: Float[np.ndarray, "poses axes p"]
) -> Float[np.ndarray, "*batch poses"]:
    """Predicted tip variance tr(J C J') at every pose of the zone [mm^2], C = M^-1; infinite where M is singular."""
    eigenvalues, V = np.linalg.eigh(M)
    spread = (zone.reshape(-1, zone.shape[-1]) @ V) ** 2  # (*batch, poses * axes, p)
    spread = spread.reshape(*M.shape[:-2], *zone.shape).sum(axis=-2)
    inverse = np.where(eigenvalues > 0, 1 / np.where(eigenvalues > 0, eigenvalues, 1), np.inf)
    return (spread @ inverse[..., None])[..., 0]
