from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
import scipy.stats
from measured import poses_over_jig, positions_at, table_2, touches_at, with_offsets

from identify.estimation.calibrate import CalibrationFailed, calibrate
from identify.estimation.least_squares import LOSSES, LeastSquares, Objective
from identify.estimation.robust import _Fit
from identify.model.files import InputError
from identify.model.identifiability import structure
from identify.model.io.calibration_file import calibration_entry, read_calibration, write_calibration
from identify.model.measurement import measurement_model, rows
from identify.model.touch import joined

SIGMA = 0.05  # [mm]


@pytest.fixture(scope="module")
def poses(arc_welder):
    return poses_over_jig(arc_welder, 1200, np.random.default_rng(7))


def tip_error(cell, theta, truth, q):
    return np.linalg.norm(cell.kinematics.tip(q, theta)[0] - cell.kinematics.tip(q, truth)[0], axis=1)


def perturbed(cell, rng, size=0.3):
    """A robot whose kept parameters are off by a part of their priors."""
    truth = cell.theta.copy()
    kept = list(structure(cell).kept)
    truth[kept] += size * cell.scale[kept] * rng.standard_normal(len(kept))
    return truth, kept


def test_touches_bring_the_robot_of_table_1_to_that_of_table_2(arc_welder, poses, rng):
    truth = table_2(arc_welder)
    touches = touches_at(arc_welder, truth, poses[:200], rng, SIGMA)

    found = calibrate(arc_welder, touches, errors="cell")

    before = np.array([r.before_mm for r in found.residuals.values()])
    assert 15 < np.sqrt(np.mean(before**2)) < 30
    assert np.sqrt(np.mean(tip_error(arc_welder, found.theta, truth, poses[200:]) ** 2)) < SIGMA


def test_without_noise_the_robot_is_found_to_a_micrometre(arc_welder, poses, rng):
    truth = table_2(arc_welder)

    found = calibrate(
        arc_welder,
        touches_at(arc_welder, truth, poses[:100], rng, 1e-6),
        loss="linear",
        priors=False,
        parameters="identifiable",
        errors="cell",
    )

    # what the eliminated parameters change in second order is all that is left
    assert tip_error(arc_welder, found.theta, truth, poses[200:]).max() < 0.005


def test_a_base_100_mm_and_10_degrees_off_is_no_obstacle(arc_welder, poses, rng):
    truth = arc_welder.theta.copy()
    truth[:6] += [100, -100, 100, 0.17, -0.17, 0.17]

    found = calibrate(
        arc_welder,
        touches_at(arc_welder, truth, poses[:100], rng, SIGMA),
        priors=False,
        parameters="identifiable",
        errors="cell",
    )

    np.testing.assert_allclose(found.theta[:3], truth[:3], atol=1.0)
    assert np.sqrt(np.mean(tip_error(arc_welder, found.theta, truth, poses[200:]) ** 2)) < 2 * SIGMA


def test_intervals_are_true(arc_welder, poses):
    """Squared errors in units of the stated covariance follow the chi-square law over 200 robots."""
    rng = np.random.default_rng(3)
    squares = []
    for _ in range(200):
        truth, kept = perturbed(arc_welder, rng)
        q = poses[rng.choice(len(poses), 60, replace=False)]
        found = calibrate(
            arc_welder,
            touches_at(arc_welder, truth, q, rng, SIGMA),
            loss="linear",
            priors=False,
            parameters="identifiable",
            folds=0,
            errors="cell",
        )
        error = (found.theta - truth)[kept]
        C = found.covariance / found.noise**2  # without the widening: sigma is known here
        squares.append(error @ np.linalg.solve(C, error))

    low, high = scipy.stats.chi2(25 * 200).ppf([0.0005, 0.9995])
    assert low < sum(squares) < high
    assert scipy.stats.kstest(squares, scipy.stats.chi2(25).cdf).pvalue > 0.001


