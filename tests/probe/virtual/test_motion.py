"""A motion takes its way at its rate."""

import numpy as np
import pytest

from probe.virtual.motion import straight


@pytest.mark.parametrize("rate", [0.5, 5.0, 50.0, 500.0])
def test_a_motion_takes_its_way_at_its_rate_and_never_goes_back(arc_welder, plan, rate):
    robot = arc_welder.robot
    start, end = plan.approach[0], plan.approach[1]

    profile = straight(robot, start, end, np.radians(rate), 2.0)

    times = np.linspace(2.0, profile.end, 2000)
    fraction = np.array([profile.at(t)[0] for t in times])
    speed = np.abs(np.outer(np.gradient(fraction, times), end - start))
    assert fraction[0] == 0
    assert fraction[-1] == pytest.approx(1)
    assert (np.diff(fraction) >= 0).all()
    assert (speed <= robot.speed * (1 + 1e-6)).all()
    assert speed.max() <= np.radians(rate) * (1 + 1e-6)
    assert profile.end - 2.0 >= np.abs(end - start).max() / np.radians(rate)
    assert [profile.time(f) for f in fraction[1:-1:100]] == pytest.approx(times[1:-1:100])
