"""Joint error models: rows of one table, each zero on a nominal robot, with slopes that differences confirm."""

from dataclasses import replace

import numpy as np
import pytest
from cells import cell_of
from measured import positions_at

from identify.estimation.calibrate import calibrate
from identify.model.files import InputError
from identify.model.frames import transform
from identify.model.identifiability import structure
from identify.model.io.description import library, read_cell, read_robot
from identify.model.io.entries import cell_entry, cell_from_entry
from identify.model.joint_error_models import ERROR_MODELS, SIZES, Term
from identify.model.kinematics import Kinematics
from identify.model.measurement import Rows, measurement_model, rows, tip_rows, touch_conditions
from identify.model.robot import Robot

MASSES = (12.0, 9.0, 7.0, 3.0, 2.0, 0.5, 0.4)
CHOICES = {**{name: (name,) for name in ERROR_MODELS}, "all": tuple(ERROR_MODELS)}
BASE, TOOL = np.array([100.0, 200, 300, 0.4, 0.02, -0.03]), np.array([10.0, -20, 300, 0.1, 0.3, 0.2])


def robot_with(errors: tuple[str, ...], name: str = "irb120", weighed: bool = False) -> Robot:
    robot = read_robot(library("robots")[name])
    if weighed:
        joints = [
            replace(j, mass=m, centre=(-0.3 * j.a, 20.0, 10.0)) for j, m in zip(robot.joints, MASSES, strict=False)
        ]
        robot = replace(robot, joints=tuple(joints), payload=(3.0, (10.0, 0.0, 80.0)))
    return replace(robot, errors=errors)


def postures(robot: Robot, rng: np.random.Generator, n: int) -> np.ndarray:
    return rng.uniform(robot.lower, robot.upper, (n, len(robot.joints)))


def touched(robot: Robot, rng: np.random.Generator, m: int) -> Rows:
    """Planes met from both sides, at many temperatures and with many payloads."""
    joints = len(robot.joints)
    normal = rng.normal(size=(m, 3))
    return Rows(
        postures(robot, rng, m),
        normal / np.linalg.norm(normal, axis=1)[:, None],
        np.zeros(m),
        np.full(m, 0.6),
        np.ones(m),
        (),
        np.arange(m),
        np.column_stack([rng.choice([-1.0, 0, 1], (m, joints)), rng.normal(0, 5, m), rng.uniform(-1, 2, m)]),
    )