def test_ipopt_finds_the_minimum_that_scipy_finds(arc_welder, poses, rng):
    touches = touches_at(arc_welder, table_2(arc_welder), poses[:80], rng, SIGMA)
    model, found_rows = measurement_model(arc_welder.robot), rows(arc_welder.wire, [touches])

    found = calibrate(
        arc_welder, touches, loss="linear", priors=False, parameters="identifiable", folds=0, errors="cell"
    )

    def residual(x):
        theta = arc_welder.theta.copy()
        theta[found.index] += x * arc_welder.scale[found.index]
        return model.residual(theta, found_rows) / found_rows.sigma

    peer = scipy.optimize.least_squares(residual, np.zeros(25), x_scale="jac", xtol=1e-12, ftol=1e-12)
    x = (found.theta - arc_welder.theta)[found.index] / arc_welder.scale[found.index]
    # Ipopt stops at a ten-thousandth of a standard deviation a column; nearly dependent ones reach a hundredth
    deviation = found.sigma[found.index] / arc_welder.scale[found.index] / found.noise
    np.testing.assert_allclose(x, peer.x, atol=float((0.02 * deviation).max()))
    assert 0.5 * float(residual(x) @ residual(x)) == pytest.approx(peer.cost, rel=1e-6)


@pytest.mark.parametrize("loss", LOSSES)
def test_a_loss_s_gradient_and_curvature_are_those_of_finite_differences(loss, rng):
    A, b = rng.normal(size=(30, 3)), 3 * rng.normal(size=30)
    objective = Objective(lambda x: [(slice(None), A @ x - b, A)], np.full(3, 2.0), np.ones(30), loss)
    x, step = rng.normal(size=3), 1e-5

    value, gradient, hessian = objective.at(x)
    around = [(objective.at(x + e)[0], objective.at(x - e)[0]) for e in step * np.eye(3)]
    slopes = [(objective.at(x + e)[1] - objective.at(x - e)[1]) / (2 * step) for e in step * np.eye(3)]

    np.testing.assert_allclose(gradient, [(up - down) / (2 * step) for up, down in around], rtol=1e-6)
    if loss != "cauchy":  # its curvature turns negative far out, where zero stands in its place
        np.testing.assert_allclose(hessian, slopes, rtol=1e-4, atol=1e-4)
    assert np.linalg.eigvalsh(hessian).min() > 0
    assert value > 0


def test_a_linear_problem_with_priors_has_the_closed_form_answer(rng):
    A, b, prior = rng.normal(size=(20, 4)), rng.normal(size=20), np.array([0.1, 1.0, 10.0, np.inf])

    objective = Objective(lambda x: [(slice(None), A @ x - b, A)], prior, np.ones(20))
    solution = LeastSquares(objective, np.zeros(4)).solve(np.zeros(4))

    assert solution.converged
    np.testing.assert_allclose(solution.x, np.linalg.solve(A.T @ A + np.diag(prior**-2), A.T @ b), atol=1e-4)


def test_a_problem_solved_while_another_is_being_solved_does_not_disturb_it(rng):
    A, b, C, d = rng.normal(size=(9, 3)), rng.normal(size=9), rng.normal(size=(9, 3)), rng.normal(size=9)
    inner = []

    def linearize(x):
        objective = Objective(lambda y: [(slice(None), C @ y - d, C)], np.full(3, np.inf), np.ones(9))
        inner.append(LeastSquares(objective, np.zeros(3)).solve(np.zeros(3)).x)
        return [(slice(None), A @ x - b, A)]

    outer = LeastSquares(Objective(linearize, np.full(3, np.inf), np.ones(9)), np.zeros(3)).solve(np.zeros(3))

    np.testing.assert_allclose(outer.x, np.linalg.lstsq(A, b)[0], atol=1e-6)
    for x in inner:
        np.testing.assert_allclose(x, np.linalg.lstsq(C, d)[0], atol=1e-6)


