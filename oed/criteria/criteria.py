"""The table of criteria: what makes one set of touches better than another, each with its source.

An index of observability is a function of the singular values of the whitened rows, in descending order; a criterion
for the weld zone is a function of the predicted tip variances at its poses. Functions take a batch: the last axis
counts.
"""

import numpy as np
from jaxtyping import Float

from oed.criteria.criterion import Batch, Criterion
from oed.criteria.eigenvalues import Conditioning, GeometricMean, PowerMean, Smallest
from oed.criteria.variances import LargestVariance, MeanVariance, ParameterVariance

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


def a(variances: Variances) -> Batch:
    """Sum of the parameter variances."""
    return variances.sum(axis=-1)


def e(sigma: Sigma) -> Batch:
    """Smallest eigenvalue of the information."""
    return sigma[..., -1] ** 2


def v(variances: Variances) -> Batch:
    """Mean tip variance over the zone [mm^2]."""
    return variances.mean(axis=-1)


def g(variances: Variances) -> Batch:
    """Largest tip variance in the zone [mm^2]."""
    return variances.max(axis=-1)


BORM = "Borm and Menq 1991"
DRIELS = "Driels and Pathre 1990"
NAHVI = "Nahvi, Hollerbach and Hayward 1994"
AMPLIFICATION = "Nahvi and Hollerbach 1996"
SUN = "Sun and Hollerbach 2008"
PUKELSHEIM = "Pukelsheim 1993"

CRITERIA: dict[str, Criterion] = {
    c.name: c
    for c in (
        GeometricMean("O1", 0.5, "ranking", BORM, o1),
        Conditioning("O2", 0.0, "rotation", DRIELS, o2),
        Smallest("O3", 0.5, "rotation", NAHVI, o3),
        Conditioning("O4", 0.5, "rotation", AMPLIFICATION, o4),
        PowerMean("O5", 0.5, "rotation", SUN, o5, exponent=0.5),
        GeometricMean("D", 1.0, "ranking", PUKELSHEIM, d),
        ParameterVariance("A", -1.0, "rotation", PUKELSHEIM, a),
        Smallest("E", 1.0, "rotation", PUKELSHEIM, e),
        MeanVariance("V", -1.0, "value", PUKELSHEIM, v),
        LargestVariance("G", -1.0, "value", PUKELSHEIM, g),
    )
}


def criterion_named(name: str | Criterion) -> Criterion:
    """The row of the table called `name`; a criterion itself is returned as it is."""
    if isinstance(name, Criterion):
        return name
    if name not in CRITERIA:
        raise ValueError(f"criterion '{name}' is unknown; choose one of {', '.join(CRITERIA)}")
    return CRITERIA[name]


def score(
    criterion: str | Criterion, M: Float[np.ndarray, "*batch p p"], touches: int = 1, zone: np.ndarray | None = None
) -> Batch:
    """Value of the criterion for total information M of `touches` touches; a batch of matrices gives a batch of values.

    Only O1 and D are per touch, by definition; the others score all touches together, so V and G are mm^2 of this plan.
    """
    return criterion_named(criterion).on(zone, np.shape(M)[-1]).value(M, touches)
