"""How accurate more or fewer touches would make the robot: the curve, its floor, the smallest number for a target."""

from collections.abc import Callable

import numpy as np

from identify.model.files import InputError
from oed.candidates.candidates import Candidates
from oed.planning.candidate_set import CandidateSet

MOST = 1000  # touches that a target may ask for: three hours
MISSES = 0.05  # share of the touches that miss, above which they are why a target cannot be promised
USUAL = 50  # touches from which others are extrapolated
ENDLESS = 1e6  # times that touches are made to see what they leave at last
LEVEL = 0.8  # of the error of the fewest touches that the most leave, from which sets of each number are chosen
FEW = (0.5, 1.5, 2.5)  # of these, beside the number planned
QUICK = 120  # touches up to which larger sets are chosen for the curve alone
STEPS = (0.5, 0.65, 0.8, 1.0, 1.25, 1.5, 2.0, 3.0, 4.0)  # of the curve, times the number planned


def curve(
    candidate_set: CandidateSet, touches: Candidates, choose: Callable[[int], Candidates]
) -> tuple[tuple[int, float], ...]:
    """Numbers of touches, and the promised tip error [mm] after each; it never rises.

    They are touches like these, made more or less often. Where robots that miss most of these decide, that changes
    nothing, and `choose` makes a set of each number. A quantile of normal errors falls with their covariance (Anderson
    1955), that of draws but for their scatter: the curve is level there.
    """
    n = len(touches)
    counts = sorted({max(1, round(step * n)) for step in STEPS})
    errors = np.array([candidate_set.promise(touches, m / n).p95_mm for m in counts])
    if errors[-1] > LEVEL * errors[0] and candidate_set.searches(touches).missing.mean() > MISSES:
        most = min(max(QUICK, n // 2), len(candidate_set.candidates))
        counts = sorted({m for step in FEW if 1 <= (m := round(step * n)) <= most} | {n})
        errors = np.array([candidate_set.promise(touches if m == n else choose(m)).p95_mm for m in counts])
    here = counts.index(n)
    errors[here::-1] = np.maximum.accumulate(errors[here::-1])
    errors[here:] = np.minimum.accumulate(errors[here:])
    return tuple(zip(counts, errors.tolist(), strict=True))


def smallest(candidate_set: CandidateSet, target: float, choose: Callable[[int], Candidates]) -> int:
    """The smallest number of touches whose promised tip error in the zone is below `target` [mm].

    `choose` makes a set of so many touches. Raises InputError where no number does it, with the floor.
    """
    first = choose(min(USUAL, len(candidate_set.candidates)))
    _possible(candidate_set, target, first)
    high, low = _guess(candidate_set, first, target), 0
    while not _meets(candidate_set, choose(high), target):
        low = high
        if low >= MOST:
            raise InputError(
                f"target {target:g} mm: even {MOST} touches promise no better than "
                f"{candidate_set.promise(choose(MOST)).p95_mm:.3f} mm (95 %); raise the target, or touch more exactly"
            )
        high = min(max(high + 1, round(1.1 * high)), MOST)
    while high - low > 1:
        middle = max(low + 1, min(high - 1, round(0.9 * high) if low == 0 else (low + high) // 2))
        if _meets(candidate_set, choose(middle), target):
            high = middle
        else:
            low = middle
    return high


def _meets(candidate_set: CandidateSet, touches: Candidates, target: float) -> bool:
    return candidate_set.promise(touches).p95_mm <= target


def _possible(candidate_set: CandidateSet, target: float, touches: Candidates) -> None:
    """Raise InputError where even infinitely many touches would leave more than the target."""
    floor = candidate_set.promise(touches, ENDLESS).p95_mm
    if target > floor:
        return
    searches = candidate_set.searches(touches)
    if searches.missing.mean() > MISSES:
        share = 100 * searches.missing.mean()
        raise InputError(
            f"target {target:g} mm: no number of touches can promise it. About {share:.0f} % of the "
            f"touches of robots with these tolerances miss, and 5 of 100 robots miss so many that {floor:.3f} mm "
            "(95 %) remain; measure base and tool better, or use touchcal campaign, which begins with long searches"
        )
    tolerance = max(face.tolerance for face in touches.faces)
    raise InputError(
        f"target {target:g} mm: no number of touches can promise it. The faces of the jig stand where they should to "
        f"{tolerance:g} mm (1 sigma), and that alone leaves {floor:.3f} mm (95 %) in the zone; use a more exact jig, "
        "or one with more faces"
    )


def _guess(candidate_set: CandidateSet, touches: Candidates, target: float) -> int:
    """The number at which touches like these would meet the target."""
    low, high = 1, MOST
    while low < high:
        middle = (low + high) // 2
        meets = candidate_set.promise(touches, middle / len(touches)).p95_mm <= target
        low, high = (low, middle) if meets else (middle + 1, high)
    return low
