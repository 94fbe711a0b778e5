"""The weld zone: its poses."""

from dataclasses import replace

import numpy as np
import pytest
from cells import cell_of

from identify.model.cell import Zone
from identify.model.files import InputError
from identify.model.zone import cone, in_zone, zone_of, zone_poses


@pytest.fixture(scope="module")
def poses(arc_welder):
    return zone_poses(arc_welder, poses=200)


def test_poses_of_the_zone_are_in_its_box_near_straight_down_and_within_joint_limits(arc_welder, poses):
    tip, R = arc_welder.kinematics.tip(poses, arc_welder.theta)
    robot, zone = arc_welder.robot, arc_welder.zone

    assert len(poses) == 200
    assert (tip >= zone.box[:, 0] - 1e-3).all()
    assert (tip <= zone.box[:, 1] + 1e-3).all()
    assert (np.arccos(-R[:, 2, 2]) <= zone.max_tilt + 1e-6).all()
    assert ((poses >= robot.lower) & (poses <= robot.upper)).all()
    assert in_zone(arc_welder, poses).all()


def test_poses_of_the_zone_fill_it(arc_welder, poses):
    tip = arc_welder.kinematics.tip(poses, arc_welder.theta)[0]

    eighth = ((tip - arc_welder.zone.box[:, 0]) > np.ptp(arc_welder.zone.box, axis=1) / 2) @ [1, 2, 4]
    assert np.bincount(eighth, minlength=8).min() >= 10


def test_the_zone_is_the_same_each_time_unless_drawn(arc_welder, poses):
    assert np.array_equal(zone_poses(arc_welder, poses=200), poses)
    assert not np.array_equal(zone_poses(arc_welder, poses=200, rng=np.random.default_rng(1)), poses)


def test_a_zone_out_of_reach_gets_one_sentence(arc_welder):
    far = replace(arc_welder, zone=Zone(np.array([[5000.0, 5100], [0, 100], [0, 100]]), 1.0))

    with pytest.raises(InputError, match="reaches no pose of the weld zone"):
        zone_poses(far, poses=20)


def test_without_a_zone_the_box_around_the_jig_takes_its_place(arc_welder):
    zone = zone_of(replace(arc_welder, zone=None))

    assert zone.box == pytest.approx(np.array([[50, 350], [50, 250], [0, 200]]))


def test_the_cone_is_filled_evenly_by_area(rng):
    axis = np.tile([0.6, 0.0, 0.8], (20000, 1))

    directions = cone(axis, 0.7, rng.random((20000, 2)))

    cosine = directions @ [0.6, 0.0, 0.8]
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1)
    assert cosine.min() >= np.cos(0.7) - 1e-12
    assert cosine.mean() == pytest.approx((1 + np.cos(0.7)) / 2, abs=2e-3)  # Archimedes: uniform in height


def test_a_robot_of_four_joints_has_its_zone_too():
    scara = cell_of("scara")

    poses = zone_poses(scara, poses=50)

    assert len(poses) == 50
    assert in_zone(scara, poses).all()
