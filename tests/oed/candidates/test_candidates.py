"""Every candidate is judged again, by forward kinematics written independently and by dense sampling."""

from dataclasses import replace

import numpy as np
import pytest
from cells import PLACES, cell_of
from drawings import balls
from oracle import error_propagation, forward

from identify.model.cell import DEG, Wire
from identify.model.files import InputError
from identify.model.jig import Box, Face, Jig
from identify.model.measurement import MeasurementModel
from oed.candidates.candidates import COLUMNS, candidates
from oed.candidates.edge_margins import EDGE, SHARE, margins, warnings
from oed.candidates.feasibility import BRINK, Feasibility, Infeasibility
from oed.candidates.ik_branches import Branches, Poses, distinct
from oed.candidates.targets import spread, structured, targets
from probe.motion.clearance import MARGIN, NEAR, Clearance
from probe.motion.obstacles import obstacles, owners

MICROMETRE = 1e-3
FOUND = {}


def found(robot):
    """Candidates of a robot of the library, made once."""
    if robot not in FOUND:
        cell = cell_of(robot)
        FOUND[robot] = cell, candidates(cell, np.random.default_rng(7), 1000)
    return FOUND[robot]


def sample(robot, n):
    cell, all_found = found(robot)
    return cell, all_found.take(np.random.default_rng(8).choice(len(all_found), n, replace=False))


def tips(cell, q):
    T = np.stack([forward(cell.robot, row, cell.theta) for row in q])
    return T[:, :3, 3], T[:, :3, :3]


@pytest.mark.parametrize("robot", PLACES)
def test_contacts_lie_on_their_faces(robot):
    cell, some = sample(robot, 60)

    tip, R = tips(cell, some.q)

    faces = [cell.jig.by_name[name] for name in some.names()]
    height = np.array([f.normal @ (p - f.origin) for f, p in zip(faces, tip, strict=True)])
    lean = np.array([np.arccos(min(1.0, -f.normal @ r[:, 2])) for f, r in zip(faces, R, strict=True)])
    np.testing.assert_allclose(height, cell.wire.radius * np.sin(lean), atol=MICROMETRE)
    np.testing.assert_allclose(some.tilt, lean, atol=1e-6)
    np.testing.assert_allclose(tip - height[:, None] * some.normal, some.point, atol=MICROMETRE)
    for face, point, i in zip(faces, some.point, some.face, strict=True):
        inside = face.fractions(point) * face.size
        assert (inside >= some.margins.inset[i] - MICROMETRE).all()
        assert (inside <= face.size - some.margins.inset[i] + MICROMETRE).all()


@pytest.mark.parametrize("robot", PLACES)
def test_joints_and_wire_stay_within_their_limits(robot):
    cell, all_found = found(robot)

    for q in (all_found.q, all_found.approach):
        assert (q >= cell.robot.lower - 1e-9).all()
        assert (q <= cell.robot.upper + 1e-9).all()
    assert all_found.tilt.max() <= cell.touch.max_tilt
    assert all_found.tilt.max() > cell.touch.max_tilt - 1e-5 or robot == "scara"  # which leans as it is built


@pytest.mark.parametrize("robot", PLACES)
def test_approaches_hold_the_wire_off_the_face_as_it_will_stand(robot):
    cell, some = sample(robot, 60)

    tip, R = tips(cell, some.q)
    above, R_above = tips(cell, some.approach)

    np.testing.assert_allclose(above - tip, cell.touch.approach * some.normal, atol=MICROMETRE)
    if len(cell.robot.joints) >= 6:
        np.testing.assert_allclose(R_above, R, atol=1e-5)


