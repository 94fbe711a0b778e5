"""A poorer model comes as near to the identified one as least squares allows."""

from dataclasses import replace

import numpy as np
import pytest
from identified import identified
from oracle import forward

from identify.compensation.fitting import fitted, folded, geometric, independent, sample
from identify.export.chain import forward as chain_forward
from identify.export.chain import origins, segments

ZEROS = ["j2.theta", "j3.theta", "j5.theta"]


def off(cell, **changes):
    """Parameters with some of them off the drawing [mm, rad]; dots are written as underscores."""
    theta = cell.theta.copy()
    for name, value in changes.items():
        theta[cell.robot.parameters.index(name.replace("_", "."))] += value
    return theta


def test_a_fit_finds_the_parameters_that_alone_differ(arc_welder):
    theta = off(arc_welder, j2_theta=0.02, j3_theta=-0.01, j5_theta=0.015)

    fit = fitted(identified(arc_welder, theta), ZEROS, arc_welder.theta)

    np.testing.assert_allclose(fit, theta, atol=1e-8)


def test_what_a_parameter_cannot_carry_is_left_normal_to_it(arc_welder):
    calibration = identified(arc_welder, off(arc_welder, j3_a=2.0))
    q, tip = sample(calibration), arc_welder.kinematics.tip

    fit = fitted(calibration, ZEROS, arc_welder.theta, levers=((0.0, 0.0, 0.0),))

    step = 1e-6
    rest = tip(q, calibration.theta)[0] - tip(q, fit)[0]
    for name in ZEROS:  # the normal equations of least squares, by finite differences
        moved = fit + off(arc_welder, **{name.replace(".", "_"): step}) - arc_welder.theta
        slope = (tip(q, moved)[0] - tip(q, fit)[0]) / step
        assert abs((rest * slope).sum()) < 1e-4 * np.linalg.norm(rest) * np.linalg.norm(slope)


def test_of_two_parameters_that_do_the_same_the_preferred_one_stays(arc_welder):
    calibration = identified(arc_welder, arc_welder.theta)

    assert independent(calibration, ["base.z", "j1.d", "j1.theta"]) == ["base.z", "j1.theta"]  # j1 turns about base z
    assert independent(calibration, ["j1.d", "base.z"]) == ["j1.d"]


def test_a_robot_without_joint_errors_is_its_own_geometry(arc_welder):
    calibration = identified(arc_welder, arc_welder.theta)

    assert geometric(calibration) is calibration


def test_base_and_tool_folded_around_the_links_are_the_whole_chain(arc_welder, rng):
    robot = arc_welder.robot
    theta = arc_welder.theta + 0.01 * rng.standard_normal(len(arc_welder.theta))
    first, last = folded(identified(arc_welder, theta), theta)
    q = rng.uniform(robot.lower, robot.upper, (3, len(robot.joints)))

    chain = replace(segments(robot, theta), base_T_first=first, last_T_flange=last)

    expected = [forward(robot, values, theta) for values in q]
    np.testing.assert_allclose(chain_forward(origins(chain), robot.prismatic, q), expected, atol=1e-9)


def test_poses_to_compare_at_lie_in_the_zone_and_repeat(arc_welder):
    calibration = identified(arc_welder, arc_welder.theta)

    q = sample(calibration)

    tip, box = arc_welder.kinematics.tip(q, arc_welder.theta)[0], arc_welder.zone.box
    assert ((tip > box[:, 0]) & (tip < box[:, 1])).all()
    assert (sample(calibration) == q).all()
    assert len(q) == pytest.approx(300, abs=200)
