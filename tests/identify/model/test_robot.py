"""Parameters of a robot: names, order and units."""

import pytest

from identify.model.io.description import library, read_robot

ROBOTS = {name: read_robot(path) for name, path in library("robots").items()}


@pytest.mark.parametrize("name", ROBOTS)
def test_parameters_stand_in_the_order_of_the_design_with_their_units(name):
    robot = ROBOTS[name]

    names, unit = robot.parameters, robot.parameter_unit()

    pose = ["x", "y", "z", "rz", "ry", "rx"]
    links = [f"j{i + 1}.{key}" for i in range(len(robot.joints)) for key in ("theta", "d", "a", "alpha", "beta")]
    assert list(names) == [f"base.{key}" for key in pose] + links + [f"tool.{key}" for key in pose]
    degrees = {"rz", "ry", "rx", "theta", "alpha", "beta"}
    assert [value != 1 for value in unit] == [key.split(".")[1] in degrees for key in names]
    assert [value != 1 for value in robot.joint_unit()] == [not slides for slides in robot.prismatic]