@pytest.mark.parametrize("robot", PLACES)
def test_the_whole_search_stays_over_the_face_and_within_the_limits(robot):
    cell, some = sample(robot, 15)
    faces = [cell.jig.by_name[name] for name in some.names()]

    for i, face in enumerate(faces):
        beyond = 1 + some.margins.overtravel[some.face[i]] / cell.touch.approach
        line = some.approach[i] + np.linspace(0, beyond, 25)[:, None] * (some.q[i] - some.approach[i])

        tip, _ = tips(cell, line)

        inside = face.fractions(tip) * face.size
        assert (inside >= BRINK - 0.5).all()  # [mm]; between the five places looked at, the path bends by less
        assert (inside <= face.size - BRINK + 0.5).all()
        assert (np.diff(tip @ face.normal) < 0).all()
        assert (line >= cell.robot.lower - 1e-9).all()
        assert (line <= cell.robot.upper + 1e-9).all()


@pytest.mark.parametrize("robot", PLACES)
def test_arm_and_torch_keep_clear_all_the_way(robot):
    cell, some = sample(robot, 6)
    clearance = Clearance(cell, cell.theta)
    own = owners(cell.jig, obstacles(cell.jig))
    boxes = [(np.array(b.lower), np.array(b.upper)) for b in cell.jig.boxes]

    for i in range(len(some)):
        for share in np.linspace(0, 1, 5):
            q = some.approach[i] + share * (some.q[i] - some.approach[i])
            along = balls(cell, clearance.capsules, q, 80)
            least = MARGIN if share in (0, 0.5, 1) else 0.0  # in between it moves by less than the margin
            for p, capsule in zip(along, clearance.capsules, strict=True):
                for k, (lo, hi) in enumerate(boxes if capsule.link else []):
                    gap = np.linalg.norm(np.maximum(np.maximum(lo - p, p - hi), 0), axis=1).min() - capsule.radius
                    torch = capsule.link == len(cell.robot.joints)
                    assert gap >= (NEAR if torch and own[some.face[i], k] else least) - 1e-6
            for a, b in clearance.pairs:
                between = np.linalg.norm(along[a][:, None] - along[b], axis=2).min()
                assert between - clearance.capsules[a].radius - clearance.capsules[b].radius >= least - 1e-6


@pytest.mark.parametrize("robot", PLACES)
def test_nothing_but_the_tip_of_the_wire_meets_the_jig(robot):
    cell, some = sample(robot, 40)
    boxes = [(np.array(b.lower), np.array(b.upper)) for b in cell.jig.boxes]

    for q, least in ((some.q, 6.0), ((some.q + some.approach) / 2, 0.0), (some.approach, 0.0)):
        tip, R = tips(cell, q)
        wire = tip - np.linspace(least, 18, 30)[:, None, None] * R[:, :, 2]

        for lo, hi in boxes:
            assert np.linalg.norm(np.maximum(np.maximum(lo - wire, wire - hi), 0), axis=2).min() > 1.0


def test_all_branches_are_found_that_many_random_starts_find(rng):
    cell = cell_of("arc-welder")
    asked = spread(cell, np.full((11, 2), 0.2), 60, rng)
    poses = Poses(asked.tip(cell), asked.rotation, asked.face)
    around = spread(cell, np.full((11, 2), 0.1), 3000, rng)
    branches = Branches(cell, cell.theta, Poses(around.tip(cell), around.rotation, around.face), rng)

    solved = branches.solve(poses)

    many = branches._solved(
        poses, np.repeat(np.arange(60), 100), rng.uniform(cell.robot.lower, cell.robot.upper, (6000, 6)), 60
    ).within(cell.robot)
    assert len(many.pose) > 60
    assert len(solved.pose) >= 0.85 * len(many.pose)
    tip, R = tips(cell, solved.q)
    np.testing.assert_allclose(tip, poses.position[solved.pose], atol=MICROMETRE)
    np.testing.assert_allclose(R, poses.rotation[solved.pose], atol=1e-5)


def test_solutions_that_differ_by_whole_turns_are_one():
    robot = cell_of("puma560").robot
    q = np.array([[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]] * 4)
    q[1, 3] += 2 * np.pi
    q[2, 3] += 0.01

    kept = distinct(robot, np.array([4, 4, 4, 5]), q)

    assert len(kept) == 3
    assert set(q[kept, 3].round(6) % round(2 * np.pi, 6)) == {0.4, 0.41}


