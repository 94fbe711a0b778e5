"""Many robots at once: each of them is what it would be alone."""

import numpy as np
import pytest
from virtual_support import make_plan

from identify.estimation.calibrate import calibrate
from identify.model.touch import HIT, Touches
from probe.virtual.batch import touch_batch
from probe.virtual.truth import Truth
from studies.many import calibrate_many, draw_faces, draw_many, errors_in_zone, touch_every, touch_many

ROBOTS = 6


@pytest.fixture(scope="module")
def plan(arc_welder):
    return make_plan(arc_welder, 60)


@pytest.fixture(scope="module")
def robots(arc_welder):
    return draw_many(arc_welder, ROBOTS, np.random.default_rng(3), scale=0.3)


@pytest.fixture(scope="module")
def made(arc_welder, robots, plan):
    return touch_every(arc_welder, robots, plan, np.random.default_rng(4))


def of_one(made, robot, plan):
    """The touches of one robot, as a file would hold them."""
    m, blank = len(plan), ("",) * len(plan)
    whole = Touches(
        plan.ids,
        plan.face,
        made.q[robot],
        made.normal,
        made.offset,
        np.full(m, 0.05),
        (HIT,) * m,
        np.full(m, np.nan),
        blank,
        blank,
    )
    return whole.take(made.hit[robot])


def gaps(cell, theta, made):
    """Distance of the end of the wire from the plane of its face [mm], a row a robot."""
    found = []
    for k, q in enumerate(made.q):
        position, R = cell.kinematics.tip(q, theta[k])
        lean = (R[:, :, 2] * made.normal).sum(axis=1)
        found.append((position * made.normal).sum(axis=1) - made.offset - cell.wire.radius * np.sqrt(1 - lean**2))
    return np.array(found)


def test_robots_identified_together_are_those_identified_one_by_one(arc_welder, made, plan):
    together = calibrate_many(arc_welder, made)

    for k in range(ROBOTS):
        single = calibrate(
            arc_welder, of_one(made, k, plan), loss="linear", folds=0, parameters="identifiable", errors="cell"
        )
        assert not single.outliers
        assert together.used[k].sum() == made.hit[k].sum()
        assert together.converged[k]
        # one by one the residuals say a little of sigma, which weighs the priors
        assert np.abs((together.theta[k] - single.theta) / arc_welder.scale).max() < 1e-3
        assert together.scatter[k] == pytest.approx(single.scatter, rel=0.1)  # they count freedom differently


def test_what_is_identified_of_a_robot_does_not_depend_on_its_company(arc_welder, robots, plan, made):
    whole = calibrate_many(arc_welder, made)
    some = type(made)(made.q[2:4], made.hit[2:4], made.normal, made.offset, made.sigma)

    part = calibrate_many(arc_welder, some)

    assert np.abs((part.theta - whole.theta[2:4]) / arc_welder.scale).max() < 1e-9


def test_touches_of_many_robots_are_those_of_each_without_noise(arc_welder, robots, plan):
    made = touch_many(arc_welder, robots, plan, np.random.default_rng(0), sigma=0.0)

    for k in range(ROBOTS):
        single = touch_batch(arc_welder, Truth(robots[k]), plan, np.random.default_rng(0), sigma=0.0)
        hit = np.array(single.status) == HIT
        assert np.array_equal(made.hit[k], hit)
        assert np.abs(made.q[k][hit] - single.q[hit]).max() < 1e-9
    assert 0.5 < made.hit.mean() < 1.0  # robots this far off miss some faces, or this test compares little


def test_touches_aimed_again_end_on_their_faces(arc_welder, robots, plan):
    proud = np.random.default_rng(1).normal(0, 0.1, (ROBOTS, len(plan)))

    made = touch_every(arc_welder, robots, plan, np.random.default_rng(0), sigma=0.0, proud=proud)

    assert made.hit.mean() > 0.99
    assert np.abs(gaps(arc_welder, robots, made) - proud)[made.hit].max() < 2e-4  # [mm]


def test_residuals_at_the_truth_scatter_by_one_sigma(arc_welder, plan):
    rng = np.random.default_rng(5)
    robots = draw_many(arc_welder, 60, rng, scale=0.3)
    made = touch_every(arc_welder, robots, plan, rng, proud=draw_faces(arc_welder, plan, 60, rng))

    residual = (gaps(arc_welder, robots, made) / made.sigma)[made.hit]

    assert residual.std() == pytest.approx(1.0, abs=0.04)  # 3600 draws, and 8 faces shared within a robot
    assert abs(residual.mean()) < 0.05


def test_the_scatter_of_a_fit_is_one_where_noise_is_all_that_is_wrong(arc_welder, plan):
    rng = np.random.default_rng(6)
    robots = draw_many(arc_welder, 40, rng, scale=0.1)

    found = calibrate_many(
        arc_welder, touch_every(arc_welder, robots, plan, rng, sigma=0.0536), eliminate=False
    )  # 0.05 mm and 0.02 mm of the faces in quadrature, drawn for every touch

    assert np.sqrt((found.scatter**2).mean()) == pytest.approx(1.0, abs=0.06)  # 1400 degrees of freedom: 2 %


def test_a_touch_of_something_else_is_left_out(arc_welder, robots, plan, made):
    clean = calibrate_many(arc_welder, made)
    spoiled = made.q.copy()
    spoiled[:, 7, 0] += 0.01  # [rad]: millimetres at the tip

    found = calibrate_many(arc_welder, type(made)(spoiled, made.hit, made.normal, made.offset, made.sigma))

    assert not found.used[:, 7].any()
    assert errors_in_zone(arc_welder, clean.theta, found.theta, plan.q).mean() < 0.1  # [mm]


def test_drawn_robots_spread_as_the_priors_say_and_fixed_parameters_do_not(arc_welder):
    from dataclasses import replace

    held = replace(arc_welder, fixed=frozenset({"j1.d"}))

    drawn = (draw_many(held, 2000, np.random.default_rng(7)) - held.theta) / held.prior

    place = held.robot.parameters.index("j1.d")
    assert (drawn[:, place] == 0).all()
    assert np.delete(drawn, place, axis=1).std(axis=0) == pytest.approx(1.0, abs=0.08)


def test_a_robot_that_is_known_exactly_has_no_error_in_the_zone(arc_welder, robots, plan):
    assert (errors_in_zone(arc_welder, robots, robots, plan.q) == 0).all()
    shifted = robots + np.eye(robots.shape[1])[0]  # the base 1 mm along x

    assert errors_in_zone(arc_welder, robots, shifted, plan.q) == pytest.approx(1.0)
