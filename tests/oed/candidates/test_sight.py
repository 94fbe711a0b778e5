"""Lines of sight from a tracker: what it cannot see is dropped, with the reason."""

from dataclasses import replace

import numpy as np
import pytest

from identify.model.cell import Device
from identify.model.files import InputError
from identify.model.frames import transform
from identify.model.shape import Shape
from oed.candidates.kinds import measurements
from oed.candidates.sight import IN_SIGHT, REASONS, sight
from probe.motion.clearance import Clearance

STAND = np.array([200.0, -2300.0, 600.0])
FAR, VIEW, AWAY, HIDDEN = range(len(REASONS))
ALL_ROUND = Device(stand=STAND, range=(100.0, 1e5), elevation=(-np.pi / 2, np.pi / 2))


@pytest.fixture
def q(arc_welder, rng):
    """300 postures."""
    return rng.uniform(arc_welder.robot.lower, arc_welder.robot.upper, (300, 6))


@pytest.fixture
def seen(arc_welder, q):
    """Reasons and tips of the postures for a tracker."""

    def by(device, **changes):
        cell = replace(arc_welder, devices={"position": device}, **changes)
        reasons = sight(cell, "position", Clearance(cell, cell.theta), q, None, None)
        return reasons, *cell.kinematics.tip(q, cell.theta)

    return by


def test_a_cell_that_does_not_say_where_its_tracker_stands_drops_nothing(seen):
    assert (seen(Device())[0] == IN_SIGHT).all()


def test_a_tracker_sees_as_far_as_its_range(seen):
    reasons, tip, _ = seen(replace(ALL_ROUND, range=(1500.0, 2500.0)))

    far = np.linalg.norm(tip - STAND, axis=1)
    np.testing.assert_array_equal(reasons == FAR, (far < 1500) | (far > 2500))


@pytest.mark.parametrize("turn", [0.0, 2 * np.pi])
def test_a_tracker_sees_what_lies_within_azimuth_and_elevation(seen, turn):
    azimuth = np.radians([80.0, 95.0]) + turn
    reasons, tip, _ = seen(replace(ALL_ROUND, azimuth=tuple(azimuth), elevation=tuple(np.radians([-20.0, 10.0]))))

    x, y, z = (tip - STAND).T
    beside = np.abs(np.degrees(np.arctan2(x, y)) - 2.5) > 7.5  # from y towards x: azimuth 80 to 95 is -5 to 10
    steep = np.abs(np.degrees(np.arctan2(z, np.hypot(x, y))) + 5) > 15
    np.testing.assert_array_equal(reasons == VIEW, beside | steep)
    assert 10 < (reasons == VIEW).sum() < 290


def test_a_target_is_seen_from_within_its_acceptance(seen):
    axis = np.array([0.0, 3.0, 0.0])
    reasons, tip, R = seen(replace(ALL_ROUND, target_axis=axis, acceptance=np.radians(40)))

    ray = (STAND - tip) / np.linalg.norm(STAND - tip, axis=1, keepdims=True)
    angle = np.degrees(np.arccos((R[:, :, 1] * ray).sum(axis=1)))
    np.testing.assert_array_equal(reasons == AWAY, angle > 40)


def test_a_wall_hides_what_lies_behind_it(seen):
    wall = Shape(0, "wall", "box", (4000.0, 20.0, 300.0), transform(np.array([200.0, -1500.0, 550.0, 0, 0, 0])))
    open_, tip, _ = seen(ALL_ROUND)
    reasons, _, _ = seen(ALL_ROUND, obstacles=(wall,))

    share = (-1500 - STAND[1]) / (tip[:, 1] - STAND[1])
    cut = STAND + share[:, None] * (tip - STAND)  # where the line of sight passes the wall's plane
    through = (np.abs(cut[:, 2] - 550) < 140) & (np.abs(cut[:, 0] - 200) < 1990)
    over = (np.abs(cut[:, 2] - 550) > 180) & (tip[:, 1] > -1400)
    assert through.sum() > 20
    assert (reasons[through] == HIDDEN).all()
    np.testing.assert_array_equal(reasons[over], open_[over])


def test_the_arm_hides_a_target_that_it_stands_before(arc_welder, q, seen):
    """The same by sampled points of the line of sight, and their distances from the axes of the capsules."""
    reasons, tip, _ = seen(ALL_ROUND, jig=None)
    cell = replace(arc_welder, jig=None)
    clearance = Clearance(cell, cell.theta)

    def gap(points):  # of points from the surfaces of the capsules, a row each
        start, end = (e.transpose(1, 2, 0)[:, :, None] for e in clearance.ends(q))
        along = end - start
        share = ((points - start) * along).sum(axis=-1) / np.maximum((along**2).sum(axis=-1), 1e-9)
        nearest = start + np.clip(share, 0, 1)[..., None] * along
        return np.linalg.norm(points - nearest, axis=-1) - clearance.radius[:, None, None]

    share = np.linspace(0, 0.5, 1500)[:, None]  # the arm ends long before the middle
    least = np.where(
        gap(tip[:, None])[:, :, 0] > 0, gap(tip[:, None] + share * (STAND - tip)[:, None]).min(axis=2), 1e3
    )
    sure = np.abs(least.min(axis=0)) > 0.2  # [mm], between samples
    np.testing.assert_array_equal(reasons[sure] == HIDDEN, least.min(axis=0)[sure] < 0)
    assert sure.mean() > 0.9
    assert 10 < (reasons == HIDDEN).sum() < 270


def test_a_further_stand_sees_from_where_it_is(arc_welder, q):
    """The same place of the tracker, told in the frame of a stand that is turned and shifted."""
    jig_T_stand = transform(np.array([300.0, -200.0, 50.0, 0.7, 0.0, 0.1]))
    there = (np.linalg.inv(jig_T_stand) @ np.append(STAND, 1.0))[:3]
    base = np.linalg.inv(jig_T_stand) @ transform(arc_welder.base)
    angles = np.arctan2(base[1, 0], base[0, 0]), np.arcsin(-base[2, 0]), np.arctan2(base[2, 1], base[2, 2])
    further = np.concatenate([base[:3, 3], angles])
    wide = replace(ALL_ROUND, range=(1500.0, 2500.0), target_axis=np.array([0.0, 0.0, -1.0]))
    here = replace(arc_welder, devices={"pose": wide})
    moved = replace(here, placements={"second": further}, devices={"pose": replace(wide, stand=there)})

    reasons = sight(here, "pose", Clearance(here, here.theta), q, None, None)
    again = sight(moved, "pose", Clearance(moved, moved.theta), q, ("second",) * 300, None)

    np.testing.assert_array_equal(again, reasons)


def test_what_is_out_of_sight_is_left_out_and_counted(arc_welder, rng):
    short = replace(ALL_ROUND, range=(100.0, 2500.0), target_axis=np.array([0.0, 0.0, -1.0]), acceptance=1.3)
    cell = replace(arc_welder, devices={"position": short})

    table, (note,) = measurements(cell, "position", rng, 40)

    assert (sight(cell, "position", Clearance(cell, cell.theta), table.q, None, None) == IN_SIGHT).all()
    assert "out of sight of the tracker at (200, -2300, 600) mm" in note
    assert REASONS[FAR] in note
    assert REASONS[AWAY] in note


def test_a_tracker_that_sees_nothing_is_refused_with_the_reason(arc_welder, rng):
    cell = replace(arc_welder, devices={"position": replace(ALL_ROUND, range=(10.0, 200.0))})

    with pytest.raises(InputError, match="nearer or further than the tracker measures"):
        measurements(cell, "position", rng, 10)
