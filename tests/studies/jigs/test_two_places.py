"""What a second place of a jig can and cannot buy."""

import numpy as np
import pytest

from identify.model.frames import transform
from studies.common import zone
from studies.jigs import two_places
from studies.many import draw_many


def test_a_jig_that_is_put_elsewhere_keeps_its_shape_and_its_table(arc_welder):
    put = two_places.put(arc_welder.jig, np.array([200.0, 10.0, 150.0, np.pi / 2, 0.0, 0.0]))

    for was, now in zip(arc_welder.jig.faces, put.faces, strict=True):
        turned = np.array([-was.normal[1], was.normal[0], was.normal[2]])
        assert now.normal == pytest.approx(turned)
        assert now.size == pytest.approx(was.size)
        corners = [now.origin, now.origin + now.u, now.origin + now.v, now.origin + now.u + now.v]
        assert any(
            all((c >= np.array(b.lower) - 1e-9).all() and (c <= np.array(b.upper) + 1e-9).all() for c in corners)
            for b in put.boxes
        )
    assert put.boxes[-1] == arc_welder.jig.boxes[-1]


def test_a_jig_off_its_second_place_is_touched_as_by_a_robot_with_another_base(arc_welder, rng):
    theta, off = draw_many(arc_welder, 5, rng), two_places.LOOSE * rng.standard_normal((5, 6))
    at = np.array([30.0, -40.0, 50.0, 0.0, 0.0, 0.0])
    middle = at[:3] + two_places.HIGH
    point = rng.uniform(0, 300, 3)  # of the jig at its second place, on the drawing

    other = two_places.with_second_base(theta, off, at)

    for base, second, pose in zip(theta[:, :6], other[:, :6], off, strict=True):
        turn = transform(pose)
        stands = turn[:3, :3] @ (point - middle) + middle + pose[:3]
        seen = np.linalg.inv(transform(base)) @ np.append(stands, 1)
        assert np.linalg.inv(transform(second)) @ np.append(point, 1) == pytest.approx(seen)


def test_robots_that_touch_at_an_unknown_second_place_are_as_good_as_was_promised():
    cases = list(two_places.second_places("turned by 180°", 400, 60, 6, zone(30), np.random.default_rng(1)))

    for case in cases:
        delivered = np.median(np.sqrt((case.error**2).mean(axis=1)))
        assert 0.8 * case.promised < delivered < 2 * case.promised  # faces off by their tolerances are not averaged out
