"""A workpiece is found where it hides, as surely as is said; touches that cannot tell are named."""

from dataclasses import replace

import numpy as np
import pytest
from identified import identified
from measured import table_2
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from workpieces import SIGMA, SPREAD, hidden, latched, postures, touched, touches_of

import identify
from identify.model.files import InputError
from identify.model.frames import inverse, pose, transform
from identify.model.jig import Jig
from identify.workpiece.localization import locate, move_of

TRIALS, ROBOTS = 500, 5  # each hidden pose is touched by five robots


THREE_TWO_ONE = ["top"] * 3 + ["front"] * 2 + ["right"]


SIX = THREE_TWO_ONE, SPREAD


def error(location, truth):
    """The way [mm] and the rotation vector [rad] from where a workpiece was found to where it is, in its own axes."""
    D = inverse(location.base_T_workpiece) @ truth
    return np.concatenate([D[:3, 3], Rotation.from_matrix(D[:3, :3]).as_rotvec()])


def test_three_two_one_on_a_box_finds_hidden_poses_within_the_intervals(found, box):
    rng = np.random.default_rng(11)
    some = np.array([hidden(found, rng) for _ in range(TRIALS // ROBOTS)])
    point = np.stack([box.by_name[f].point(np.array(s), np.array(t)) for f, (s, t) in zip(*SIX, strict=True)])
    q = postures(found, box, np.repeat(some, 6, axis=0), SIX[0] * len(some), np.tile(point, (len(some), 1)), rng)
    T = np.repeat(some, ROBOTS, axis=0)
    theta = np.tile(found.theta, (TRIALS, 1))  # robots that the calibration leaves possible
    theta[:, found.index] += rng.multivariate_normal(np.zeros(len(found.index)), found.covariance, TRIALS)
    off = 0.02 * rng.standard_normal((TRIALS, 3))  # of the three faces from the drawing
    q = np.repeat(q.reshape(-1, 6, 6), ROBOTS, axis=0).reshape(-1, 6)
    q = latched(
        found,
        box,
        np.repeat(T, 6, axis=0),
        SIX[0] * TRIALS,
        q,
        np.repeat(theta, 6, axis=0),
        rng,
        SIGMA,
        off[:, [0, 0, 0, 1, 1, 2]].ravel(),
    ).reshape(TRIALS, 6, 6)

    locations = [locate(found, box, touches_of(box, THREE_TWO_ONE, each, SIGMA)) for each in q]

    seen = inverse(transform(found.theta[:6])) @ transform(theta[:, :6]) @ T  # where the jig shows the robot to be
    errors = np.array([error(location, truth) for location, truth in zip(locations, seen, strict=True)])
    sigma = np.array([np.sqrt(np.diag(location.covariance)) for location in locations])
    together = [e @ np.linalg.solve(location.covariance, e) for e, location in zip(errors, locations, strict=True)]
    assert 0.925 < (np.array(together) < chi2(6).ppf(0.95)).mean() < 0.975  # 2.5 deviations of 500 trials
    assert ((np.abs(errors) < 1.96 * sigma).mean(axis=0) > 0.925).all()
    assert np.abs(errors[:, :3]).max() < 2.5


@pytest.mark.parametrize(
    ("face", "fraction", "dark"),
    [
        (THREE_TWO_ONE[:5], SPREAD[:5], ["5 touches cannot fix 6 freedoms", "translation along x: no touch"]),
        (["top"] * 3 + ["front"] * 3, SPREAD, ["translation along x: no touch is on a face that looks along x"]),
        (
            THREE_TWO_ONE,
            [*SPREAD[:3], [0.1, 0.5], [0.9, 0.5], [0.5, 0.5]],
            ["rotation about z: no touches are spread along y on faces that look along x, nor along x on faces"],
        ),
        (THREE_TWO_ONE, [[0.1, 0.5], [0.5, 0.5], [0.9, 0.5], *SPREAD[3:]], ["rotation about x: no touches are spread"]),
        (["top"] * 2 + ["front", "right"], SPREAD[:4], ["4 touches cannot", "rotation about"]),
    ],
)
def test_too_few_or_badly_placed_touches_are_named(face, fraction, dark, found, box, rng):
    q = touched(found, box, hidden(found, rng), face, fraction, rng)

    with pytest.raises(InputError) as refused:
        locate(found, box, touches_of(box, face, q, SIGMA))

    assert all(words in str(refused.value) for words in dark)
    assert str(refused.value).endswith("add touches that do")


def test_a_freedom_that_is_seen_is_not_called_unseen(found, box, rng):
    face = ["top"] * 3 + ["front"] * 3
    q = touched(found, box, hidden(found, rng), face, SPREAD, rng)

    with pytest.raises(InputError) as refused:
        locate(found, box, touches_of(box, face, q, SIGMA))

    assert "rotation" not in str(refused.value)
    assert "along y: " not in str(refused.value)


def test_a_touch_on_another_face_than_named_is_told_apart(found, box, rng):
    face = [*THREE_TWO_ONE, "right", "front", "top"]
    q = touched(found, box, hidden(found, rng), face, [*SPREAD, [0.2, 0.5], [0.1, 0.2], [0.8, 0.8]], rng)
    called = [*face[:6], "left", *face[7:]]

    with pytest.raises(InputError, match="without touch t7 on 'left' the others agree; are their faces right"):
        locate(found, box, touches_of(box, called, q, SIGMA))


def test_a_touch_that_is_a_little_off_widens_the_intervals_and_is_named(found, box, rng):
    face = [*THREE_TWO_ONE, "right", "front", "top"]
    q = touched(found, box, hidden(found, rng), face, [*SPREAD, [0.2, 0.5], [0.1, 0.2], [0.8, 0.8]], rng)
    good = touches_of(box, face, q, SIGMA)

    fine, off = (locate(found, box, t) for t in (good, replace(good, offset=good.offset + 1.5 * (np.arange(9) == 4))))

    assert fine.notes == ()
    assert "without touch t5 on 'front' the others agree; intervals are widened by that" in off.notes[0]
    assert (off.sigma > 2 * fine.sigma).all()


def test_six_touches_are_said_to_leave_nothing_to_check_and_seven_are_not(found, box, rng):
    face = [*THREE_TWO_ONE, "left"]
    q = touched(found, box, hidden(found, rng), face, [*SPREAD, [0.5, 0.5]], rng)

    six, seven = (locate(found, box, touches_of(box, face[:k], q[:k], SIGMA)) for k in (6, 7))

    assert ("nothing to check" in " ".join(six.notes), seven.notes) == (True, ())
    assert (six.degrees, six.chance, seven.degrees) == (0, 1.0, 1)


def test_a_robot_known_less_well_locates_less_well(found, box, rng):
    truth = hidden(found, rng)
    q = touched(found, box, truth, THREE_TWO_ONE, SPREAD, rng)
    touches = touches_of(box, THREE_TWO_ONE, q, SIGMA)

    well, badly = (locate(c, box, touches) for c in (found, replace(found, covariance=9 * found.covariance)))

    assert (badly.sigma > 1.2 * well.sigma).all()
    assert (np.abs(error(badly, truth)) < 4 * np.sqrt(np.diag(badly.covariance))).all()


def test_a_pose_nearby_leads_to_the_same_answer_as_starting_from_everywhere(found, box, rng):
    truth = hidden(found, rng)
    q = touched(found, box, truth, THREE_TWO_ONE, SPREAD, rng)
    touches = touches_of(box, THREE_TWO_ONE, q, SIGMA)
    location = locate(found, box, touches)

    near = locate(found, box, touches, near=location.pose + np.array([40, -30, 20, 0.3, -0.2, 0.2]))

    assert near.base_T_workpiece == pytest.approx(location.base_T_workpiece, abs=1e-5)


def test_where_two_poses_fit_both_are_named_and_a_pose_nearby_decides(arc_welder, box):
    known, rng = identified(arc_welder, table_2(arc_welder)), np.random.default_rng(32)
    large = [replace(f, origin=f.origin - 2 * f.u - 2 * f.v, u=5 * f.u, v=5 * f.v) for f in box.faces]  # no edge helps
    plates, truth = Jig("plates", tuple(large)), hidden(known, rng)
    face = ["top", "top", "front", "front", "right", "right"]
    q = touched(known, plates, truth, face, rng.uniform(0.42, 0.58, (6, 2)).tolist(), rng)
    touches = touches_of(plates, face, q, SIGMA)

    with pytest.raises(InputError, match=r"two poses of the workpiece explain the touches: .*, or say with --near"):
        locate(known, plates, touches)

    location = locate(known, plates, touches, near=pose(truth) + np.array([5, -5, 5, 0.03, -0.02, 0.02]))
    assert (np.abs(error(location, truth)) < 4 * np.sqrt(np.diag(location.covariance))).all()


def test_the_sigma_of_a_point_is_that_of_moves_drawn_from_the_covariance(found, box, rng):
    q = touched(found, box, hidden(found, rng), THREE_TWO_ONE, SPREAD, rng)
    location = locate(found, box, touches_of(box, THREE_TWO_ONE, q, SIGMA))
    point = box.corners[:4]

    moves = rng.multivariate_normal(np.zeros(6), location.covariance, 4000)
    moved = np.einsum("pik,dk->pdi", move_of(point), moves)

    assert location.point_sigma(point) == pytest.approx(np.sqrt((moved**2).sum(axis=2).mean(axis=1)), rel=0.05)


def test_the_front_page_names_it():
    assert identify.locate is locate


def test_no_touches_are_refused(arc_welder, box):
    with pytest.raises(InputError, match="there is no touch of status hit"):
        locate(
            identified(arc_welder, arc_welder.theta), box, touches_of(box, ["top"], np.zeros((1, 6)), SIGMA).take([])
        )
