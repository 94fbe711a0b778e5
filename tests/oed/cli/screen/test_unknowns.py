"""What was measured and identified in lines: units of files, 95 % intervals, and no line where there is nothing new."""

from dataclasses import replace

import numpy as np
from identified import identified
from measured import positions_at, touches_at

from identify.model.calibration import SharedValue
from oed.cli.screen.unknowns import kind_lines, parameter_lines, shared_lines


def test_a_parameter_stands_in_degrees_with_its_change_and_95_percent(arc_welder):
    theta = arc_welder.theta.copy()
    theta[arc_welder.robot.parameters.index("j2.theta")] += np.radians(0.5)
    calibration = identified(arc_welder, theta, estimated=("j2.theta",), covariance=np.array([[np.radians(0.5) ** 2]]))

    _, line = parameter_lines(calibration)

    words = line.split()
    assert words[:2] == ["j2.theta", "deg"]
    start, value, change, spread = map(float, words[2:])
    assert value - start == change == 0.5
    assert spread == 0.98


def test_a_joint_error_that_may_be_zero_is_counted_and_not_listed(arc_welder):
    cell = replace(arc_welder, robot=replace(arc_welder.robot, errors=("harmonics",)))
    names = [name for name, _, _ in cell.robot.error_parameters][:3]
    theta = cell.theta.copy()
    theta[cell.robot.parameters.index(names[0])] = 1.0
    calibration = identified(cell, theta, estimated=tuple(names), covariance=0.01 * np.eye(3))

    lines = parameter_lines(calibration)

    assert [names[0] in line for line in lines] == [False, True, False]
    assert lines[-1].startswith("2 joint errors are zero within their uncertainty")


def test_touches_alone_need_no_line_and_other_kinds_are_counted(arc_welder, rng):
    q = rng.uniform(-0.3, 0.3, (4, 6))
    touches, positions = (
        touches_at(arc_welder, arc_welder.theta, q, rng),
        positions_at(arc_welder, arc_welder.theta, q[:3], rng),
    )

    assert kind_lines([touches]) == []
    named = replace(positions, tool=("smr2", "", "smr1"))
    assert kind_lines([touches, named]) == ["4 of kind touch; 3 of kind position, tool smr1, smr2"]


def test_what_measurements_share_stands_in_its_unit(arc_welder):
    turn = SharedValue("placement.second.rz", "deg", np.radians(2.0), 0.1)
    joint = np.diag([1e-8, np.radians(0.1) ** 2])
    calibration = identified(
        arc_welder, arc_welder.theta, shared=(turn,), covariance=joint[:1, :1], shared_covariance=joint[1:]
    )

    (line,) = shared_lines(calibration)

    assert line.split() == ["placement.second.rz", "deg", "2.0000", "+-", "0.1960"]
