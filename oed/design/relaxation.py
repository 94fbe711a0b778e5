"""Approximate designs: the best weights on all candidates, by column generation, with a bound that nothing beats.

The search for weights is `oed.design.column_generation`; the functions of information, and why their tangents bound
them, `oed.criteria.concave`.
Where candidates see less than all parameters, a criterion for the zone is asked in the space that they see.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from oed.criteria.concave import Concave, Determinant, Power, Smallest, Trace, Worst
from oed.criteria.criteria import Criterion, checked_zone, criterion_named, score
from oed.design.column_generation import Search
from oed.design.matrix import checked, checked_prior, information, seen, whitener
from oed.design.weight_limits import admissible

UNSEEN = 1e-6  # of the zone's tip rows, in a direction that no row sees: none
SHARPEST = 512.0  # exponent of the smooth stand-ins of E and G
POWER = 0.5  # Kiefer's exponent of O5


@dataclass(frozen=True, eq=False)
class ApproximateDesign:
    """Weights on the candidates, their worth, and what no admissible weights can beat."""

    criterion: str
    weights: Float[np.ndarray, " candidates"]
    value: float  # the criterion of prior + touches * sum of weight * row row'
    bound: float  # the best value that admissible weights, so any admissible set of touches, can have
    gap: float  # by how much the bound exceeds the value, as a share of information
    information: Float[np.ndarray, "parameters parameters"]
    closeness: Float[np.ndarray, " candidates"]  # what a candidate gains over what is needed to carry weight
    level: float  # the bound as phi of the information: the efficiency of a set is its phi over this
    touches: int  # that share the weights
    rounds: int


def approximate_design(
    rows: Float[np.ndarray, "candidates parameters"],
    criterion: str = "D",
    gap: float = 1e-6,
    *,
    touches: int = 1,
    prior: Float[np.ndarray, "parameters parameters"] | None = None,
    zone: np.ndarray | None = None,
    cap: float | Float[np.ndarray, " candidates"] | None = None,
    face: Int[np.ndarray, " candidates"] | None = None,
    quotas: Mapping[int, tuple[float, float]] | None = None,
) -> ApproximateDesign:
    """Best weights on the candidates to a relative `gap`; the bound holds whether or not the gap was reached.

    `touches` is the number that shares the weights (it matters beside a prior), `cap` the largest weight (1 / touches
    where no touch is repeated), `quotas` the smallest and largest share of weight per face. O2 and O4 have no concave
    form: their weights are those of E, and their bound is nan. E and G have kinks: their gap ends near 1e-3.
    """
    chosen, rows = criterion_named(criterion), checked(rows)
    known = checked_prior(prior, rows.shape[1])
    allowed = admissible(len(rows), cap, face, quotas)
    tip = checked_zone(chosen, zone, rows.shape[1]) if chosen.needs_zone else None
    T, back = _basis(chosen, rows, known, touches, tip)
    tip = None if tip is None else tip @ T
    search = Search(rows, T, known, touches, allowed, blind=tip is not None)
    for objective in _objectives(chosen, T, tip):
        search.run(objective, gap)
        if search.gap <= gap:
            break
    return _result(chosen, search, tip, back, touches)


def phi(criterion: Criterion, M: Float[np.ndarray, "p p"], zone: np.ndarray | None = None) -> float:
    """The criterion as a function that is homogeneous of degree one in the information, larger being better."""
    value = float(score(criterion, M, 1, zone))
    return value ** (1 / criterion.degree) if criterion.degree else value


def _basis(
    criterion: Criterion, rows: np.ndarray, prior: np.ndarray, touches: int, zone: np.ndarray | None
) -> tuple[Float[np.ndarray, "p seen"], Float[np.ndarray, "seen p"]]:
    """Change of parameters that makes the numbers tame, and the way back for rows.

    Eigenvalues allow no more than a change of unit. The zone allows to leave out what neither it nor a row sees.
    """
    M = prior + touches * information(rows) / len(rows)
    if zone is not None:
        T, unseen = seen(M)
        if np.abs(zone @ unseen).max(initial=0.0) < UNSEEN * np.abs(zone @ T).max(initial=0.0):
            return T, T.T @ M
    T = whitener(M)
    if criterion.keeps == "rotation" and criterion.bound != "trace":
        T = np.eye(len(T)) * np.exp(np.linalg.slogdet(T)[1] / len(T))
    return T, np.linalg.inv(T)


def _objectives(
    criterion: Criterion, basis: Float[np.ndarray, "p seen"], zone: Float[np.ndarray, "poses axes seen"] | None
) -> Iterator[Concave]:
    """The functions to maximise one after the other, in the new basis, each sharper than the one before."""
    if criterion.bound == "determinant":
        yield Determinant()
    elif criterion.bound == "trace":
        yield Trace(basis if zone is None else np.linalg.qr(zone.reshape(-1, zone.shape[-1]), "r") / np.sqrt(len(zone)))
    elif criterion.bound == "power":
        yield Power(POWER)
    else:
        exponent = 2.0
        while exponent <= SHARPEST:
            yield Smallest(exponent) if zone is None else Worst(zone, exponent)
            exponent *= 4


def _result(
    criterion: Criterion, search: Search, zone: np.ndarray | None, back: Float[np.ndarray, "seen p"], touches: int
) -> ApproximateDesign:
    """The design in the units that came in."""
    M = back.T @ search.information @ back
    told = M if zone is None else search.information
    value, ratio = float(score(criterion, told, touches, zone)), 1 + search.gap if criterion.bound else np.nan
    return ApproximateDesign(
        criterion=criterion.name, weights=search.all_weights(), value=value, gap=ratio - 1, information=M,
        bound=value * ratio**criterion.degree if criterion.bound else np.nan, closeness=search.closeness,
        level=phi(criterion, told, zone) * ratio, touches=touches, rounds=search.rounds,
    )  # fmt: skip
