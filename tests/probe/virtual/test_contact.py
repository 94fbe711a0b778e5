"""Where a wire first meets the jig."""

import numpy as np
import pytest

from probe.virtual.contact import Paths, first_contact, touching
from probe.virtual.surfaces import surfaces


def test_the_first_contact_is_the_one_that_a_march_in_small_steps_finds(arc_welder, plan, rng):
    surface, count, steps = surfaces(arc_welder.jig, arc_welder.wire), len(plan), 3000
    start = plan.approach + rng.normal(0, 0.02, plan.q.shape)
    end = start + 2.4 * (plan.q - plan.approach) + rng.normal(0, 0.08, plan.q.shape)
    paths, none = Paths(start, end, arc_welder.theta), np.zeros(count)

    fraction, met, early = first_contact(arc_welder.kinematics, surface, paths, none, 12)

    compared = 0
    for i in np.flatnonzero(~early):
        march = Paths(*(np.repeat(a[i : i + 1], steps, axis=0) for a in (start, end)), arc_welder.theta)
        closed = touching(arc_welder.kinematics, surface, march, np.linspace(0, 1, steps), np.zeros(steps))
        expected = np.argmax(closed) / (steps - 1) if closed.any() else np.inf
        assert (met[i] >= 0) == closed.any()
        assert fraction[i] == pytest.approx(expected, abs=1.5 / steps)
        compared += closed.any()
    assert compared > 5
