"""Ipopt reaches what no step downhill does."""

import numpy as np
from identified import identified, poses_at

from identify.compensation.compensate import compensate
from identify.compensation.trust import RESIDUAL
from identify.model.cell import Cell
from identify.model.frames import transform
from identify.model.ik import reach
from identify.model.io.description import library, read_robot

DEG = np.pi / 180


def test_ipopt_finds_what_steps_downhill_do_not_for_an_arm_of_seven_joints_at_a_limit():
    arm = Cell(read_robot(library("robots")["arm7"]), None, np.zeros(6), np.array([0, 0, 100.0, 0, 0, 0]))
    theta = arm.theta.copy()
    theta[arm.robot.parameters.index(f"{arm.robot.joints[1].name}.theta")] += 0.02
    rng = np.random.default_rng(5)
    q = rng.uniform(0.7 * arm.robot.lower, 0.7 * arm.robot.upper, (40, 7))
    q[:, 1] = arm.robot.lower[1] + 1e-4  # within the limit, but downhill leads out of it
    wanted = poses_at(arm, q)
    T = transform(wanted)
    downhill = reach(arm.kinematics, theta, T[:, :3, 3], T[:, :3, :3], q)

    result = compensate(identified(arm, theta), wanted, near=q, max_change=20 * DEG)

    rescued = ~downhill.reached(RESIDUAL) & result.corrected
    assert rescued.sum() > 20
    assert (result.q[rescued] >= arm.robot.lower - 1e-9).all()
    assert np.abs(poses_at(arm, result.q[rescued], theta)[:, :3] - wanted[rescued, :3]).max() < 1e-3
