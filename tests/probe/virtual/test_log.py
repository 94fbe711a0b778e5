"""The log for the judge: each motion and each latch once, in the units of files."""

import json

import numpy as np
import pytest
from virtual_robots import robot_at

from probe.virtual.log import Log


def test_each_motion_and_each_touch_is_logged_once(arc_welder, exact, plan, tmp_path):
    robot = robot_at(arc_welder, exact, plan)
    path = tmp_path / "log.jsonl"
    log = Log(path, robot)
    robot.search(2 * plan.q[0] - plan.approach[0], np.radians(0.6))

    log.write()
    log.write()  # nothing has happened since
    log.close()

    touch, motion = (json.loads(line) for line in path.read_text().splitlines())
    assert touch["touch"] == plan.face[0]
    assert (motion["motion"], motion["outcome"]) == ("SEARCH", "CONTACT")
    assert motion["rate_deg_s"] == pytest.approx(0.6)
    np.testing.assert_allclose(touch["latch"], np.degrees(robot.touches[0].latch))
    np.testing.assert_allclose(motion["stop"], np.degrees(robot.q))
    assert motion["began"] < touch["time"] <= touch["latched"] < motion["ended"]
