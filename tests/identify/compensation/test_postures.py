"""Postures of the nominal robot: a path keeps its own."""

import numpy as np
from identified import poses_at

from identify.compensation.postures import nominal
from identify.model.frames import transform


def test_a_path_keeps_its_posture(arc_welder):
    q = np.linspace([0.2, 0.1, 0.3, 0.4, 0.9, 0.2], [0.5, 0.3, 0.1, 0.3, 1.1, 0.5], 100)
    T = transform(poses_at(arc_welder, q))

    found, reached = nominal(arc_welder.kinematics, arc_welder.theta, T)

    assert reached.all()
    assert np.abs(np.diff(found, axis=0)).max() < 0.1


def test_a_named_posture_is_the_one_that_is_kept(arc_welder):
    q = np.array([[0.2, 0.1, 0.3, 0.4, 0.9, 0.2]])
    flipped = np.array([0.2, 0.1, 0.3, 0.4 - np.pi, -0.9, 0.2 - np.pi])
    T = transform(poses_at(arc_welder, q))

    upright = nominal(arc_welder.kinematics, arc_welder.theta, T, q[0])[0]
    turned = nominal(arc_welder.kinematics, arc_welder.theta, T, flipped)[0]

    assert np.abs(upright - q).max() < 1e-6
    assert turned[0, 4] < -0.8
    assert np.abs(transform(poses_at(arc_welder, turned)) - T).max() < 1e-4
