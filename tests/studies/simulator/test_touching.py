"""The simulator of the studies against the compiled kinematics: two codes that share no line."""

import pytest

from studies.simulator.touching import tips


def test_tips_are_those_of_the_compiled_kinematics(arc_welder, rng):
    q = rng.uniform(arc_welder.robot.lower, arc_welder.robot.upper, (20, 6))
    theta = arc_welder.theta + arc_welder.prior * rng.standard_normal(len(arc_welder.theta))

    position, rotation = tips(arc_welder.robot, q, theta)

    expected = arc_welder.kinematics.tip(q, theta)
    assert position == pytest.approx(expected[0], abs=1e-9)
    assert rotation == pytest.approx(expected[1], abs=1e-12)
