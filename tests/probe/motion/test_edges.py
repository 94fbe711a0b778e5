"""Straight ways keep as clear of the jig as asked."""

from dataclasses import replace

import numpy as np
import pytest
from gaps import gap

from identify.model.shape import Shape
from oed.candidates.feasibility import WIRE
from probe.motion.clearance import Clearance
from probe.motion.edges import SHARE, Edges
from probe.motion.torch import STICKOUT


@pytest.mark.parametrize("keep", [0.0, 15.0, 60.0])
def test_ways_keep_as_clear_of_the_jig_as_asked_or_nearly_what_their_ends_have(arc_welder, touches, keep):
    edges = Edges(Clearance(arc_welder, arc_welder.theta), keep=keep)
    a, b = np.triu_indices(len(touches), 1)
    start, end = touches.approach[a], touches.approach[b]

    clear = edges.clear(start, end)

    assert 0 < clear.sum() < len(clear)
    ends = np.minimum(gap(arc_welder, start, STICKOUT), gap(arc_welder, end, STICKOUT))
    wanted = np.maximum(np.minimum(SHARE * ends, keep), WIRE)
    for share in np.linspace(0.0, 1.0, 21):
        at = gap(arc_welder, start + share * (end - start))
        assert (at[clear] > wanted[clear] - 1.0).all()  # [mm]; the tip goes on a curve between two looks
    wider = Edges(Clearance(arc_welder, arc_welder.theta), keep=keep + 30.0).clear(start, end)
    assert not (wider & ~clear).any()


@pytest.mark.parametrize(
    ("lower", "risk", "clear"), [(0.0, 0.0, True), (11.0, 0.0, True), (13.0, 0.0, False), (13.0, 1.0, True)]
)
def test_a_robot_that_may_stand_lower_than_its_arm_is_high_does_not_take_the_way(arc_welder, lower, risk, clear):
    """The arm swings over a post at a height of 12 mm; a base lower by more would bring it onto the post."""
    start, end = np.zeros((2, 1, 6))
    start[0, :3] = end[0, :3] = [0.0, 0.6, -0.6]
    start[0, 0], end[0, 0] = -1.2, 1.2
    over = (start + end) / 2
    free = Clearance(replace(arc_welder, jig=None), arc_welder.theta)
    a, b = (points[:, free.arm._moving, 0] for points in free.ends(over))
    along = a[..., None] + np.linspace(0, 1, 201) * (b - a)[..., None]
    low = along[2] - free.radius[free.arm._moving][:, None]
    link, place = np.unravel_index(np.argmin(low), low.shape)
    T = np.eye(4)
    T[:3, 3] = [*along[:2, link, place], low[link, place] - 12 - 50]
    post = Shape(0, "post", "box", (4, 4, 100), T)
    low_robot = arc_welder.theta - lower * (np.array(arc_welder.robot.parameters) == "base.z")

    edges = Edges(
        Clearance(replace(arc_welder, jig=None, obstacles=(post,)), arc_welder.theta), robots=low_robot[None], risk=risk
    )

    assert edges.clear(start, end)[0] == clear
