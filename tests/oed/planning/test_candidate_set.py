"""What candidates promise: less error for more touches, and deviations that are those of the closed form."""

import numpy as np
import pytest
from few_candidates import few

from oed.planning.candidate_set import plan_of

pytestmark = pytest.mark.xdist_group("few candidates")


def test_touches_made_more_often_promise_more_and_none_promise_what_is_known():
    touches = few().candidates.take(np.arange(0, 300, 10))

    errors = [few().promise(touches, times).p95_mm for times in (1e-9, 0.5, 1.0, 4.0)]

    assert errors == sorted(errors, reverse=True)
    before = np.sqrt((few().prior.variance(few().tip)).sum(axis=1))  # of the tip, at the poses of the zone
    assert few().promise(touches, 1e-9).rms_mm == pytest.approx(np.sqrt((before**2).mean()), rel=0.1)  # 250 robots


def test_a_contact_is_foreseen_as_well_as_the_touches_before_it_allow():
    touches = few().candidates.take(np.arange(0, 300, 30))
    rows, prior = few().rows_of(touches), few().prior

    deviation = few().deviations(touches)

    for i, f in enumerate(rows):
        known = prior.updated(rows[:i]).variance(f[None])[0]
        assert deviation[i] == pytest.approx(np.sqrt(known + 1) * few().cell.touch.sigma, rel=1e-6)


def test_a_set_of_other_candidates_keeps_its_coordinates_and_its_zone():
    some = few().with_candidates(few().candidates.take(np.arange(20)))

    assert some.all_unknowns is few().all_unknowns
    assert some.zone is few().zone
    assert len(some.rows) == 20


def test_a_plan_numbers_touches_in_the_order_asked_for():
    found = few().candidates

    plan = plan_of(found, np.array([7, 3]))

    assert plan.ids == ("1", "2")
    np.testing.assert_array_equal(plan.q, found.q[[7, 3]])
    assert plan.face == tuple(found.faces[found.face[i]].name for i in (7, 3))