def some(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """Parameters with every error of the size that is usual."""
    theta = robot.theta(BASE, TOOL)
    sizes = [SIZES[key].usual * SIZES[key].inside for _, key, _ in robot.error_parameters]
    theta[6 + 5 * len(robot.joints) : -6] = rng.normal(0, sizes)
    return theta


@pytest.mark.parametrize("weighed", [False, True])
@pytest.mark.parametrize("errors", CHOICES.values(), ids=CHOICES)
@pytest.mark.parametrize("name", ["irb120", "scara", "arm7"])
def test_a_robot_whose_error_parameters_are_zero_is_the_nominal_robot(name, errors, weighed, rng):
    robot, bare = robot_with(errors, name, weighed), robot_with((), name)
    q = postures(bare, rng, 30)

    found = Kinematics(robot).tip(q, robot.theta(BASE, TOOL))

    for with_errors, without in zip(found, Kinematics(bare).tip(q, bare.theta(BASE, TOOL)), strict=True):
        np.testing.assert_allclose(with_errors, without, atol=1e-9)  # [mm]


@pytest.mark.parametrize("weighed", [False, True])
@pytest.mark.parametrize("errors", CHOICES.values(), ids=CHOICES)
def test_the_jacobian_by_error_parameters_is_the_slope_of_the_residual(errors, weighed, rng):
    robot = robot_with(errors, weighed=weighed)
    model, rows, theta = measurement_model(robot), touched(robot, rng, 12), some(robot, rng)

    _, J = model.linearize(theta, rows)

    for k, h in enumerate(np.where(robot.angular, 1e-6, 1e-4)):
        step = h * np.eye(len(theta))[k]
        slope = (model.residual(theta + step, rows) - model.residual(theta - step, rows)) / (2 * h)
        np.testing.assert_allclose(J[:, k], slope, atol=1e-4 * max(1.0, np.abs(slope).max()))


@pytest.mark.parametrize("errors", CHOICES.values(), ids=CHOICES)
def test_many_rows_run_by_numpy_agree_with_few_run_by_casadi(errors, rng):
    robot = robot_with(errors)
    rows, theta, model = touched(robot, rng, 600), some(robot, rng), measurement_model(robot)

    r, J = model.linearize(theta, rows)  # 600 rows: on the tape

    few = [model.linearize(theta, rows.take(np.arange(i, i + 100))) for i in range(0, 600, 100)]
    np.testing.assert_allclose(r, np.concatenate([part for part, _ in few]), atol=1e-9)
    np.testing.assert_allclose(J, np.vstack([part for _, part in few]), atol=1e-7)


@pytest.mark.parametrize("errors", CHOICES.values(), ids=CHOICES)
def test_the_pose_jacobian_follows_the_arm_with_its_errors(errors, rng):
    robot = robot_with(errors)
    kinematics, theta, q = Kinematics(robot), some(robot, rng), postures(robot, rng, 5)

    J = kinematics.pose_jacobian(q, theta)[2]

    for k in range(len(robot.joints)):
        h = 1e-6 * np.eye(len(robot.joints))[k]
        slope = (kinematics.tip(q + h, theta)[0] - kinematics.tip(q - h, theta)[0]) / 2e-6
        np.testing.assert_allclose(J[:, :3, k], slope, atol=0.02)  # [mm/rad] of 900: a tilt's square


def test_parameters_of_error_models_stand_between_the_joints_and_the_tool():
    robot = robot_with(("compliance", "harmonics"))

    names = robot.parameters

    assert names[35:40] == ("j6.beta", "j1.cos1", "j1.sin1", "j1.cos2", "j1.sin2")
    assert "j2.load" in names
    assert names[-6] == "tool.x"


def test_a_weight_bends_a_joint_by_its_compliance_times_its_torque():
    robot = robot_with(("compliance",), weighed=True)
    theta, kinematics = robot.theta(np.zeros(6), np.zeros(6)), Kinematics(robot)
    names, per_knm = robot.parameters, SIZES["compliance_deg_knm"].inside
    q = np.radians([[0.0, 90, 0, 0, 0, 0]])  # the upper arm level: weights pull joint 2 down
    theta[names.index("j2.compliance")] = 10 * per_knm

    fell = kinematics.flange(q, robot.theta(np.zeros(6), np.zeros(6)))[0] - kinematics.flange(q, theta)[0]

    frames = np.array(kinematics.links(q, robot.theta(np.zeros(6), np.zeros(6))))[:, 0]
    joints = robot.joints[1:]
    places = [T[:, :3] @ joint.centre + T[:, 3] for T, joint in zip(frames[2:], joints, strict=True)]
    places.append(frames[-1][:, :3] @ robot.payload[1] + frames[-1][:, 3])
    masses = [joint.mass for joint in joints] + [robot.payload[0]]
    torque = sum(9.80665 * m * p[0] / 1000 for m, p in zip(masses, places, strict=True))  # joint 2 stands at x = 0
    turned = 10 * per_knm * torque
    assert fell[0, 2] == pytest.approx(2 * np.sin(turned / 2) * frames[-1][0, 3], rel=0.01)
    assert torque > 30


def test_what_geometry_explains_is_not_called_an_error(arc_welder):
    cell = replace(arc_welder, robot=replace(arc_welder.robot, errors=("harmonics", "compliance", "gear")))

    found = structure(cell)

    assert not {"j1.sag3", "j1.load"} & set(found.names)  # no weight turns an upright axis
    geometric = structure(arc_welder)
    assert {geometric.names[i] for i in geometric.kept} <= {found.names[i] for i in found.kept}


def test_a_robot_that_a_urdf_hangs_upside_down_has_the_same_errors_when_its_file_is_read_again():
    """Axis 1 is as upright as rounding leaves it: the file holds half a turn, the URDF a matrix of whole numbers."""
    robot = replace(robot_with(("compliance",)), base_T_first=np.diag([1.0, -1.0, -1.0, 1.0]))
    again = replace(robot, base_T_first=transform(np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.pi])))

    assert again.base_T_first[2, 1] != 0
    assert again.parameters == robot.parameters
    assert not any(name.startswith("j1.") for name, _, _ in robot.error_parameters)


