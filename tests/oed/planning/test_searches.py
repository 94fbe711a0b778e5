"""What robots meet with the same touches, counted by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from oed.candidates.hits import MISSES, Outcome
from oed.planning.searches import Searches

WHY = next(iter(MISSES))
OTHER = list(MISSES)[1]


def searches(outcomes, information=None):
    outcomes = np.array(outcomes)
    names = tuple(f"f{i}" for i in range(outcomes.shape[1]))

    class Touches(SimpleNamespace):
        def __len__(self):
            return outcomes.shape[1]

    return Searches(Touches(names=lambda: names), outcomes, information)


def test_misses_are_counted_by_touch_and_by_reason():
    M = Outcome.MEETS
    found = searches([[M, WHY, M], [M, WHY, OTHER], [M, M, M], [M, WHY, OTHER]])

    assert found.missing.tolist() == [0.0, 0.75, 0.5]
    assert found.reasons == {MISSES[WHY]: 0.75, MISSES[OTHER]: 0.5}
    assert [found.reason(i) for i in range(3)] == ["", MISSES[WHY], MISSES[OTHER]]


def test_a_run_stops_after_three_misses_in_a_row_and_not_after_three_apart():
    M = Outcome.MEETS
    found = searches([[WHY, WHY, WHY, M], [WHY, WHY, M, WHY], [M, WHY, WHY, WHY], [M, M, M, M]])

    assert found.stopped == 0.5


def test_touches_that_all_robots_meet_need_no_sentence():
    assert searches(np.full((10, 5), Outcome.MEETS)).sentences() == ()


def test_touches_that_often_miss_are_named_with_their_share():
    outcomes = np.full((10, 5), Outcome.MEETS)
    outcomes[:4, 2] = WHY

    first, second = searches(outcomes).sentences()

    assert first.startswith("of 5 touches about 0.4 miss (8.0 %)")
    assert "3 on f2 (40 %)" in second


def test_further_measurements_count_as_touches_that_nobody_misses(rng):
    rows = rng.standard_normal((6, 4))
    tip = rng.standard_normal((5, 3, 4))
    both = np.tile(rows.T @ rows, (3, 1, 1))

    whole = searches(np.full((3, 6), Outcome.MEETS), both).promise(tip)

    half = searches(np.full((3, 3), Outcome.MEETS), np.tile(rows[:3].T @ rows[:3], (3, 1, 1)))
    assert half.promise(tip, further=rows[3:]).p95_mm == pytest.approx(whole.p95_mm)
    assert half.promise(tip).p95_mm > whole.p95_mm
