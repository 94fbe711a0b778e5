"""Touches that notice change: what may have changed is known as well as before, and as far off as is usual."""

import numpy as np
import pytest
from identified import identified

from identify.model.files import InputError
from identify.uncertainty.posterior import posterior
from oed.planning.health_check import _changed as changed
from oed.planning.health_check import plan_check

SIZES = {"j2.theta": 0.005, "tool.x": 3.0, "tool.z": 2.0}


@pytest.fixture
def calibration(arc_welder):
    estimated = ("base.x", "j2.theta")
    return identified(arc_welder, arc_welder.theta, estimated=estimated, covariance=np.diag([0.01**2, 0.001**2]))


def test_what_slips_adds_to_what_is_known_and_what_does_not_stays(calibration):
    prior = changed(posterior(calibration), SIZES)

    C = prior.covariance(("base.x", "j2.theta", "tool.x", "tool.z"))
    np.testing.assert_allclose(np.diag(C), [0.01**2, 0.001**2 + 0.005**2, 9.0, 4.0], rtol=1e-6)


@pytest.mark.parametrize("n", [0, 10_000])
def test_touches_that_are_not_to_be_had_are_refused_with_how_many_there_are(n, calibration, arc_welder):
    with pytest.raises(InputError, match=rf"{n} touches are asked for, and \d+ were found that can be made"):
        plan_check(arc_welder, calibration, SIZES, n, count=60)
