"""Coordinates of designs: nothing is lost of all unknowns, and identifiable parameters are those of the literature."""

import numpy as np
import pytest
from measured import touches_anywhere
from scipy.linalg import inv

from identify.model.identifiability import structure
from identify.model.measurement import rows as measured_rows
from identify.uncertainty.coordinates import of_all_unknowns, of_identifiable
from identify.uncertainty.information import prior_information


@pytest.fixture(scope="module")
def prior(arc_welder):
    return prior_information(arc_welder)


@pytest.fixture(scope="module")
def F(arc_welder, prior):
    return prior.unknowns.rows(measured_rows(arc_welder.wire, [touches_anywhere(arc_welder, 500, 8)]))


@pytest.mark.parametrize("after", [0, 20])
def test_rows_in_fewer_coordinates_promise_the_same(prior, F, after, rng):
    prior = prior.updated(F[450 : 450 + after])
    zone = prior.unknowns.tip_rows(rng.uniform(-1, 1, (20, 6)))
    fewer = of_all_unknowns(prior, F)
    f, g = F[:50] @ fewer.basis, fewer.of_tip(zone)

    variance = np.einsum("pik,kl,pil->p", g, inv(fewer.information(f)), g)

    assert len(fewer) < len(prior.R)
    assert variance == pytest.approx(prior.updated(F[:50]).variance(zone).sum(axis=1), rel=2e-3)


def test_identifiable_coordinates_tell_the_same_of_the_drawn_robot_as_all_parameters(arc_welder, prior, F):
    """Of faces that stand where they are drawn and a pointed wire, touches tell of nothing else."""
    coordinates = of_identifiable(prior)
    kept = [arc_welder.robot.parameters[i] for i in structure(arc_welder).kept]
    tip = prior.unknowns.tip_rows(np.random.default_rng(1).uniform(-1, 1, (200, 6)))

    spread = prior.variance(tip)  # before touches, of all parameters
    g = coordinates.of_tip(tip)

    assert coordinates.names == tuple(kept)
    assert np.einsum("pik,kl,pil->pi", g, inv(coordinates.precision), g) == pytest.approx(spread, rel=1e-6)
