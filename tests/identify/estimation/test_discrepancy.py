"""The factors on priors and noise: those of simulated arms are found, and what they promise is kept beyond the data."""

import numpy as np
import pytest

from identify.estimation.discrepancy import ERROR, GEOMETRY, LOOSE, Linear, average, folds


def arm(rng, noise=1.0, errors=0.3, rows=240):
    """A linear arm of two loose, ten geometric and twelve error unknowns over points in a cube."""
    point = rng.uniform(-1, 1, (rows, 3))
    frequency, phase = rng.normal(size=(22, 3)), rng.uniform(0, 6, 22)
    shapes = np.cos(point @ frequency.T + phase)
    A = np.column_stack([np.ones(rows), point[:, 0], 8 * shapes])
    kind = np.array([LOOSE] * 2 + [GEOMETRY] * 10 + [ERROR] * 12)
    x = np.where(kind == ERROR, errors, 1.0) * rng.standard_normal(24)
    return Linear(A, A @ x + noise * rng.standard_normal(rows), kind), point, x


def every(point):
    return folds(point, point, np.arange(len(point)))


@pytest.mark.parametrize("noise", [0.3, 1.0, 3.0])
def test_the_noise_of_an_arm_is_found_whatever_was_stated(noise):
    found = []
    for seed in range(5):
        linear, point, _ = arm(np.random.default_rng(seed), noise)
        found.append(average(linear, every(point)).noise)

    assert np.exp(np.mean(np.log(found))) == pytest.approx(noise, rel=0.3)


def test_small_joint_errors_get_small_priors_and_large_ones_large_priors():
    def factor(errors):
        arms = (arm(np.random.default_rng(seed), errors=errors) for seed in range(4))
        return np.exp(np.mean([np.log(average(linear, every(point)).errors) for linear, point, _ in arms]))

    assert factor(0.03) < factor(0.3) < factor(3.0)


def test_rows_beyond_the_data_lie_within_the_predicted_spread():
    inside = []
    for seed in range(20):
        linear, point, _ = arm(np.random.default_rng(seed))
        seen = point[:, 0] < 0
        part = linear.take(seen)

        posterior = average(part, every(point[seen])).posterior(part)

        A = linear.A[~seen]
        variance = ((A @ posterior.covariance) * A).sum(axis=1) + posterior.noise**2
        inside.append(np.mean((linear.y[~seen] - A @ posterior.mean) ** 2 < 1.96**2 * variance))

    assert 0.92 < np.mean(inside) <= 1.0


def test_few_rows_leave_the_stated_priors():
    rng = np.random.default_rng(0)
    linear, point, _ = arm(rng, rows=6)

    models = average(linear, every(point))

    assert 1 / 3 < models.geometry < 3
    assert 0.5 < models.noise < 2


def test_the_posterior_of_one_model_is_that_of_bayes(rng):
    from identify.estimation.discrepancy import GEOMETRIES, KAPPAS, NOISES, RATIOS, Models

    linear, _, _ = arm(rng)
    weight = np.zeros((len(RATIOS), len(GEOMETRIES), len(KAPPAS), len(NOISES)))
    weight[4, 2, 0, 12] = 1.0  # ratio 1, geometry 1, kappa 1, noise 1

    posterior = Models(weight).posterior(linear)

    precision = linear.A.T @ linear.A + np.diag(np.where(linear.kind == LOOSE, 0.01, 1.0))
    np.testing.assert_allclose(posterior.mean, np.linalg.solve(precision, linear.A.T @ linear.y), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(posterior.covariance, np.linalg.inv(precision), rtol=1e-6, atol=1e-9)
