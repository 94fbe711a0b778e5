"""A criterion of one's own: Kiefer's matrix mean of order 2, between A (order 1) and E (infinite order)."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

import identify
import oed
from oed.criteria.eigenvalues import PowerMean


def k2(sigma: Float[np.ndarray, "*batch parameters"]) -> Float[np.ndarray, "*batch"]:
    """Inverse root of the root of the sum of squared variances."""
    return (sigma**-4.0).sum(axis=-1) ** -0.25


# value grows with information^0.5 and changes with the units of the parameters; relaxation, exchange, refinement and
# certificates follow from the order of the mean
K2 = PowerMean("K2", 0.5, "rotation", "Kiefer 1974", k2, exponent=2.0)


def main() -> None:
    """Plan by it and by V and compare; touchcal study strategies --criterion own_criterion.py:K2 does by 200 robots."""
    oed.CRITERIA[K2.name] = K2
    cell = identify.read_cell(identify.library("cells")["arc-welder"])
    near, link = (3.0, np.radians(0.5)), (1.0, np.radians(0.3))  # 1 sigma [mm, rad]: few touches miss
    cell = replace(cell, priors=replace(cell.priors, base=near, tool=near, link=link))
    for name in ("K2", "V"):
        result = oed.plan(cell, 30, name, rng=np.random.default_rng(0), count=1500)
        print(f"by {name}: K2 {result.indices['K2']:.5g}, promised 95 % {result.promise.p95_mm:.3f} mm")


if __name__ == "__main__":
    main()
