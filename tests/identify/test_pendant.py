import numpy as np
import pytest

from identify.model.files import InputError
from identify.model.frames import euler, rotation, transform
from identify.model.io.tables import POINT, joint_columns
from identify.pendant import EULER, Pendant, compare, read_pendant


@pytest.fixture
def q(arc_welder, rng):
    return rng.uniform(0.5 * arc_welder.robot.lower, 0.5 * arc_welder.robot.upper, (6, 6))


def pose(cell, q, flange=False):
    """Places and rotations in the base frame, as a controller with this model would know them."""
    p, R = cell.kinematics.flange(q, cell.theta)
    if flange:
        return p, R
    tool = transform(cell.tool)
    return p + R @ tool[:3, 3], R @ tool[:3, :3]


def shown(joints, p, R):
    rz, ry, rx = euler(R).T
    return Pendant(tuple("abcdef"), joints, p, np.column_stack([rx, ry, rz]))


def only(found):
    assert not found.agrees
    assert found.explained
    return [cause.name for cause in found.causes]


def test_a_pendant_that_means_the_same_agrees(arc_welder, q):
    assert compare(arc_welder, shown(q, *pose(arc_welder, q))).agrees


@pytest.mark.parametrize("joint", range(6))
def test_an_axis_that_points_the_other_way_is_named(joint, arc_welder, q):
    signs = np.ones(6)
    signs[joint] = -1

    found = compare(arc_welder, shown(q * signs, *pose(arc_welder, q)))

    assert only(found) == [f"the axis of j{joint + 1} points the other way"]


def test_a_joint_3_that_is_coupled_to_joint_2_is_named(arc_welder, q):
    displayed = q.copy()
    displayed[:, 2] += q[:, 1]

    found = compare(arc_welder, shown(displayed, *pose(arc_welder, q)))

    assert only(found) == ["j3 is coupled to j2: the model's is the pendant's - j2"]


def test_a_zero_a_right_angle_off_is_named(arc_welder, q):
    displayed = q.copy()
    displayed[:, 1] -= np.pi / 2

    found = compare(arc_welder, shown(displayed, *pose(arc_welder, q)))

    assert only(found) == ["the zero of j2 is +90 degrees off"]


def test_lengths_in_metres_are_named(arc_welder, q):
    p, R = pose(arc_welder, q)

    assert only(compare(arc_welder, shown(q, p / 1000, R))) == ["the pendant's lengths are metres"]


def test_the_flange_in_place_of_the_tip_is_named(arc_welder, q):
    found = compare(arc_welder, shown(q, *pose(arc_welder, q, flange=True)))

    assert only(found) == ["the pendant shows the flange, not the wire tip"]


def test_a_base_height_is_named_with_its_size(arc_welder, q):
    p, R = pose(arc_welder, q)

    found = compare(arc_welder, shown(q, p + np.array([0, 0, 430]), R))

    assert only(found) == ["the pendant's origin lies (+0.0, +0.0, +430.0) mm from the model's base"]


def test_another_order_of_the_angles_is_named(arc_welder, q):
    p, R = pose(arc_welder, q)
    # R = Rx(w) Ry(p) Rz(r): the transpose of Rz(-r) Ry(-p) Rx(-w)
    rz, ry, rx = euler(R.transpose(0, 2, 1)).T
    angles = np.column_stack([-rx, -ry, -rz])
    zero = np.zeros(6)
    made = rotation(zero, zero, angles[:, 0]) @ rotation(zero, angles[:, 1], zero) @ rotation(angles[:, 2], zero, zero)
    np.testing.assert_allclose(made, R, atol=1e-12)

    found = compare(arc_welder, Pendant(tuple("abcdef"), q, p, angles))

    assert only(found) == ["the angles are meant as Rx Ry Rz, not Rz Ry Rx"]


def test_two_causes_at_once_are_both_named(arc_welder, q):
    p, R = pose(arc_welder, q)
    displayed = q * [1, 1, 1, 1, -1, 1]

    found = compare(arc_welder, shown(displayed, p + np.array([0, 0, 430]), R))

    assert len(only(found)) == 2


def test_what_no_usual_cause_explains_is_not_explained(arc_welder, q, rng):
    p, R = pose(arc_welder, q)

    found = compare(arc_welder, shown(q, p + rng.normal(0, 50, p.shape), R))

    assert not found.agrees
    assert not found.explained


def test_two_poses_are_too_few(arc_welder, tmp_path):
    header = ["id", *joint_columns(arc_welder.robot), *POINT, *EULER]
    rows = [[f"p{i}", *["10"] * (len(header) - 1)] for i in range(2)]
    path = tmp_path / "pendant.csv"
    path.write_text("\n".join(",".join(row) for row in [header, *rows]) + "\n")

    with pytest.raises(InputError, match="2 poses tell too little"):
        read_pendant(path, arc_welder)