def test_a_calibration_estimates_the_errors_it_is_asked_for(rng):
    cell = replace(cell_of("irb120"), robot=robot_with(("harmonics",)))
    theta = cell.theta.copy()
    theta[cell.robot.parameters.index("j2.cos2")] = np.radians(0.03)

    found = calibrate(
        cell, positions_at(cell, theta, postures(cell.robot, rng, 150), rng, 0.02), folds=0, errors="cell"
    )

    i = cell.robot.parameters.index("j2.cos2")
    assert found.theta[i] == pytest.approx(theta[i], abs=3 * found.sigma[i])
    assert np.degrees(found.sigma[i]) < 0.003


def test_rows_with_two_payloads_recover_the_robot_that_bends_under_both(rng):
    """The truth is measured on two robots, each with a payload of its own; the rows say which mass hung where."""
    robot = robot_with(("compliance",), weighed=True)
    cell = replace(cell_of("irb120"), robot=robot)
    heavy = replace(cell, robot=replace(robot, payload=(12.0, robot.payload[1])))
    theta = cell.theta.copy()
    for name in ("j2.compliance", "j3.compliance"):
        theta[robot.parameters.index(name)] = 20 * SIZES["compliance_deg_knm"].inside
    q = postures(robot, rng, 60)
    light = positions_at(cell, theta, q[:30], rng, 0.02)
    laden = positions_at(heavy, theta, q[30:], rng, 0.02)
    laden = replace(laden, ids=tuple(f"h{i}" for i in range(30)))
    stated = [replace(light, payload=np.full(30, np.nan)), replace(laden, payload=np.full(30, 12.0))]

    def off(tables):
        found = calibrate(cell, *tables, folds=0, errors="cell")
        r = measurement_model(cell.robot).residual(found.theta, rows(cell.wire, stated, cell.robot))
        return np.sqrt(np.mean(r**2))

    assert off(stated) < 0.023
    assert off([light, laden]) > 0.1  # [mm]: without the column, one robot cannot be both


def test_twice_the_payload_bends_a_joint_of_unknown_weights_twice_as_far(rng):
    robot = replace(robot_with(("compliance",)), payload=(3.0, (10.0, 0.0, 80.0)))
    q = postures(robot, rng, 5)
    once, twice = (robot.theta(BASE, TOOL) for _ in range(2))
    for theta, size in ((once, 1.0), (twice, 2.0)):
        theta[robot.parameters.index("j2.load")] = size * SIZES["sag_deg_m"].usual * SIZES["sag_deg_m"].inside
    heavy = replace(tip_rows(q), conditions=np.hstack([np.zeros((15, 7)), np.ones((15, 1))]))
    model = measurement_model(robot)

    np.testing.assert_allclose(model.residual(once, heavy), model.residual(twice, tip_rows(q)), atol=1e-9)
    assert np.abs(model.residual(once, heavy) - model.residual(once, tip_rows(q))).max() > 0.1


def test_a_cell_asks_for_error_models_and_travels_with_them(tmp_path):
    text = library("cells")["arc-welder"].read_text()
    more = "errors: [compliance, thermal]\npayload: {mass_kg: 4, centre_mm: [0, 10, 50]}\n"
    more += "temperature_c: 25\nup: [0, 0, -1]\n"
    (tmp_path / "cell.yaml").write_text(text + more)

    cell = read_cell(tmp_path / "cell.yaml")
    again = cell_from_entry(cell_entry(cell), {})

    for robot in (cell.robot, again.robot):
        assert robot.errors == ("compliance", "thermal")
        assert robot.payload == (4.0, (0.0, 10.0, 50.0))
        assert robot.temperature == 25
        assert robot.up == (0, 0, -1)
    np.testing.assert_allclose(again.theta, cell.theta)
    np.testing.assert_allclose(again.prior, cell.prior)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("errors: [harmonic]", "did you mean 'harmonics'"),
        ("errors: [gears, compliance]", "did you mean 'gear'"),
        ("priors: {errors: {harmonic_deg: 0.1}}", "did you mean 'harmonics_deg'"),
    ],
)
def test_an_unknown_error_model_is_answered_with_the_nearest(line, says, tmp_path):
    text = "\n".join(t for t in library("cells")["arc-welder"].read_text().splitlines() if not t.startswith("priors"))
    (tmp_path / "cell.yaml").write_text(f"{text}\n{line}\n")

    with pytest.raises(InputError, match=says):
        read_cell(tmp_path / "cell.yaml")


