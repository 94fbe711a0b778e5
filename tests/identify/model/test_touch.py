"""Tables keep their columns together, whichever rows are taken, put together or passed on the way."""

from dataclasses import fields, replace

import numpy as np
import pytest
from measured import poses_over_jig, touches_at

from identify.model.touch import Plan, joined


@pytest.fixture(scope="module")
def touches(arc_welder):
    rng = np.random.default_rng(3)
    return touches_at(arc_welder, arc_welder.theta, poses_over_jig(arc_welder, 6, rng), rng)


def same(a, b):
    columns = [(getattr(a, f.name), getattr(b, f.name)) for f in fields(a)]
    return all(np.array_equal(x, y, equal_nan=isinstance(x, np.ndarray)) for x, y in columns)


def test_rows_taken_by_number_and_by_mask_are_the_same(touches):
    mask = np.array([True, False, True, False, False, True])

    assert same(touches.take(mask), touches.take(np.array([0, 2, 5])))
    assert touches.take(np.array([5, 0])).ids == (touches.ids[5], touches.ids[0])


def test_parts_that_are_joined_are_the_whole(touches):
    assert same(joined(touches.take(np.arange(2)), touches.take(np.arange(2, 6))), touches)


def test_the_way_to_a_touch_passes_its_postures_and_ends_at_the_approach(rng):
    q, via = rng.uniform(-1, 1, (2, 6)), rng.uniform(-1, 1, (2, 2, 6))
    via[1, 1] = np.nan  # the second touch needs one posture only
    plan = Plan(("a", "b"), ("top",) * 2, np.zeros((2, 3)), np.zeros((2, 3)), q, q + 0.1, via)

    np.testing.assert_array_equal(plan.way(0), [*via[0], q[0] + 0.1])
    np.testing.assert_array_equal(plan.way(1), [via[1, 0], q[1] + 0.1])


def test_a_plan_without_postures_on_the_way_goes_straight_to_the_approach(rng):
    q = rng.uniform(-1, 1, (2, 6))

    plan = Plan(("a", "b"), ("top",) * 2, np.zeros((2, 3)), np.zeros((2, 3)), q, q + 0.1)

    np.testing.assert_array_equal(plan.way(1), [q[1] + 0.1])


def test_a_touch_that_met_nothing_is_no_measurement(touches):
    status = ("hit", "miss", "hit", "skipped", "outlier", "hit")

    measured = replace(touches, status=status).measured()

    assert measured.ids == tuple(touches.ids[i] for i in (0, 2, 5))
    assert touches.measured() is touches