@pytest.mark.parametrize("loss", ["huber", "cauchy"])
def test_touches_that_are_5_mm_wrong_are_named_and_not_used(loss, arc_welder, poses, rng):
    truth = table_2(arc_welder)
    touches = touches_at(arc_welder, truth, poses[:200], rng, SIGMA)
    wrong = np.zeros(200)
    wrong[[17, 140]] = 5.0, -5.0

    found = calibrate(arc_welder, with_offsets(touches, touches.offset + wrong), loss=loss, errors="cell")

    assert set(found.outliers) == {"t18", "t141"}
    assert not found.residuals["t18"].used
    assert np.sqrt(np.mean(tip_error(arc_welder, found.theta, truth, poses[200:]) ** 2)) < SIGMA


def test_good_touches_are_rarely_called_outliers(arc_welder, poses):
    rng = np.random.default_rng(11)
    named = 0
    for _ in range(20):
        truth, _ = perturbed(arc_welder, rng)
        touches = touches_at(arc_welder, truth, poses[rng.choice(len(poses), 80, replace=False)], rng, SIGMA)
        named += len(calibrate(arc_welder, touches, folds=0, errors="cell").outliers)

    assert named <= 4  # of 1600 good touches


@pytest.mark.parametrize("wrong", [0.0, 0.2, 5.0])
@pytest.mark.parametrize("parameters", ["all", "identifiable"])
def test_who_agrees_is_the_same_whether_the_robust_fit_is_made_or_seen_to_change_nothing(
    wrong, parameters, arc_welder, poses, monkeypatch
):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        touches = touches_at(arc_welder, table_2(arc_welder), poses[:100], rng, SIGMA)
        touches = replace(touches, offset=touches.offset + wrong * (np.arange(100) % 20 == 7))

        quick = calibrate(arc_welder, touches, parameters=parameters, folds=0, errors="cell")
        with monkeypatch.context() as patch:
            patch.setattr(_Fit, "foreseen", lambda _, x, weight: (x, False))
            slow = calibrate(arc_welder, touches, parameters=parameters, folds=0, errors="cell")

        deviation = np.sqrt(np.diag(slow.covariance))
        assert set(quick.outliers) == set(slow.outliers)
        np.testing.assert_allclose((quick.theta - slow.theta)[slow.index] / deviation, 0, atol=0.01)


def test_tight_priors_hold_parameters_where_they_are(arc_welder, poses, rng):
    tight = replace(arc_welder, priors=replace(arc_welder.priors, link=(1e-6, 1e-9)))
    touches = touches_at(arc_welder, table_2(arc_welder), poses[:100], rng, 1.0)

    found = calibrate(tight, touches, loss="linear", folds=0, errors="cell")

    # the scatter of a fit that may not move its links widens sigma, so the links keep to a few priors
    links = [i for i in found.index if 6 <= i < 36]
    assert (np.abs(found.theta - tight.theta)[links] < 1e-3).all()


def test_bounds_hold(arc_welder, poses, rng):
    bounded = replace(arc_welder, bounds={"j2.a": (350.0, 352.0)})
    touches = touches_at(arc_welder, table_2(arc_welder), poses[:100], rng, SIGMA)

    found = calibrate(bounded, touches, loss="linear", folds=0, errors="cell")

    value = found.theta[arc_welder.robot.parameters.index("j2.a")]
    assert 350.0 - 1e-6 <= value <= 352.0 + 1e-6


def test_fixed_parameters_stay_and_are_called_fixed(arc_welder, poses, rng):
    fixed = replace(arc_welder, fixed=frozenset({"j4.a"}))
    touches = touches_at(arc_welder, arc_welder.theta, poses[:100], rng, SIGMA)

    found = calibrate(fixed, touches, errors="cell")

    assert found.status("j4.a") == "fixed"
    assert found.theta[arc_welder.robot.parameters.index("j4.a")] == 0.0


def test_touches_and_positions_are_used_together(arc_welder, poses, rng):
    truth = table_2(arc_welder)
    touches = touches_at(arc_welder, truth, poses[:40], rng, SIGMA)
    positions = positions_at(arc_welder, truth, poses[40:70], rng, SIGMA)

    found = calibrate(arc_welder, touches, positions, errors="cell")

    assert found.fit.n + len(found.outliers) == 70
    assert np.sqrt(np.mean(tip_error(arc_welder, found.theta, truth, poses[200:]) ** 2)) < 2 * SIGMA


