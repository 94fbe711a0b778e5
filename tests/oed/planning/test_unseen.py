"""Touches to verify with: away from those of the fit, and spread over what can be touched."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from identify.model.files import InputError
from oed.candidates.candidates import candidates
from oed.planning.unseen import plan_unseen

COUNT = 1500


@pytest.fixture(scope="module")
def offered(arc_welder):
    return candidates(arc_welder, np.random.default_rng(3), COUNT, structured=0.0)


@pytest.fixture(scope="module")
def seen(offered):
    """Touches of a fit, drawn at random."""
    return offered.q[np.random.default_rng(4).permutation(len(offered))[:40]]


@pytest.fixture(scope="module")
def result(arc_welder, seen):
    return plan_unseen(arc_welder, seen, 12, np.random.default_rng(0), count=COUNT)


def test_no_touch_is_near_to_one_of_the_fit(result, seen, offered):
    nearest = np.degrees(np.abs(result.plan.q[:, None] - seen)).max(axis=2).min(axis=1)

    drawn = np.degrees(np.abs(offered.q[:, None] - seen)).max(axis=2).min(axis=1)
    assert nearest.min() == pytest.approx(result.apart)
    assert nearest.min() > np.quantile(drawn, 0.1)


def test_touches_stand_for_all_that_can_be_made_better_than_drawn_ones(result, offered):
    def away(q):
        return cdist(offered.q, q).min(axis=1).mean()

    rng = np.random.default_rng(1)
    drawn = [away(offered.q[rng.permutation(len(offered))[: len(result.plan)]]) for _ in range(20)]

    assert len(result.plan) == 12
    assert away(result.plan.q) < np.median(drawn)
    assert len(set(result.plan.face)) >= 5


def test_without_touches_of_a_fit_none_is_excluded(arc_welder):
    result = plan_unseen(arc_welder, np.empty((0, 6)), 4, np.random.default_rng(0), count=300)

    assert (len(result.plan), result.apart) == (4, None)


def test_more_touches_than_there_are_is_one_sentence(arc_welder, seen):
    with pytest.raises(InputError, match=r"5000 touches are asked for, and \d+ were found"):
        plan_unseen(arc_welder, seen, 5000, np.random.default_rng(0), count=300)
