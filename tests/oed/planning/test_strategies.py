"""Strategies choose as many touches as asked, of those on offer, and repeat themselves."""

import numpy as np
import pytest
from few_candidates import few

from oed.planning.strategies import Setting

pytestmark = pytest.mark.xdist_group("few candidates")


def setting(strategy):
    return Setting(few(), "V", strategy, np.random.default_rng(1))


@pytest.mark.parametrize("strategy", ["even", "random"])
def test_a_quick_choice_has_its_number_repeats_itself_and_is_of_the_offer(strategy):
    first, second = (setting(strategy).quickly(9) for _ in range(2))

    assert len(first) == 9
    np.testing.assert_array_equal(first.q, second.q)
    offered = {q.tobytes() for q in few().candidates.q}
    assert {q.tobytes() for q in first.q} <= offered


def test_more_touches_take_fewer_local_searches_and_kinks_few():
    counts = [setting("optimal")._searches(n) for n in (20, 50, 100)]

    assert counts == sorted(counts, reverse=True)
    assert Setting(few(), "E", "optimal", np.random.default_rng(1))._searches(50) < counts[1]


def test_progress_is_told_before_the_choice_is_made():
    told = []

    choice = setting("even").choose(4, lambda stage, share: told.append((stage, share)))

    assert told[0] == ("choosing", 0.0)
    assert len(choice.touches) == 4
    assert choice.efficiency is None  # no bound is claimed for it
