"""Planned touches locate a workpiece: six do, as well as the classic three, two, one; more do better."""

import json
from dataclasses import replace

import numpy as np
import pytest
from identified import identified
from measured import poses_over_jig, table_2, touches_at

from identify.estimation.calibrate import calibrate
from identify.estimation.selection import with_errors
from identify.model.files import InputError
from identify.model.frames import inverse, pose, transform
from identify.model.io.calibration_file import write_calibration
from identify.model.io.description import library, read_cell
from identify.model.joint_error_models import ERROR_MODELS
from identify.model.touch import HIT
from identify.workpiece.localization import locate
from oed.planning.candidate_set import around
from oed.planning.workpiece import corner_rows, plan_workpiece, with_workpiece, workpiece_prior
from probe.virtual.batch import touch_batch
from probe.virtual.truth import Truth

COUNT = 2500
KNOWN = ("--after", "calibration.json")
AWAY = np.array([3, -2, 2, 0.005, -0.003, 0.004])  # [mm, rad] from where the workpiece is thought to stand


@pytest.fixture(scope="module")
def plans(arc_welder, box, found):
    return {n: plan_workpiece(arc_welder, box, n, after=found, count=COUNT) for n in (6, 12)}


def test_the_best_six_touches_lie_on_faces_that_look_three_ways_three_on_one_at_the_most(plans, box):
    normals = np.stack([box.by_name[name].normal for name in plans[6].faces])

    assert np.linalg.matrix_rank(normals) == 3
    assert max(plans[6].faces.values()) <= 3  # three, two, one, or two on each
    assert [sum(plans[n].faces.values()) for n in (6, 12)] == [len(plans[n].plan) for n in (6, 12)] == [6, 12]


def test_the_best_six_touches_are_no_worse_than_any_three_two_and_one_on_offer(arc_welder, box, found, plans):
    offered = around(workpiece_prior(plans[6].cell, found), np.random.default_rng(0), COUNT)
    rng, corners, face = np.random.default_rng(1), corner_rows(offered.prior, found), offered.candidates.names()

    classic = [
        np.concatenate([rng.choice(np.flatnonzero(np.array(face) == some[k]), 3 - k, replace=False) for k in range(3)])
        for some in (["top", "front", "right"], ["front", "top", "left"], ["right", "top", "front"]) * 20
    ]

    errors = [offered.promise_of(corners, offered.candidates.take(index)).rms_mm for index in classic]
    assert plans[6].promise.rms_mm <= min(errors)


def test_more_touches_promise_more(plans):
    errors = [error for _, _, error in plans[12].curve]

    assert [n for n, _, _ in plans[12].curve][:1] == [6]
    assert errors == sorted(errors, reverse=True)
    assert plans[12].promise.p95_mm < plans[6].promise.p95_mm


@pytest.mark.parametrize("n", [6, 12])
def test_what_is_promised_of_the_corners_is_what_locating_says_and_what_a_hidden_pose_shows(n, plans, found, box):
    planned, rng = plans[n], np.random.default_rng(2)
    truth = table_2(planned.cell)
    truth[:6] = planned.cell.base + AWAY

    touches = touch_batch(planned.cell, Truth(truth), planned.plan, rng)
    location = locate(found, box, touches)

    hidden = inverse(transform(truth[:6]))
    corners = np.column_stack([box.corners, np.ones(len(box.corners))])
    off = np.linalg.norm((corners @ (location.base_T_workpiece - hidden).T)[:, :3], axis=1)
    assert touches.status == (HIT,) * n
    assert np.sqrt((location.point_sigma(box.corners) ** 2).mean()) == pytest.approx(planned.promise.rms_mm, rel=0.3)
    assert off.max() < 4 * planned.promise.p95_mm


def test_touches_that_agree_are_said_to_disagree_as_rarely_as_stated(plans, arc_welder, box):
    planned, truth, chances = plans[12], table_2(arc_welder), []
    for seed in range(12):  # robots identified anew: the touches of one plan share what one calibration has wrong
        rng = np.random.default_rng([seed, 5])
        measured = touches_at(arc_welder, truth, poses_over_jig(arc_welder, 100, rng), rng)
        known = calibrate(arc_welder, measured, folds=0, parameters="identifiable", errors="cell")
        hidden = np.concatenate([planned.cell.base + AWAY, truth[6:]])
        chances.append(locate(known, box, touch_batch(planned.cell, Truth(hidden), planned.plan, rng)).chance)

    assert min(chances) > 0.001
    assert np.mean(np.array(chances) < 0.05) < 0.25


def test_a_workpiece_is_planned_for_where_it_is_said_to_stand(arc_welder, box):
    at = np.array([800.0, -300.0, -340.0, 1.5, 0.0, 0.0])

    cell = with_workpiece(arc_welder, box, at)

    assert inverse(transform(cell.base)) == pytest.approx(transform(at))
    assert (cell.jig, cell.zone) == (box, None)


