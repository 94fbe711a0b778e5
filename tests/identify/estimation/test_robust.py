"""Outliers are called at the rate that is stated, and an estimate rests on the rows that agree."""

from dataclasses import replace

import numpy as np
import pytest
from measured import poses_over_jig, table_2, touches_at
from scipy.stats import norm

from identify.estimation.problem import Problem
from identify.estimation.robust import FALSE_ALARM, estimate, limit, scatter
from identify.model.measurement import rows

WRONG = [3, 17, 42]


@pytest.mark.parametrize("count", [1, 30, 1000])
def test_one_of_all_good_rows_exceeds_the_limit_as_rarely_as_stated(count):
    inside = (2 * norm.cdf(limit(count)) - 1) ** count

    assert 1 - inside == pytest.approx(FALSE_ALARM, rel=0.01)


def posed(cell, sigma=0.05, stated=0.05):
    rng = np.random.default_rng(3)
    touches = touches_at(cell, table_2(cell), poses_over_jig(cell, 80, rng), rng, sigma)
    offset = touches.offset.copy()
    offset[WRONG] += 5.0  # [mm]
    wrong = replace(touches, offset=offset, sigma=np.full(80, stated))
    return Problem.pose(cell, rows(cell.wire, [wrong]), "cauchy", True)


@pytest.fixture(scope="module")
def problem(arc_welder):
    return posed(arc_welder)


def test_touches_five_millimetres_off_are_left_out_and_no_others(problem):
    found = estimate(problem)

    assert np.flatnonzero(~found.used).tolist() == WRONG
    assert (found.weight[WRONG] == 0).all()


def test_an_estimate_that_begins_with_good_rows_takes_in_the_others(problem):
    whole = estimate(problem)
    some = whole.used & (np.arange(80) % 4 > 0)

    grown = estimate(problem, inliers=some)

    np.testing.assert_array_equal(grown.used, whole.used)
    np.testing.assert_allclose(problem.theta(grown.x), problem.theta(whole.x), atol=1e-3)


def test_residuals_larger_than_stated_are_noise_that_chance_does_not_explain(arc_welder):
    problem = posed(arc_welder, sigma=0.2)
    found = estimate(problem)

    deviation, significant = scatter(problem, found)

    assert deviation == pytest.approx(4.0, rel=0.2)
    assert significant
    assert 1.5 < found.noise < deviation  # ten degrees of freedom hold it to what is stated