@pytest.mark.parametrize("kind", [touches_at, positions_at])
@pytest.mark.parametrize("unknown", [{"base"}, {"tool"}, {"base", "tool"}])
def test_a_base_and_a_tool_that_nobody_measured_are_found(kind, unknown, arc_welder, poses, rng):
    truth = arc_welder.theta.copy()
    truth[:6] = [-1200.0, 300.0, 90.0, 2.0, 0.5, -0.7]
    truth[-6:-3] = [40.0, -25.0, 180.0]
    known = {"base": truth[:6], "tool": truth[-6:]}
    cell = replace(arc_welder, wire=replace(arc_welder.wire, shape="point"))
    cell = replace(cell, **{key: None if key in unknown else value for key, value in known.items()})

    found = calibrate(cell, kind(cell, truth, poses[:150], rng, SIGMA), errors="cell")

    assert np.sqrt(np.mean(tip_error(cell, found.theta, truth, poses[200:]) ** 2)) < 2 * SIGMA


def test_too_few_touches_are_refused_with_how_many_to_add(arc_welder, poses, rng):
    touches = touches_at(arc_welder, arc_welder.theta, poses[:3], rng)

    with pytest.raises(InputError, match=r"3 equations cannot determine .* parameters; make at least"):
        calibrate(arc_welder, touches, parameters="identifiable", errors="cell")


def test_touches_on_one_face_are_refused_with_the_faces_to_touch(arc_welder, poses, rng):
    touches = touches_at(arc_welder, arc_welder.theta, poses[:300], rng)
    up = touches.take(touches.normal[:, 2] == 1)

    with pytest.raises(InputError, match=r"base\.[xy].* cannot be told apart; no face looks along [xy] or [xy]"):
        calibrate(arc_welder, up, parameters="identifiable", errors="cell")


def test_a_joint_that_stands_still_costs_its_parameters_not_the_calibration(arc_welder, poses, rng):
    truth = table_2(arc_welder)
    still = poses[:100].copy()
    still[:, 5] = 0.4

    found = calibrate(
        arc_welder, touches_at(arc_welder, truth, still, rng, SIGMA), parameters="identifiable", errors="cell"
    )

    assert len(found.estimated) == 23
    again = poses[200:].copy()
    again[:, 5] = 0.4
    assert np.sqrt(np.mean(tip_error(arc_welder, found.theta, truth, again) ** 2)) < 2 * SIGMA


def test_a_direction_that_the_touches_see_less_well_than_the_prior_is_called_weak(arc_welder, poses, rng):
    """All touches within a few millimetres: most of the robot is told by the tolerances alone."""
    near = poses[:1] + 0.003 * rng.standard_normal((100, 6))

    found = calibrate(arc_welder, touches_at(arc_welder, arc_welder.theta, near, rng, SIGMA), folds=0, errors="cell")

    assert len(found.weak) > 3


def test_a_solver_that_does_not_converge_gives_no_numbers(arc_welder, poses, rng, monkeypatch):
    monkeypatch.setattr("identify.estimation.ipopt.ITERATIONS", 1)
    touches = touches_at(arc_welder, table_2(arc_welder), poses[:100], rng)

    with pytest.raises(CalibrationFailed, match="Maximum_Iterations_Exceeded"):
        calibrate(arc_welder, touches, errors="cell")


def test_errors_in_regions_held_out_are_larger_than_those_of_the_fit(arc_welder, poses, rng):
    touches = touches_at(arc_welder, table_2(arc_welder), poses[:100], rng, SIGMA)

    found = calibrate(arc_welder, touches, errors="cell")

    assert found.held_out is not None
    assert found.held_out.n == found.fit.n
    assert found.held_out.rms_mm > found.fit.rms_mm


