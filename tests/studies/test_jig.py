"""The study of the jig: where a jig goes that is moved, and what a second place can and cannot buy."""

import numpy as np
import pytest

from identify.model.frames import transform
from studies import jig


def test_a_moved_jig_is_where_the_robot_finds_it(arc_welder, rng):
    at = np.array([30.0, -40.0, 50.0, 0.3, -0.2, 0.1])
    middle = np.array([200.0, 150.0, 100.0])
    point = rng.uniform(0, 300, 3)  # of the jig, in its own frame

    cell = jig.moved(arc_welder, at)

    before, after = (np.linalg.inv(transform(c.base)) @ np.append(point, 1) for c in (arc_welder, cell))
    turn = transform(at)
    expected = turn[:3, :3] @ (point - middle) + middle + at[:3]  # in the frame in which the jig stood
    assert np.linalg.inv(transform(arc_welder.base)) @ np.append(expected, 1) == pytest.approx(after)
    assert np.linalg.norm(before - after) > 10


def test_a_second_place_never_hurts_and_is_worth_most_where_it_is_known():
    rows = jig.run(np.random.default_rng(0), "second", "150 mm higher", 300, 4, 0)

    alone, known, unknown = (row["promised_mm"] for row in rows)
    assert known * (1 - 1e-3) < unknown < alone * (1 + 1e-3)
    assert known < 0.97 * alone
