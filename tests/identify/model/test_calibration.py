"""What a calibration says of itself: covariance carried to the tip, names, and sizes of errors."""

from dataclasses import replace

import numpy as np
import pytest
from identified import identified

from identify.model.calibration import SharedValue, coordinates, fingerprints, summarize

NAMES = ("base.x", "j2.theta", "tool.z")


@pytest.fixture
def calibration(arc_welder, rng):
    sizes = np.array([0.1, 1e-4, 0.05])
    root = rng.standard_normal((4, 4))
    joint = root @ root.T * np.outer([*sizes, 0.02], [*sizes, 0.02])
    shared = (SharedValue("face.top", "mm", 0.03, 0.02),)
    covariance = {"covariance": joint[:3, :3], "shared": shared, "shared_covariance": joint[3:]}
    return identified(arc_welder, arc_welder.theta, estimated=NAMES, combinations={"j1.d": {}}, **covariance), joint


def test_the_covariance_of_the_tip_is_that_of_robots_drawn_from_it(calibration, rng):
    calibration, _ = calibration
    cell, q = calibration.cell, np.array([0.2, 0.1, -0.3, 0.4, 0.9, 0.2])
    drawn = np.tile(calibration.theta, (20_000, 1))
    drawn[:, calibration.index] += rng.multivariate_normal(np.zeros(3), calibration.covariance, 20_000)

    expected = np.cov(cell.kinematics.tip(np.tile(q, (20_000, 1)), drawn)[0].T)

    found = calibration.tip_covariance(q[None])[0]
    assert np.linalg.norm(found - expected) < 0.05 * np.linalg.norm(expected)  # 20,000 draws: 1 %


def test_parameters_and_what_measurements_share_have_one_covariance(calibration):
    calibration, joint = calibration

    np.testing.assert_allclose(calibration.joint_covariance, joint)
    np.testing.assert_allclose(calibration.values, [*calibration.theta[calibration.index], 0.03])
    assert calibration.names == (*NAMES, "face.top")


def test_every_parameter_is_estimated_eliminated_or_fixed(calibration):
    calibration, _ = calibration
    status = {name: calibration.status(name) for name in calibration.cell.robot.parameters}

    assert {name for name, value in status.items() if value == "estimated"} == set(NAMES)
    assert {name for name, value in status.items() if value == "eliminated"} == {"j1.d"}
    assert (calibration.sigma > 0).sum() == len(NAMES)


def test_placements_tools_and_points_are_named_with_their_deviations(calibration):
    calibration, joint = calibration
    tool = replace(calibration.shared[0], name="tool.smr.x")

    assert calibration.named == ()  # a face is not one of them
    assert replace(calibration, shared=(tool,)).named == ((tool, pytest.approx(np.sqrt(joint[3, 3]))),)


def test_sizes_of_errors_are_those_counted_by_hand():
    errors = summarize(np.array([3.0, -4.0, 0.0, 0.0]))

    assert (errors.n, errors.mean_mm, errors.rms_mm, errors.max_mm) == (4, 1.75, 2.5, 4.0)
    assert errors.p95_mm == pytest.approx(3.85)  # between 3 and 4, at 0.95 x 3 = 2.85 steps from the smallest


def test_a_measurement_keeps_its_fingerprint_when_its_file_is_rewritten(rng):
    q = rng.uniform(-1, 1, (5, 6))

    assert fingerprints(q, np.zeros((5, 1))) == fingerprints(q + 1e-10, -np.zeros((5, 1)))
    assert len(set(fingerprints(q))) == 5
    assert not set(fingerprints(q)) & set(fingerprints(q + 1e-5))


def test_joint_values_and_tips_are_named_in_the_units_of_files(arc_welder):
    q = np.radians([[0.0, 10.0, 20.0, 30.0, 40.0, 50.0]])

    found = coordinates(arc_welder, arc_welder.theta, q)

    np.testing.assert_allclose([found[f"j{i} deg"][0] for i in range(1, 7)], np.degrees(q[0]))
    tip = arc_welder.kinematics.tip(q, arc_welder.theta)[0][0]
    np.testing.assert_allclose([found[f"{axis} mm"][0] for axis in "xyz"], tip)
