"""The page of a cell shows the arm, and says when the torch is drawn sideways."""

from dataclasses import replace

import numpy as np

from identify.report.cell import cell_page


def test_the_page_shows_postures_of_the_zone(arc_welder):
    text = cell_page(arc_welder, "robot arc-welder: <6> joints")

    assert "posture 12" in text
    assert "robot arc-welder: &lt;6&gt; joints" in text
    assert "sideways" not in text
    assert "step through the postures" in text
    assert "step through the touches" not in text


def test_a_sideways_torch_is_said_so(arc_welder):
    text = cell_page(replace(arc_welder, tool=np.array([300.0, 0, 20, 0, 0, 0])), "")

    assert "86 degrees from its z axis; the wire leans 0 degrees from that axis. This is sideways" in text
