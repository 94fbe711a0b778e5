"""Many robots at once do what each would do alone."""

from dataclasses import replace

import numpy as np
import pytest
from oracle import forward
from virtual_support import make_plan

from identify.model.cell import Wire
from studies.many import (
    calibrate_many,
    draw_faces,
    draw_many,
    errors_in_zone,
    linear_identification,
    touch_every,
    touch_many,
)

ROBOTS = 3


@pytest.fixture(scope="module")
def cell(arc_welder):
    """A pointed wire, whose end touches where the tip is."""
    return replace(arc_welder, wire=Wire(0.0, "point"))


@pytest.fixture(scope="module")
def plan(cell):
    return make_plan(cell, 60)


@pytest.fixture(scope="module")
def theta(cell):
    return draw_many(cell, ROBOTS, np.random.default_rng(2), scale=0.1)


@pytest.mark.parametrize("touch", [touch_many, touch_every])
def test_hidden_tips_lie_on_faces_that_stand_proud(touch, cell, plan, theta, rng):
    proud = draw_faces(cell, plan, ROBOTS, rng)

    touches = touch(cell, theta, plan, rng, sigma=0.0, proud=proud)

    assert touches.hit.mean() > 0.8
    for robot, i in np.argwhere(touches.hit)[::7]:
        tip = forward(cell.robot, touches.q[robot, i], theta[robot])[:3, 3]
        assert plan.normal[i] @ tip == pytest.approx(touches.offset[i] + proud[robot, i], abs=1e-4)


def test_all_touches_of_a_face_share_what_it_is_off_by(cell, plan, rng):
    proud = draw_faces(cell, plan, 200, rng)

    for name in set(plan.face):
        of_face = proud[:, [face == name for face in plan.face]]
        assert np.ptp(of_face, axis=1).max() == 0
        assert of_face[:, 0].std() == pytest.approx(cell.jig.by_name[name].tolerance, rel=0.2)


def test_linear_steps_with_the_jacobian_of_here_end_where_least_squares_does(cell, plan, theta, rng):
    touches = touch_every(cell, theta, plan, rng, sigma=0.0)

    once, often = (
        errors_in_zone(cell, theta, linear_identification(cell, touches, steps, update=True), plan.q[:10]).max()
        for steps in (1, 6)
    )

    assert often < 0.01  # [mm]; parameters are left out that parallel axes do not show
    assert once > 10 * often


def test_errors_are_distances_of_tips(cell, plan):
    moved = cell.theta[None].copy()
    moved[0, :3] += [2.0, 3.0, 6.0]  # of the jig as seen by the base: the tip moves as far

    np.testing.assert_allclose(errors_in_zone(cell, cell.theta[None], moved, plan.q[:4]), np.full((1, 4), 7.0))


def test_a_robot_without_a_touch_stays_as_drawn_and_others_are_identified_as_alone(cell, plan, theta, rng):
    touches = touch_every(cell, theta, plan, rng)
    hit = touches.hit.copy()
    hit[1] = False

    found = calibrate_many(cell, replace(touches, hit=hit))
    both = calibrate_many(cell, touches)

    np.testing.assert_allclose(found.theta[[0, 2]], both.theta[[0, 2]], atol=1e-9)
    np.testing.assert_array_equal(found.theta[1], cell.theta)
    assert not found.used[1].any()
