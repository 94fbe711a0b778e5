"""What cannot be trusted is left alone, and the words say why."""

import re

import numpy as np
from identified import identified, poses_at

from identify.compensation.compensate import compensate
from identify.compensation.trust import smallest

DEG = np.pi / 180


def test_next_to_a_singular_wrist_targets_are_left_alone_and_say_what_would_happen(arc_welder, exact):
    q = np.tile([0.2, 0.1, 0.3, 0.4, 0.0, -0.5], (60, 1))
    q[:, 4] = np.linspace(-0.1, 0.1, 60)

    result = compensate(exact, poses_at(arc_welder, q), near=q, max_change=8 * DEG)

    assert smallest(arc_welder.kinematics, arc_welder.theta, q[30:31])[0] < 0.01
    assert result.corrected[[0, -1]].all()
    assert {reason.split(":")[0] for reason in result.why if reason} == {"near a singularity"}
    assert any(re.search(r"j[46] would move by .* degrees, allowed 8", reason) for reason in result.why)
    assert any("comes no nearer than" in reason for reason in result.why)


def test_a_joint_at_its_limit_leaves_the_target_alone(arc_welder, exact):
    q = np.array([[0.3, 0.2, 0.4, 0.3, 0.8, 0.2], [0.3, 0.2, 0.4, 0.3, 0.8, 0.2]])
    q[0, 1], q[1, 5] = arc_welder.robot.upper[1], arc_welder.robot.lower[5]

    why = compensate(exact, poses_at(arc_welder, q), near=q).why

    assert why[0].startswith("joint limit: j2 would stand at 13")
    assert why[0].endswith("its limit is 130")
    assert why[1] == "joint limit: j6 would pass it and have to turn all the way back"


def test_a_target_out_of_reach_is_named(exact):
    far = np.array([[5000.0, 0.0, 0.0, 0.0, 0.0, np.pi]])

    result = compensate(exact, far)

    assert result.why == ("out of reach: the nominal robot has no solution within its limits",)
    assert np.isnan(result.nominal).all()
    assert np.array_equal(result.command, far)


def test_a_target_that_only_the_nominal_robot_reaches_is_named(arc_welder):
    short = arc_welder.theta.copy()
    short[arc_welder.robot.parameters.index("j2.a")] -= 60
    q = np.array([[0.2, 0.5, -np.pi / 2 + 0.3, 0.3, 0.6, 0.1]])  # arm nearly straight

    why = compensate(identified(arc_welder, short), poses_at(arc_welder, q), near=q).why[0]

    assert why.startswith("out of reach: the identified robot comes no nearer than")
