"""Orders that begin where the robot stands, on ways that are drawn by hand."""

import numpy as np
import pytest

from identify.model.touch import Plan
from oed.planning.uncertain import begun, in_reach

AWAY = np.array([0.0, 1.0, 2.0, 3.0])


class Edges:
    """Ways between places on a line that are no farther apart than `most`."""

    def __init__(self, most=1.0):
        self.most = most

    def clear(self, start, end, step=None):
        return np.abs(start - end).max(axis=1) <= self.most

    def among(self, places):
        return np.abs(places[:, None] - places[None]).max(axis=2) <= self.most


def plan(places):
    q = np.array(places, dtype=float)[:, None]
    ids = tuple(f"{p:g}" for p in places)
    return Plan(ids, ("top",) * len(q), np.zeros((len(q), 3)), np.zeros((len(q), 3)), q, q)


def test_touches_that_no_clear_way_leads_to_are_given_up():
    assert in_reach(plan([0, 1, 5, 2]), Edges()).ids == ("0", "1", "2")


@pytest.mark.parametrize(("last", "order"), [(0, ("1", "2", "3")), (4, ("3", "2", "1"))])
def test_a_plan_begins_at_the_end_that_is_near_to_the_last_touch(last, order):
    assert begun(plan([1, 2, 3]), Edges(), plan([last])).ids == order


def test_a_plan_that_only_another_order_joins_is_put_in_it():
    assert begun(plan([2, 1, 3]), Edges(), plan([0])).ids == ("1", "2", "3")


def test_where_nothing_leads_on_the_robot_goes_back_the_way_it_has_come():
    trail = plan([0, 1, 2, 3])  # and now it stands at 3, from where no way leads to -1

    started = begun(plan([-1]), Edges(), trail)

    assert started.via[0, :, 0].tolist() == [2, 1, 0]


def test_a_plan_that_cannot_be_reached_is_returned_as_it_is():
    far = plan([50, 51])

    assert begun(far, Edges(), plan([0, 1])) is far
    assert begun(far, Edges(), None) is far
