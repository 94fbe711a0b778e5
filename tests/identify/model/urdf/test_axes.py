"""Axes in every relation to each other are expressed exactly."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from oracle import forward
from urdf_stages import Stage, assert_same, chains, model, semantics


@settings(max_examples=100)
@given(stages=chains)
def test_links_follow_the_common_normal_unless_axes_are_nearly_parallel(folder, stages):
    robot = model(folder, stages)

    for joint in robot.joints:
        across = np.cos(joint.alpha) * np.cos(joint.beta)  # cosine between this axis and the next
        parallel = abs(across) >= np.cos(np.radians(5)) - 1e-12
        assert parallel or (joint.beta == 0 and np.cos(joint.theta) >= -1e-8)  # x turns by a right angle at most
        assert max(abs(joint.a), abs(joint.d)) <= 15 * 1000 * (1 + sum(np.linalg.norm(s.xyz) for s in stages))


def test_pairs_of_axes_in_every_relation_are_expressed_exactly(folder):
    tilts = [0, 1e-10, 1e-6, np.radians(4.9999), np.radians(5.0001), 0.3, np.pi / 2, np.pi - 1e-8, np.pi]
    offsets = [(0.0, 0.0, 0.0), (0.0, 0.0, 0.4), (0.3, 0.0, 0.0), (0.0, -0.3, 0.1), (1e-13, 0.0, 0.0), (0.2, 0.2, -1.0)]
    pairs = [Stage("revolute", xyz, (tilt, 0.0, 0.7)) for tilt in tilts for xyz in offsets]

    for first, second in pairwise(pairs):
        stages = [first, second, Stage("fixed", (0.1, 0.2, 0.3), (1, 1, 1))]
        robot = model(folder, stages)
        q = np.array([0.4, -1.1])

        T = forward(robot, q, robot.theta(np.zeros(6), np.zeros(6)))

        assert_same(T, semantics(stages, q), stages)
