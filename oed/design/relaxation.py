"""Approximate designs: the best weights on all candidates, by column generation, with a bound that nothing beats.

The search for weights is `oed.design.column_generation`; why tangents bound a criterion stands in
`oed.criteria.criterion`. Where candidates see less than all parameters, a criterion for the zone is computed in the
space that they see.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from oed.criteria.criteria import criterion_named
from oed.criteria.criterion import Criterion
from oed.criteria.own import check
from oed.design.column_generation import Search
from oed.design.matrix import checked, checked_prior, information, seen, whitener
from oed.design.owners import Owners
from oed.design.weight_limits import admissible


@dataclass(frozen=True, eq=False)
class ApproximateDesign:
    """Weights on the candidates, their worth, and what no admissible weights can beat."""

    criterion: str
    """Its name."""
    weights: Float[np.ndarray, " candidates"]
    """Of the candidates, 1 in all."""
    value: float
    """The criterion of prior + touches * sum of weight * row row'."""
    bound: float
    """The best value that admissible weights, so any admissible set of touches, can have."""
    gap: float
    """By how much the bound exceeds the value, as a share of information."""
    information: Float[np.ndarray, "parameters parameters"]
    """prior + touches * sum of weight * row row'."""
    closeness: Float[np.ndarray, " candidates"]
    """What a candidate gains over what is needed to carry weight."""
    level: float
    """The bound as phi of the information: the efficiency of a set is its phi over this."""
    support: Float[np.ndarray, "parameters parameters"]
    """S of that bound: phi(M) <= tr(S M) for every information M."""
    touches: int
    """That share the weights."""
    rounds: int
    """Of column generation."""

    def __repr__(self) -> str:
        used, gap = int((self.weights > 0).sum()), 100 * self.gap
        return f"<weights on {used} of {len(self.weights)} rows by {self.criterion}: {self.value:.6g}, gap {gap:.2g} %>"


def approximate_design(
    rows: Float[np.ndarray, "rows parameters"],
    criterion: str | Criterion = "D",
    gap: float = 1e-6,
    *,
    touches: int = 1,
    prior: Float[np.ndarray, "parameters parameters"] | None = None,
    zone: np.ndarray | None = None,
    cap: float | Float[np.ndarray, " candidates"] | None = None,
    face: Int[np.ndarray, " candidates"] | None = None,
    quotas: Mapping[int, tuple[float, float]] | None = None,
    owner: Int[np.ndarray, " rows"] | None = None,
    start: Float[np.ndarray, " candidates"] | None = None,
) -> ApproximateDesign:
    """Best weights on the candidates to a relative `gap`; the bound holds whether or not the gap was reached.

    `touches` is the number that shares the weights (it matters beside a prior), `cap` the largest weight (1 / touches
    where no touch is repeated), `quotas` the smallest and largest share of weight per face. Candidates of several
    rows have them one after the other: `owner` counts through the candidates, 0, 0, 0, 1, ... The search begins with
    weights `start`, those of a design on nearly the same candidates, which makes it faster. A criterion is one of
    `CRITERIA` or an object of your own. O2 and O4 have no concave form: their weights are those of E, and their bound
    is nan. E and G have kinks: their gap ends near 1e-3.
    """
    rows = checked(rows)
    measure = criterion_named(criterion).on(zone, rows.shape[1])
    check(measure, rows.shape[1])
    before = checked_prior(prior, rows.shape[1])
    owners = Owners.single(len(rows)) if owner is None else Owners.of(owner, len(rows))
    allowed = admissible(len(owners), cap, face, quotas)
    T, back = _basis(measure, rows, before, touches)
    inner = measure.in_basis(T)
    search = Search(rows, T, before, touches, allowed, measure.needs_zone, owners, start)
    for objective in inner.relaxed.sharpened():
        search.run(objective, gap)
        if search.gap <= gap:
            break
    value, ratio = float(inner.value(search.information, touches)), 1 + search.gap if inner.certified else np.nan
    return ApproximateDesign(
        criterion=measure.name,
        weights=search.all_weights(),
        value=value,
        bound=value * ratio**measure.degree if inner.certified else np.nan,
        gap=ratio - 1,
        information=back.T @ search.information @ back,
        closeness=search.closeness,
        level=inner.phi(search.information) * ratio,
        support=T @ search.support @ T.T,
        touches=touches,
        rounds=search.rounds,
    )


def _basis(
    criterion: Criterion, rows: np.ndarray, prior: np.ndarray, touches: int
) -> tuple[Float[np.ndarray, "p seen"], Float[np.ndarray, "seen p"]]:
    """Change of parameters that makes the numbers tame, and the way back for rows.

    What neither the rows nor the zone see may be left out.
    """
    M = prior + touches * information(rows) / len(rows)
    T, unseen = seen(M)
    if not criterion.needs(unseen, T):
        return T, T.T @ M
    T = criterion.basis(whitener(M))
    return T, np.linalg.inv(T)