def test_values_in_a_robot_file_are_the_nominal_errors(tmp_path):
    text = library("robots")["irb120"].read_text() + "errors: [gear]\nerror_values: {j2.gear: 0.0002}\n"
    (tmp_path / "robot.yaml").write_text(text)

    robot = read_robot(tmp_path / "robot.yaml")

    assert robot.theta(BASE, TOOL)[robot.parameters.index("j2.gear")] == 0.0002
    (tmp_path / "robot.yaml").write_text(text.replace("j2.gear", "j2.ger"))
    with pytest.raises(InputError, match=r"no error parameter 'j2.ger'.*j2.gear"):
        read_robot(tmp_path / "robot.yaml")


def test_weights_turn_the_first_joint_of_a_robot_on_a_wall():
    on_wall = replace(robot_with(("compliance",)), up=(1.0, 0.0, 0.0))

    assert "j1.load" in on_wall.parameters
    assert "j1.load" not in robot_with(("compliance",)).parameters


def test_a_plan_counts_the_side_from_which_each_joint_comes(arc_welder, rng):
    from identify.uncertainty.unknowns import Unknowns

    unknowns = Unknowns.of(replace(arc_welder, robot=replace(arc_welder.robot, errors=("backlash",))))
    q = postures(unknowns.cell.robot, rng, 40)
    z, normal, ids = np.zeros(40), np.tile([0.0, 0, 1], (40, 1)), tuple(map(str, range(40)))
    sides = 0.1 * rng.choice([-1.0, 1.0], q.shape)

    rows, turned = (
        unknowns.rows(Rows(q, normal, z, z, z + 1, ids, np.arange(40), touch_conditions(q, q - side)))
        for side in (sides, -sides)
    )

    j2 = unknowns.names.index("j2.backlash")
    np.testing.assert_allclose(rows[:, j2], -turned[:, j2], atol=1e-9)
    assert np.abs(rows[:, j2]).max() > 0.01


def test_planning_after_a_calibration_takes_over_the_errors_that_it_found(arc_welder):
    from identified import identified

    from oed.planning.candidate_set import _placed

    bending = replace(arc_welder, robot=replace(arc_welder.robot, errors=("compliance",)))

    cell = _placed(arc_welder, identified(bending, bending.theta))

    assert cell.robot.parameters == bending.robot.parameters


@pytest.mark.parametrize("errors", CHOICES.values(), ids=CHOICES)
def test_the_tip_is_where_touches_of_unknown_conditions_say(errors, rng):
    robot = robot_with(errors)
    theta, q = some(robot, rng), postures(robot, rng, 20)

    tip = Kinematics(robot).tip(q, theta)[0]

    assert np.abs(measurement_model(robot).residual(theta, tip_rows(q)).reshape(-1, 3) - tip).max() < 1e-9  # [mm]


def test_a_calibration_with_many_joint_errors_is_read_as_it_was_written(tmp_path, rng):
    from identify.model.io.calibration_file import read_calibration, write_calibration

    cell = replace(cell_of("irb120"), robot=robot_with(tuple(ERROR_MODELS)))
    q = postures(cell.robot, rng, 60)
    found = calibrate(cell, positions_at(cell, cell.theta, q, rng, 0.02), folds=0, errors="cell")

    write_calibration(tmp_path / "calibration.json", found)

    again = read_calibration(tmp_path / "calibration.json")
    np.testing.assert_allclose(again.theta, found.theta, rtol=1e-9)
    np.testing.assert_allclose(again.sigma, found.sigma, rtol=1e-6)


def test_an_own_error_parameter_of_an_unknown_size_is_named_with_the_sizes_there_are(arc_welder, monkeypatch):
    monkeypatch.setitem(ERROR_MODELS, "own", lambda arm: [Term("j2.own", "gear_deg", {("joint", 1): arm.q[1]})])

    with pytest.raises(ValueError, match=r"joint error 'j2.own': size 'gear_deg', expected one of harmonics_deg"):
        _ = replace(arc_welder.robot, errors=("own",)).parameters