def test_the_same_seed_gives_the_same_candidates():
    cell, other = found("arc-welder")

    first, second = (candidates(cell, np.random.default_rng(1), 300) for _ in range(2))

    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert 200 < len(first) == len(second) <= 300  # the surest of 300
    assert not np.array_equal(first.q, other.q[:300])


def test_rows_are_the_equations_of_the_touches():
    cell, all_found = found("arc-welder")

    r, J = MeasurementModel(cell.robot).linearize(cell.theta, all_found.rows(cell))

    np.testing.assert_allclose(r, 0, atol=MICROMETRE)
    assert J.shape == (len(all_found), 42)
    np.testing.assert_allclose(all_found.rows(cell).sigma, 0.05)


@pytest.mark.parametrize("shape", ["point", "ball", "flat"])
def test_every_shape_of_the_wire_meets_the_face(shape):
    cell = replace(cell_of("arc-welder"), wire=Wire(1.5, shape))

    some = candidates(cell, np.random.default_rng(3), 200)

    r, _ = MeasurementModel(cell.robot).linearize(cell.theta, some.rows(cell))
    np.testing.assert_allclose(r, 0, atol=MICROMETRE)


def test_most_candidates_are_corners_with_the_wire_at_its_limit():
    cell, all_found = found("arc-welder")

    size = np.stack([f.size for f in cell.jig.faces])[all_found.face]
    place = size * [cell.jig.faces[i].fractions(p) for i, p in zip(all_found.face, all_found.point, strict=True)]

    edge = (
        np.minimum(
            np.abs(place - all_found.margins.inset[all_found.face]),
            np.abs(size - place - all_found.margins.inset[all_found.face]),
        )
        < 1e-3
    )
    assert (edge.all(axis=1) & (all_found.tilt > cell.touch.max_tilt - 1e-5)).mean() > 0.3
    even = candidates(cell, np.random.default_rng(7), 1000, structured=0.0)
    assert (even.tilt < 0.95 * cell.touch.max_tilt).mean() > 0.5


def test_what_is_known_of_the_robot_sets_the_distance_from_the_edges():
    cell = cell_of("arc-welder")
    P = len(cell.robot.parameters)
    shift = np.zeros((P, P))
    shift[0, 0] = 4.0  # base.x, and nothing else, is uncertain by 4 mm

    known = candidates(cell, np.random.default_rng(3), 500, root=shift)

    faces = [f.name for f in cell.jig.faces]
    top, front = faces.index("top-low"), faces.index("front-low")  # u of the top is x, v of the front
    np.testing.assert_allclose(known.margins.inset[top], [10.0, EDGE], atol=1e-9)
    np.testing.assert_allclose(known.margins.inset[front], [EDGE, 10.0], atol=1e-9)
    right = faces.index("right-low")
    assert known.margins.overtravel[right] == pytest.approx(10.0)
    assert known.margins.overtravel[top] == pytest.approx(EDGE)
    assert not [note for note in known.notes if "off (" in note]


def test_deviations_follow_from_the_closed_form_of_the_paper(rng):
    cell, all_found = found("arc-welder")
    A = rng.normal(size=(42, 42)) * cell.scale[:, None] / 20
    one = np.flatnonzero(all_found.face == 3)[:1]

    kept = margins(cell, A, cell.theta, all_found.face[one], all_found.q[one])

    J = error_propagation(cell.robot, all_found.q[one[0]], cell.theta)
    face = cell.jig.faces[3]
    axes = np.stack([face.u / face.size[0], face.v / face.size[1], face.normal])
    expected = np.sqrt(np.diag(axes @ J @ A @ A.T @ J.T @ axes.T))
    np.testing.assert_allclose(kept.deviation[3], expected, rtol=1e-8)
    assert np.isnan(kept.deviation[[0, 1, 2, 4]]).all()


def test_uncertainty_never_takes_the_middle_of_a_face():
    cell, all_found = found("arc-welder")

    half = np.stack([f.size for f in cell.jig.faces]) / 2

    assert (all_found.margins.inset <= SHARE * half + 1e-9).all()
    assert any("the tip may be up to" in note and "from the edges of" in note for note in all_found.notes)