def test_fewer_touches_than_freedoms_are_refused(arc_welder, box):
    with pytest.raises(InputError, match="5 touches cannot locate a workpiece, which has 6 freedoms; plan at least 6"):
        plan_workpiece(arc_welder, box, 5)


@pytest.fixture
def folder(arc_welder, found, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cell.yaml").write_text(library("cells")["arc-welder"].read_text())
    (tmp_path / "box.yaml").write_text(library("jigs")["cube"].read_text())
    write_calibration(tmp_path / "calibration.json", found)
    return tmp_path


def test_from_plan_over_the_virtual_robot_to_the_pose(folder, found, touchcal):
    code, out, _ = touchcal("plan", "--workpiece", "box.yaml", *KNOWN, "-n", "9", "-o", "plan.csv")
    assert code == 0
    assert "minimal:   6 touches" in out
    cell = read_cell(folder / "plan-cell.yaml")
    hidden = cell.base + AWAY
    names = cell.robot.parameters
    values = {name: table_2(cell)[i] / cell.robot.parameter_unit()[i] for i, name in enumerate(names)}
    values |= dict(zip(names[:6], hidden / [1, 1, 1, *[np.pi / 180] * 3], strict=True))
    (folder / "truth.yaml").write_text(json.dumps({"parameters": {k: float(v) for k, v in values.items()}}))

    done = touchcal("run", "plan.csv", "--cell", "plan-cell.yaml", *KNOWN, "--truth", "truth.yaml", "-o", "box.csv")
    assert done[0] == 0
    code, out, _ = touchcal("locate", "calibration.json", "box.csv", "--workpiece", "box.yaml", "-o", "box.json")

    assert code == 0
    told = json.loads((folder / "box.json").read_text())
    off = [told["base_T_workpiece"][k] for k in ("x_mm", "y_mm", "z_mm")] - pose(inverse(transform(hidden)))[:3]
    assert (np.abs(off) < 4 * np.array([told["sigma"][k] for k in ("x_mm", "y_mm", "z_mm")])).all()
    assert set(told["inputs"]) == {"calibration.json", "box.csv", "box.yaml"}
    assert "wrote box.json; programs on it: --frame" in out
    assert f"{told['base_T_workpiece']['x_mm']:.3f}" in out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["locate", "calibration.json", "--workpiece", "box.yaml"], "nothing to locate the workpiece by"),
        (["locate", "calibration.json", "none.csv", "--workpiece", "box.yaml"], "none.csv: no such file"),
        (["locate", "calibration.json", "few.csv", "--workpiece", "box.yaml"], "2 touches cannot fix 6 freedoms"),
        (["locate", "calibration.json", "other.csv", "--workpiece", "box.yaml"], "jig 'cube' has no face 'topp'"),
        (["locate", "calibration.json", "points.csv", "--workpiece", "box.yaml"], "positions in the jig frame are no"),
        (
            ["locate", "calibration.json", "few.csv", "--workpiece", "library:cub"],
            "library has no jig 'cub'; did you mean",
        ),
        (["locate", "calibration.json", "few.csv", "--workpiece", "box.yaml", "--near", "1,2"], "--near is '1,2'"),
        (["plan", "--workpiece", "none.yaml"], "none.yaml: no such file"),
        (["plan", "--workpiece", "box.yaml", "--at", "here"], "--at is 'here', expected 6 numbers"),
    ],
)
def test_bad_input_gets_one_sentence_and_nothing_is_written(arguments, sentence, folder, touchcal):
    joints = ",".join(f"q{i}_deg" for i in range(1, 7))
    (folder / "few.csv").write_text(f"id,face,{joints}\na,top,10,20,30,40,50,60\nb,front,11,22,30,40,50,60\n")
    (folder / "other.csv").write_text(f"id,face,{joints}\na,topp,10,20,30,40,50,60\n")
    (folder / "points.csv").write_text(f"id,{joints},x_mm,y_mm,z_mm\na,10,20,30,40,50,60,100,200,300\n")
    before = sorted(folder.rglob("*"))

    code, out, err = touchcal(*arguments)

    assert (code, out) == (2, "")
    assert sentence in err
    assert sorted(folder.rglob("*")) == before


def test_a_calibration_whose_base_is_open_places_the_workpiece_where_it_found_the_jig(arc_welder, box):
    truth = table_2(arc_welder)

    cell = with_workpiece(replace(arc_welder, base=None), box, None, identified(arc_welder, truth))

    assert cell.base == pytest.approx(truth[:6])


def test_joint_errors_of_the_first_joint_are_no_part_of_where_the_base_was_found(arc_welder, box):
    cell = with_errors(arc_welder, tuple(ERROR_MODELS))
    some = ("base.x", "base.sag3")
    known = identified(cell, cell.theta, estimated=some, covariance=np.diag([1e-4, 1e-12]))

    prior = workpiece_prior(with_workpiece(arc_welder, box, None, known), known)

    assert "calibrated.base.x" in prior.unknowns.names
    assert "calibrated.base.sag3" not in prior.unknowns.names
    assert prior.covariance(["base.sag3"]) == pytest.approx(1e-12)
