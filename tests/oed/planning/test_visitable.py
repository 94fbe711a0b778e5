"""Choosing what can be visited: what leads nowhere is given up, and the choice keeps to what is allowed."""

import numpy as np
import pytest
from few_candidates import few

from oed.planning.visitable import Best, joined, measured, visited

pytestmark = pytest.mark.xdist_group("few candidates")


def test_what_is_chosen_is_allowed_and_no_touch_is_chosen_twice():
    allowed = np.arange(len(few().candidates)) % 3 > 0

    chosen = Best(few(), 12, "V", searches=2)(allowed, None)

    assert len(set(chosen.tolist())) == 12
    assert allowed[chosen].all()


def test_the_best_is_better_than_touches_drawn_and_no_better_than_its_bound(rng):
    best = Best(few(), 12, "V", searches=2)
    everything = np.ones(len(few().candidates), dtype=bool)

    def phi(index):
        return best.measure.phi(best.coordinates.information(best.rows[index]))

    reached = phi(best(everything, None))

    assert reached > max(phi(rng.choice(len(everything), 12, replace=False)) for _ in range(30))
    assert reached <= best.bound(everything).level


def test_an_order_visits_what_was_chosen(rng):
    def pick(allowed, before):
        return np.flatnonzero(allowed)[:6]

    visit = visited(few(), pick, rng)

    assert visit.allowed[visit.order.index].all()
    assert len(set(visit.order.index.tolist())) == 6


def test_no_touches_are_joined_to_nothing():
    core = few().candidates.take(np.arange(3))

    assert joined(few(), core, few().candidates.take(np.arange(0))).shape == (0,)


@pytest.mark.parametrize("criterion", ["V", "D"])
def test_a_criterion_of_the_zone_is_given_its_poses(criterion):
    measure = measured(criterion, few())

    assert (getattr(measure, "J", None) is not None) == measure.needs_zone