def test_a_better_model_places_the_touches_by_itself(rng):
    cell = cell_of("arc-welder")
    theta = cell.theta + rng.normal(size=42) * np.where(cell.robot.angular, 0.01, 3.0)

    some = candidates(cell, np.random.default_rng(3), 200, theta=theta)

    r, _ = MeasurementModel(cell.robot).linearize(theta, some.rows(cell))
    np.testing.assert_allclose(r, 0, atol=MICROMETRE)
    off, _ = MeasurementModel(cell.robot).linearize(cell.theta, some.rows(cell))
    assert np.abs(off).mean() > 1


def test_a_touch_that_cannot_be_made_is_refused_for_its_reason():
    cell, some = sample("arc-welder", 200)
    feasibility = Feasibility(cell, cell.theta, some.margins)
    same = some.face, some.q, some.approach

    assert (feasibility.check(*same) == Infeasibility.NONE).all()
    tilted = replace(cell, touch=replace(cell.touch, max_tilt=np.median(some.tilt) - 1e-3))
    assert (Feasibility(tilted, cell.theta, some.margins).check(*same) == Infeasibility.TILT).mean() >= 0.5
    limits = [replace(j, upper=float(np.median(some.q[:, i]))) for i, j in enumerate(cell.robot.joints)]
    narrow = replace(cell, robot=replace(cell.robot, joints=(limits[0], *cell.robot.joints[1:])))
    assert (Feasibility(narrow, cell.theta, some.margins).check(*same) == Infeasibility.LIMITS).sum() == 100
    wide = replace(some.margins, overtravel=np.full(11, 1e4))
    assert (Feasibility(cell, cell.theta, wide).check(*same) == Infeasibility.SEARCH).mean() > 0.9
    assert Infeasibility.JIG in Feasibility(cell, cell.theta, some.margins, margin=25.0).check(*same)
    elsewhere = (some.face + 1) % 11
    assert (feasibility.check(elsewhere, some.q, some.approach) != Infeasibility.NONE).all()


def test_a_wall_beside_the_face_keeps_the_wire_from_leaning_over_it():
    """A wire that leans away from a wall may touch next to it; one that leans towards it may not."""
    cell = cell_of("arc-welder")
    P = len(cell.robot.parameters)

    some = candidates(cell, np.random.default_rng(3), 2000, root=np.zeros((P, P)), margin=5.0)

    faces = [f.name for f in cell.jig.faces]
    beside = (some.face == faces.index("top-low")) & (some.point[:, 1] < 154) & (some.point[:, 0] < 240)
    _, R = cell.kinematics.tip(some.q, cell.theta)
    away = -R[:, 1, 2]  # the torch's side of the wire, along y: the wall stands at y = 150, z from 100 to 200
    assert beside.sum() > 10
    assert away[beside].min() > 0


@pytest.mark.parametrize(
    ("base", "says"),
    [
        ([5000.0, 740, 350, -90 * DEG, 0, 0], r"'top-low' is out of reach: the tip comes no nearer than 3\d\d\d mm"),
        ([340.0, 740, 350, 90 * DEG, 0, 0], "joint limits|degrees off its normal"),
    ],
)
def test_a_jig_that_is_never_reached_is_said_to_be(base, says):
    cell = replace(cell_of("arc-welder"), base=np.array(base))
    joints = [replace(j, lower=-0.5, upper=0.5) if i < 3 else j for i, j in enumerate(cell.robot.joints)]
    cell = replace(cell, robot=replace(cell.robot, joints=tuple(joints)))

    with pytest.raises(InputError, match=says):
        candidates(cell, np.random.default_rng(1), 100)


def test_faces_that_no_touch_reaches_are_named_with_the_reason():
    _, all_found = found("arc-welder")

    notes = " ".join(all_found.notes)

    assert "face 'back-low' is reached only with the wire about 71 degrees off its normal" in notes
    assert all_found.number[[f.name for f in all_found.faces].index("back-low")] == 0


