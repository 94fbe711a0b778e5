"""Straight ways keep as clear of the jig as asked."""

import numpy as np
import pytest
from gaps import gap

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
