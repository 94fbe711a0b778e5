"""A joint error of one's own: joint 1 turns on a bearing with three raised rollers, a third harmonic."""

from collections.abc import Iterator
from dataclasses import replace

import casadi as ca
import numpy as np

import identify
import oed
import probe
from identify.model.joint_error_models import ERROR_MODELS, Arm, Term


def rollers(arm: Arm) -> Iterator[Term]:
    """The third harmonic of joint 1; its prior is that of the other harmonics."""
    yield Term("j1.cos3", "harmonics_deg", {("joint", 0): ca.cos(3 * arm.q[0])})
    yield Term("j1.sin3", "harmonics_deg", {("joint", 0): ca.sin(3 * arm.q[0])})


def main() -> None:
    """Identify it on a robot that has it."""
    ERROR_MODELS["rollers"] = rollers
    cell, rng = identify.read_cell(identify.library("cells")["arc-welder"]), np.random.default_rng(2)
    cell = replace(cell, robot=replace(cell.robot, errors=("rollers",)))
    truth = probe.draw_truth(cell, rng, scale=0.1)
    truth.theta[cell.robot.parameters.index("j1.cos3")] = np.radians(0.03)
    plan = oed.plan(cell, 60, rng=rng, count=1500).plan
    calibration = identify.calibrate(cell, probe.touch_batch(cell, truth, plan, rng), errors="cell")
    for name in ("j1.cos3", "j1.sin3"):
        i = cell.robot.parameters.index(name)
        values = np.degrees([truth.theta[i], calibration.theta[i], calibration.sigma[i]])
        print("{}: true {:+.4f} deg, identified {:+.4f} deg, sigma {:.4f} deg".format(name, *values))


if __name__ == "__main__":
    main()
