"""Frames of the paper's links, and the rank of all six errors of each."""

from dataclasses import replace

import numpy as np
from oracle import forward

from identify.model.identifiability import structure
from studies.models import _frames, _rank_of_six


def test_the_last_frame_is_the_tip(arc_welder, rng):
    q = rng.uniform(arc_welder.robot.lower, arc_welder.robot.upper, (3, 6))

    frames = _frames(arc_welder, q)

    assert len(frames) == 8  # base, six links, tip
    for k in range(3):
        np.testing.assert_allclose(frames[-1][k], forward(arc_welder.robot, q[k], arc_welder.theta), atol=1e-9)


def test_positions_show_25_errors_of_the_paper_s_robot_and_27_of_one_without_parallel_axes(arc_welder, rng):
    # 4 of each of six revolute links and 6 of the last frame, less the 3 turns of a tip that is a point
    spread = np.where(arc_welder.robot.angular, 0.1, 20.0) * rng.standard_normal(len(arc_welder.theta))
    generic = replace(arc_welder, robot=arc_welder.robot.identified(arc_welder.theta + spread))

    assert _rank_of_six(generic) == 4 * 6 + 6 - 3
    assert _rank_of_six(arc_welder) == len(structure(arc_welder).kept) == 25