def test_the_scatter_tells_a_sigma_that_is_too_small(arc_welder, poses, rng):
    touches = touches_at(arc_welder, table_2(arc_welder), poses[:200], rng, 3 * SIGMA)
    claimed = replace(touches, sigma=np.full(200, SIGMA))

    found = calibrate(arc_welder, claimed, errors="cell")

    assert found.scatter_significant
    assert found.scatter == pytest.approx(3.0, rel=0.15)  # 4 sigma of a deviation from 175 degrees of freedom


def test_a_calibration_is_read_back_as_it_was_written(arc_welder, poses, rng, tmp_path):
    touches = touches_at(arc_welder, table_2(arc_welder), poses[:60], rng)
    found = calibrate(arc_welder, touches, inputs={"a": "b"}, parameters="identifiable", errors="cell")

    write_calibration(tmp_path / "calibration.json", found)
    again = read_calibration(tmp_path / "calibration.json")

    np.testing.assert_allclose(again.theta, found.theta, rtol=1e-12)
    np.testing.assert_allclose(again.covariance, found.covariance, rtol=1e-9)
    assert calibration_entry(again)["inputs"] == {"a": "b"}
    assert again.residuals == found.residuals
    assert again.cell.jig is not None
    assert again.combinations["j2.d"] == pytest.approx({"j3.d": 1.0})


def test_a_robot_far_off_its_drawing_is_found_where_what_the_drawing_makes_dependent_is_kept(arc_welder, poses):
    off = {"identifiable": [], "all": []}
    for seed in range(5):
        rng = np.random.default_rng(seed)
        truth = arc_welder.theta + arc_welder.prior * rng.standard_normal(len(arc_welder.theta))
        touches = touches_at(arc_welder, truth, poses[:100], rng, SIGMA)
        for parameters, errors in off.items():
            found = calibrate(arc_welder, touches, parameters=parameters, folds=0, errors="cell")
            errors.append(np.sqrt(np.mean(tip_error(arc_welder, found.theta, truth, poses[200:]) ** 2)))

    assert len(found.estimated) == len(truth)
    assert max(off["all"]) < 0.08
    assert max(off["identifiable"]) > 2 * max(off["all"])


@pytest.mark.parametrize("seed", [0, 1])
def test_touches_on_another_step_of_the_jig_are_left_out_where_all_parameters_are_estimated(arc_welder, poses, seed):
    rng = np.random.default_rng(seed)
    truth = arc_welder.theta + arc_welder.prior * rng.standard_normal(len(arc_welder.theta))
    touches = touches_at(arc_welder, truth, poses[:60], rng, SIGMA)
    offset = touches.offset.copy()
    offset[[3, 17, 30, 44]] += [-23, -56, 83, 100]  # [mm]: least squares bend the robot by tens of degrees, without end

    found = calibrate(arc_welder, with_offsets(touches, offset), folds=0, errors="cell")

    assert list(found.outliers) == ["t4", "t18", "t31", "t45"]
    assert np.sqrt(np.mean(tip_error(arc_welder, found.theta, truth, poses[200:]) ** 2)) < 0.15


def test_without_tolerances_dependent_parameters_cannot_all_be_estimated(arc_welder, poses, rng):
    touches = touches_at(arc_welder, arc_welder.theta, poses[:100], rng, SIGMA)

    with pytest.raises(InputError, match=r"nothing is known of base\.x"):
        calibrate(arc_welder, touches, priors=False, errors="cell")


def test_rows_of_touches_that_met_nothing_change_nothing(arc_welder, poses):
    rng = np.random.default_rng(5)
    touches = touches_at(arc_welder, perturbed(arc_welder, rng)[0], poses[:60], rng)
    misses = replace(touches.take(np.arange(3)), ids=("m1", "m2", "m3"), status=("miss", "early", "outlier"))

    alone, beside = (calibrate(arc_welder, t, errors="cell", folds=0) for t in (touches, joined(touches, misses)))

    np.testing.assert_array_equal(alone.theta, beside.theta)
    assert set(beside.residuals) == set(touches.ids)
