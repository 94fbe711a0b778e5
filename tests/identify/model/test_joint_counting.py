"""How controllers count joints: outside truths are a drawn linkage and the inverse, files and line hold the counts."""

from dataclasses import replace

import numpy as np
import pytest
from counts import ODD
from hypothesis import given
from hypothesis import strategies as st

from identify.model.files import InputError
from identify.model.io.tables import plan_text, read_plan, read_touches, touches_text
from identify.model.joint_counting import JointCounting, circle
from identify.model.touch import Plan, Touches

FANUC = JointCounting(coupled=((2, 1, 1),))


def test_the_forearm_of_a_fanuc_keeps_its_lean_while_joint_2_turns_alone():
    leans = []
    for j2 in (-30.0, 0.0, 45.0):
        model = FANUC.from_controller(np.array([0.0, j2, 20.0, 0.0, 0.0, 0.0]))
        # upper arm turned forward by joint 2 about +y, forearm raised by joint 3 about -y: lean = j2 - j3
        leans.append(model[1] - model[2])

    assert leans == [-20.0, -20.0, -20.0]


@given(st.lists(st.floats(-180, 180), min_size=6, max_size=6))
def test_counts_survive_the_way_to_the_model_and_back(counts):
    counts = np.array(counts)

    assert np.abs(ODD.to_controller(ODD.from_controller(counts)) - counts).max() < 1e-9


def test_each_joint_is_sign_times_count_with_coupling_less_zero():
    counts = np.array([[10.0, 20.0, 30.0, 40.0, 50.0, 60.0]])

    model = ODD.from_controller(counts)

    np.testing.assert_allclose(model, [[10, -(20 - 90), 30 + 20, 40 + 12.5, -(50 - 40), 60 - 180]])


def test_a_matrix_of_signs_and_couplings_gives_the_counting_back():
    assert JointCounting.of_matrix(*ODD.matrix(6)) == replace(ODD, pulses=())
    assert JointCounting.of_matrix(*JointCounting().matrix(6)) == JointCounting()
    assert JointCounting.of_matrix(np.diag([1.0, 2.0]), np.zeros(2)) is None


def test_couplings_that_lead_back_are_a_circle():
    assert circle([(2, 1, 1), (1, 2, -1)])
    assert circle([(1, 1, 1)])
    assert not circle([(2, 1, 1), (4, 3, 1), (3, 2, 1)])


def test_pulses_are_counts_times_pulses_of_a_degree(counted):
    q = np.radians([[5.0, -6.0, 7.0, 8.0, 9.0, -10.0]])

    np.testing.assert_allclose(counted.robot.to_pulses(q), 100 * counted.robot.to_controller(q))
    np.testing.assert_allclose(counted.robot.from_pulses(counted.robot.to_pulses(q)), q, atol=1e-12)


def test_pulses_that_nobody_stated_are_asked_for(arc_welder):
    with pytest.raises(InputError, match=r"write joints: \{pulses_per_deg"):
        arc_welder.robot.to_pulses(np.zeros(6))


def test_plan_and_touches_hold_the_controllers_numbers(counted, tmp_path, rng):
    q = rng.uniform(-0.5, 0.5, (2, 6))
    plan = Plan(("a", "b"), ("f1",) * 2, np.zeros((2, 3)), np.tile([0.0, 0, 1], (2, 1)), q, q + 0.1, q[:, None] - 0.1)
    faces = tuple(counted.jig.by_name)[:1] * 2
    plan = replace(plan, face=faces)
    path = tmp_path / "plan.csv"
    path.write_text(plan_text(plan, counted.robot))
    header, first = (line.split(",") for line in path.read_text().splitlines()[:2])

    again = read_plan(path, counted)

    for number in range(6):
        shown = float(first[header.index(f"q{number + 1}_deg")])
        assert shown == pytest.approx(ODD.to_controller(np.degrees(q[0]))[number], abs=1e-8)
    for name in ("q", "approach", "via"):
        np.testing.assert_allclose(getattr(again, name), getattr(plan, name), atol=1e-10)
    assert touches_agree(counted, faces, q, tmp_path / "touches.csv")


def touches_agree(cell, faces, q, path):
    none = np.full((2, 3), np.nan)
    touches = Touches(
        ("a", "b"), faces, q, none, none[:, 0], none[:, 0], ("hit",) * 2, none[:, 0], ("",) * 2, ("",) * 2, q + 0.1
    )
    path.write_text(touches_text(touches, cell.robot))
    again = read_touches(path, cell)
    shown = float(path.read_text().splitlines()[1].split(",")[9])
    return (
        shown == pytest.approx(cell.robot.to_controller(q[0])[0], abs=1e-8)
        and np.allclose(again.q, q, atol=1e-10)
        and np.allclose(again.approach, q + 0.1, atol=1e-10)
    )