def test_a_face_behind_a_wall_is_refused_for_clearance():
    cell = cell_of("arc-welder")
    wall = Box((0.0, 270.0, 0.0), (400.0, 300.0, 200.0))
    jig = Jig("slot", (cell.jig.by_name["front-low"],), (*cell.jig.boxes, wall))

    with pytest.raises(InputError, match=r"'front-low' cannot be touched: of \d+ postures .* near to the jig"):
        candidates(replace(cell, jig=jig), np.random.default_rng(1), 100)


def test_a_face_without_room_between_its_edges_is_not_touched():
    cell = cell_of("arc-welder")
    strip = Face("strip", np.array([50.0, 150, 100]), np.array([300.0, 0, 0]), np.array([0.0, 5, 0]))
    jig = Jig("thin", (*cell.jig.faces[2:3], strip), cell.jig.boxes)

    all_found = candidates(replace(cell, jig=jig), np.random.default_rng(1), 300)

    assert all_found.number[0] > 100
    assert all_found.number[1] == 0
    assert any("'strip' cannot be touched" in n and "an edge; it is only 5 mm wide" in n for n in all_found.notes)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda c: replace(c, jig=None), "no jig to touch"),
        (lambda c: replace(c, base=None), "base: fit leaves open"),
        (lambda c: replace(c, touch=replace(c.touch, travel=20.0)), "travel_mm: 20 ends before the contact"),
    ],
)
def test_cells_that_cannot_be_planned_get_one_sentence(change, says):
    with pytest.raises(InputError, match=says):
        candidates(change(cell_of("arc-welder")), np.random.default_rng(0))


def test_targets_stand_where_they_are_told(rng):
    cell = cell_of("arc-welder")
    faces, m = cell.jig.faces, 50
    tilt, azimuth = rng.uniform(0, 1.5, m), rng.uniform(-np.pi, np.pi, m)
    face, fraction = rng.integers(len(faces), size=m), rng.random((m, 2))

    made = targets(faces, face, fraction, tilt, azimuth, rng.uniform(-np.pi, np.pi, m))

    np.testing.assert_allclose(
        made.rotation @ made.rotation.transpose(0, 2, 1), np.tile(np.eye(3), (m, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(made.rotation), 1)
    for i, f in enumerate(faces[k] for k in face):
        back = -made.rotation[i, :, 2]
        u, v = f.u / f.size[0], f.v / f.size[1]
        assert [back @ u, back @ v, back @ f.normal] == pytest.approx(
            [np.sin(tilt[i]) * np.cos(azimuth[i]), np.sin(tilt[i]) * np.sin(azimuth[i]), np.cos(tilt[i])]
        )
        np.testing.assert_allclose(f.fractions(made.point[i]), fraction[i], atol=1e-12)
        assert made.point[i] @ f.normal == pytest.approx(f.offset)


def test_spread_targets_fill_every_face_evenly(rng):
    cell = cell_of("arc-welder")

    made = spread(cell, np.full((11, 2), 0.1), 2200, rng)

    assert set(np.bincount(made.face)) == {200}
    for face in range(11):
        place = cell.jig.faces[face].fractions(made.point[made.face == face])
        counts, _, _ = np.histogram2d(*place.T, bins=4, range=[[0.1, 0.9], [0.1, 0.9]])
        assert counts.min() > 3
        assert counts.sum() == 200
    assert made.tilt.max() < cell.touch.max_tilt


def test_structured_targets_ask_for_every_corner_of_every_face(rng):
    cell = cell_of("arc-welder")

    made = structured(cell, np.full((11, 2), 0.25), 5000, rng)

    assert 3500 < len(made) < 6500
    steep = made.tilt > cell.touch.max_tilt - 1e-5
    for face in range(11):
        place = cell.jig.faces[face].fractions(made.point[(made.face == face) & steep]).round(6)
        assert set(map(tuple, place)) == {(x, y) for x in (0.25, 0.5, 0.75) for y in (0.25, 0.5, 0.75)}


def test_warnings_are_about_faces_that_are_touched():
    cell, all_found = found("arc-welder")

    assert warnings(cell, all_found.margins, np.zeros(11, dtype=bool)) == ()
