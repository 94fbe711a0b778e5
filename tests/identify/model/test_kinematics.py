"""Forward kinematics and Jacobians against the paper's closed form, products of matrices and finite differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from oracle import error_propagation, forward
from scipy.spatial.transform import Rotation

from identify.model.frames import transform
from identify.model.io.description import library, read_robot
from identify.model.joint import Joint
from identify.model.kinematics import Kinematics
from identify.model.robot import Robot

ROBOTS = {name: read_robot(path) for name, path in library("robots").items()}
KINEMATICS = {name: Kinematics(robot) for name, robot in ROBOTS.items()}
POSES = 20


def imperfect(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """Parameters of a robot built, placed and tooled anyhow: every one away from zero."""
    theta = robot.theta(rng.normal(0, [500, 500, 500, 1, 1, 1]), rng.normal(0, [100, 100, 400, 1, 1, 1]))
    return theta + rng.normal(size=theta.size) * np.where(robot.angular, 0.02, 5.0)


def postures(robot: Robot, rng: np.random.Generator, n: int = POSES) -> np.ndarray:
    return rng.uniform(robot.lower, robot.upper, (n, len(robot.joints)))


@pytest.fixture(params=ROBOTS)
def kinematics(request):
    return KINEMATICS[request.param]


def test_the_tip_is_the_product_of_all_elementary_motions(kinematics, rng):
    robot, theta = kinematics.robot, imperfect(kinematics.robot, rng)
    q = postures(robot, rng)

    position, R = kinematics.tip(q, theta)

    expected = np.stack([forward(robot, row, theta) for row in q])
    np.testing.assert_allclose(position, expected[:, :3, 3], atol=1e-9)  # [mm], at about 2000 mm
    np.testing.assert_allclose(R, expected[:, :3, :3], atol=1e-12)


def test_the_jacobian_is_the_closed_form_of_the_paper(kinematics, rng):
    robot, theta = kinematics.robot, imperfect(kinematics.robot, rng)
    q = postures(robot, rng)

    position, J = kinematics.tip_jacobian(q, theta)

    np.testing.assert_allclose(J, [error_propagation(robot, row, theta) for row in q], atol=1e-9)
    np.testing.assert_allclose(position, kinematics.tip(q, theta)[0], atol=1e-9)


def test_the_jacobian_at_nominal_parameters_is_the_closed_form_of_the_paper(kinematics, rng):
    robot = kinematics.robot
    theta = robot.theta(np.zeros(6), np.zeros(6))  # where terms vanish and must do so exactly
    q = postures(robot, rng)

    _, J = kinematics.tip_jacobian(q, theta)

    np.testing.assert_allclose(J, [error_propagation(robot, row, theta) for row in q], atol=1e-9)


def test_the_jacobian_is_the_slope_of_the_tip(kinematics, rng):
    robot, theta = kinematics.robot, imperfect(kinematics.robot, rng)
    q = postures(robot, rng, 3)
    step = np.where(robot.angular, 1e-6, 1e-3)

    _, J = kinematics.tip_jacobian(q, theta)

    for k, h in enumerate(step):
        ahead, behind = theta.copy(), theta.copy()
        ahead[k], behind[k] = theta[k] + h, theta[k] - h
        slope = (kinematics.tip(q, ahead)[0] - kinematics.tip(q, behind)[0]) / (ahead[k] - behind[k])
        np.testing.assert_allclose(J[:, :, k], slope, atol=1e-5)  # rounding of 2000 mm over 2e-6 rad


def test_the_pose_jacobian_is_velocity_and_spin_of_the_tip(kinematics, rng):
    robot, theta = kinematics.robot, imperfect(kinematics.robot, rng)
    q = postures(robot, rng, 3)

    position, R, J = kinematics.pose_jacobian(q, theta)

    np.testing.assert_allclose(position, kinematics.tip(q, theta)[0], atol=1e-9)
    np.testing.assert_allclose(R, kinematics.tip(q, theta)[1], atol=1e-12)
    for k in range(len(robot.joints)):
        h = 1e-6 * np.eye(len(robot.joints))[k]
        (ahead, R_ahead), (behind, R_behind) = kinematics.tip(q + h, theta), kinematics.tip(q - h, theta)
        spin = Rotation.from_matrix(R_ahead @ R_behind.transpose(0, 2, 1)).as_rotvec() / 2e-6
        np.testing.assert_allclose(J[:, :3, k], (ahead - behind) / 2e-6, atol=1e-5)
        np.testing.assert_allclose(J[:, 3:, k], spin, atol=1e-8)


def test_a_pendant_shows_the_flange_wherever_the_robot_stands_and_whatever_it_carries(kinematics, rng):
    robot, theta = kinematics.robot, imperfect(kinematics.robot, rng)
    q = postures(robot, rng)

    position, R = kinematics.flange(q, theta)

    bare = theta.copy()
    bare[:6] = bare[-6:] = 0.0
    expected = np.stack([forward(robot, row, bare) for row in q])
    np.testing.assert_allclose(position, expected[:, :3, 3], atol=1e-9)
    np.testing.assert_allclose(R, expected[:, :3, :3], atol=1e-12)


def test_the_frames_of_the_links_lead_from_the_base_to_the_tip(kinematics, rng):
    robot, theta = kinematics.robot, imperfect(kinematics.robot, rng)
    q = postures(robot, rng)

    frames = [f.reshape(-1, 3, 4) for f in kinematics.links(q, theta)]

    position, R = kinematics.tip(q, theta)
    tool = transform(theta[-6:])
    np.testing.assert_allclose(frames[0], np.broadcast_to(transform(theta[:6])[:3], (POSES, 3, 4)), atol=1e-12)
    np.testing.assert_allclose(frames[-1][:, :, :3] @ tool[:3, 3] + frames[-1][:, :, 3], position, atol=1e-9)
    np.testing.assert_allclose(frames[-1][:, :, :3] @ tool[:3, :3], R, atol=1e-12)
    for i, joint in enumerate(robot.joints):  # a joint moves what is behind it and nothing before it
        moved = [f.reshape(-1, 3, 4) for f in kinematics.links(q + 0.1 * np.eye(len(robot.joints))[i], theta)]
        np.testing.assert_array_equal(moved[i], frames[i])
        assert np.abs(moved[i + 1] - frames[i + 1]).max() > 0.05, joint.name


lengths = st.sampled_from([0.0, 350.0, -60.0]) | st.floats(-1000, 1000)
angles = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi]) | st.floats(-4, 4)
joints = st.builds(
    Joint,
    name=st.just("j"),
    prismatic=st.booleans(),
    theta=angles,
    d=lengths,
    a=lengths,
    alpha=angles,
    beta=angles,
    lower=st.just(-3.0),
    upper=st.just(3.0),
    speed=st.just(1.0),
)
frames = st.builds(lambda p, r: transform(np.array([*p, *r])), st.tuples(*[lengths] * 3), st.tuples(*[angles] * 3))


@st.composite
def robots(draw):
    chain = draw(st.lists(joints, min_size=1, max_size=8))
    named = tuple(Joint(**{**vars(joint), "name": f"j{i + 1}"}) for i, joint in enumerate(chain))
    return Robot("any", named, base_T_first=draw(frames), last_T_flange=draw(frames))


@given(robots(), st.data())
def test_any_chain_of_joints_obeys_the_closed_form(robot, data):
    q = data.draw(arrays(float, len(robot.joints), elements=angles))
    ends = data.draw(arrays(float, 12, elements=angles))
    theta = robot.theta(ends[:6], ends[6:])

    position, J = Kinematics(robot).tip_jacobian(q, theta)

    reach = 1.0 + np.abs(np.where(robot.angular, 0, theta)).sum()
    expected = forward(robot, q, theta)
    np.testing.assert_allclose(position[0], expected[:3, 3], rtol=0, atol=1e-12 * reach)
    np.testing.assert_allclose(J[0], error_propagation(robot, q, theta), rtol=0, atol=1e-12 * reach)
