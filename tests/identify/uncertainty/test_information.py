"""Information as a square root, held against closed forms and simulated estimates."""

from dataclasses import replace

import numpy as np
import pytest
from measured import touches_anywhere
from scipy.linalg import inv

from identify.model.files import InputError
from identify.model.measurement import rows as measured_rows
from identify.uncertainty.information import Information, prior_information
from identify.uncertainty.unknowns import Unknowns

ROBOTS = 4000


@pytest.fixture(scope="module")
def prior(arc_welder):
    return prior_information(arc_welder)


@pytest.fixture(scope="module")
def F(arc_welder, prior):
    return prior.unknowns.rows(measured_rows(arc_welder.wire, [touches_anywhere(arc_welder, 40)]))


def test_variances_are_those_of_the_normal_equations(prior, F, rng):
    A = rng.standard_normal((5, 2, len(prior.R)))

    after = prior.updated(F)

    C = inv(np.eye(len(prior.R)) + F.T @ F)
    assert after.variance(A) == pytest.approx(np.einsum("abi,ij,abj->ab", A, C, A), rel=1e-6)
    scale = prior.unknowns.scale[:2]
    assert after.covariance(prior.unknowns.names[:2]) == pytest.approx(C[:2, :2] * np.outer(scale, scale), rel=1e-6)


def test_touches_made_at_once_or_one_after_the_other_are_the_same(prior, F):
    whole, parts = prior.updated(F), prior.updated(F[:7]).updated(F[7:])

    assert pytest.approx(whole.R, abs=1e-9 * np.abs(whole.R).max()) == parts.R
    assert pytest.approx(np.triu(whole.R)) == whole.R


def test_digits_survive_where_normal_equations_lose_them(prior):
    """A difference of two parameters known a million times better than their sum: its variance keeps six digits."""
    k = len(prior.R)
    row = np.zeros((1, k))
    row[0, :2] = 1e9, -1e9
    difference = np.zeros((1, k))
    difference[0, :2] = 1.0, -1.0

    after = prior.updated(row)

    assert after.variance(difference) == pytest.approx([1 / (1e18 + 0.5)], rel=1e-6)


def test_the_predicted_error_is_that_of_simulated_estimates(prior, F, rng):
    """Robots and faces from their priors, touches scattered, all linear: the error of the most probable estimate."""
    k = len(prior.R)
    x = rng.standard_normal((ROBOTS, k))
    y = x @ F.T + rng.standard_normal((ROBOTS, len(F)))
    estimate = np.linalg.lstsq(np.vstack([F, np.eye(k)]), np.vstack([y.T, np.zeros((k, ROBOTS))]), rcond=None)[0].T

    deviation = np.sqrt(prior.updated(F).variance(np.eye(k)))

    assert np.sqrt(((estimate - x) ** 2).mean(axis=0)) == pytest.approx(deviation, rel=0.05)  # 4.5 standard errors


def test_draws_scatter_as_the_covariance_says(prior, F, rng):
    after = prior.updated(F)

    robots = after.robots(ROBOTS, rng)

    expected = np.linalg.norm(after.parameter_root(), axis=1)
    assert robots.std(axis=0) == pytest.approx(expected, rel=0.06)
    assert robots.mean(axis=0) == pytest.approx(after.theta, abs=5 * expected.max() / np.sqrt(ROBOTS))


def test_fixed_parameters_are_not_drawn(arc_welder, rng):
    robots = prior_information(replace(arc_welder, fixed=frozenset({"j2.a"}))).robots(5, rng)

    place = arc_welder.robot.parameters.index("j2.a")
    assert (robots[:, place] == arc_welder.theta[place]).all()


def test_a_covariance_and_the_information_that_it_came_from_say_the_same(arc_welder, prior, F):
    after = prior.updated(F)
    names = prior.unknowns.names[::-1]

    again = Information.of_covariance(prior.unknowns, arc_welder.theta, names, after.covariance(names))

    assert again.covariance() == pytest.approx(after.covariance(), rel=1e-5, abs=1e-12)


def test_of_what_a_covariance_does_not_name_the_prior_holds(prior):
    half = Information.of_covariance(prior.unknowns, prior.theta, ("base.x",), np.array([[0.04]]))

    assert half.covariance(["base.x", "base.y"]) == pytest.approx(np.diag([0.04, 100.0]))


def test_a_base_that_is_to_be_fitted_is_not_determined_until_touches_do(arc_welder, F, rng):
    fit = Information.prior(Unknowns.of(replace(arc_welder, base=None)))
    some = fit.updated(F[:3])

    assert np.isinf(some.variance(np.eye(len(fit.R))[:6])).sum() == 3  # three touches, six freedoms
    assert np.isfinite(some.variance(F[:3])).all()  # what these touches show
    assert "base.y" in some.undetermined()
    with pytest.raises(InputError, match=r"base.y.*do not determine it"):
        some.draws(2, rng)
    assert np.isfinite(fit.updated(F).variance(np.eye(len(fit.R)))).all()


def test_a_base_that_is_to_be_fitted_cannot_be_planned_for(arc_welder):
    with pytest.raises(InputError, match="base: fit says nothing about the place of the base"):
        prior_information(replace(arc_welder, base=None))
