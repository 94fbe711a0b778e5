"""Touch, identify and plan by turns: against hidden robots that only the simulator knows."""

from dataclasses import replace
from functools import reduce

import numpy as np
import pytest

from identify.estimation.calibrate import calibrate
from identify.estimation.face_association import believe, believed
from identify.model.cell import Priors
from identify.model.files import InputError
from identify.model.io.calibration_file import summarize
from identify.model.touch import Plan, joined
from identify.model.zone import zone_poses
from identify.uncertainty.posterior import zone_promise
from oed.campaigns.campaign import campaign
from oed.campaigns.connection import Connection
from oed.campaigns.folder import Folder, over_port, touches_of
from oed.campaigns.stages import Job
from oed.candidates.candidates import candidates
from oed.planning.candidate_set import plan_of
from oed.planning.uncertain import begun, plan_under_uncertainty
from probe import Settings
from probe.line.controller import TouchError
from probe.virtual.batch import touch_batch
from probe.virtual.truth import Truth, draw_truth


@pytest.fixture(scope="module")
def known(arc_welder):
    """The cell of the paper with tolerances of a robot that was measured once."""
    return replace(arc_welder, priors=Priors((3.0, 0.005), (3.0, 0.005), (0.5, 0.002)))


def toucher(cell, truth, rng, calls=None):
    def touch(job):
        if calls is not None:
            calls.append(job)
        return touch_batch(replace(cell, touch=job.cell.touch), truth, job.plan, rng, blind=True)

    return touch


def quickly(cell, n, rng, after):
    return plan_under_uncertainty(cell, n, rng, after)


def errors(cell, calibration, truth):
    q = zone_poses(cell, None, 500, rng=np.random.default_rng(9))
    tip = calibration.cell.kinematics.tip(q, calibration.theta)[0]
    return np.linalg.norm(tip - cell.kinematics.tip(q, truth.theta)[0], axis=1)


@pytest.fixture(scope="module")
def first(known):
    """Touches of a first stage."""
    return plan_under_uncertainty(known, 8, np.random.default_rng(4))


@pytest.fixture(scope="module")
def said():
    """What a campaign says of its progress, with the share of the touches tried."""
    return []


@pytest.fixture(scope="module")
def done(known, said):
    truth = draw_truth(known, np.random.default_rng(4))
    rng = np.random.default_rng(2)
    touch = toucher(known, truth, rng)
    return truth, campaign(
        known, target_mm=0.3, rng=rng, touch=touch, planner=quickly, progress=lambda *words: said.append(words)
    )


def test_a_campaign_reaches_its_target_and_the_hidden_robot_is_within_the_promise(known, done):
    truth, found = done

    assert found.reached
    assert summarize(errors(known, found.calibration, truth)).p95_mm <= found.promised_mm <= 0.3


def test_what_a_campaign_promises_is_what_identify_says_of_its_touches(known, done):
    _, found = done
    touches = reduce(joined, (stage.touches for stage in found.stages))

    said = zone_promise(calibrate(known, touches))

    assert found.promised_mm == pytest.approx(said.p95_mm, rel=1e-3)


def test_a_robot_known_to_its_tolerances_is_searched_farther_than_one_identified(known, done):
    _, found = done

    lengths = [stage.job.cell.touch.approach for stage in found.stages]
    assert lengths[0] > known.touch.approach
    assert found.stages[-1].job.deviation < found.stages[0].job.deviation


def test_a_campaign_says_how_far_it_is(done, said):
    counts = [len(stage.touches) for stage in done[1].stages]

    tried = np.repeat(np.cumsum([0, *counts[:-1]]), 2) / 250  # touches at the most
    assert [share for _, share in said] == pytest.approx(tried)
    assert [what for what, _ in said][:2] == ["stage 1: planning", f"stage 1: {counts[0]} touches"]


def test_a_jig_that_is_nowhere_is_said(known, first, monkeypatch):
    away = known.theta.copy()
    away[1] -= 2000.0
    monkeypatch.setattr("oed.campaigns.campaign.plan_under_uncertainty", lambda *planned: first)

    with pytest.raises(TouchError, match="none of 8 touches met the jig"):
        campaign(
            known,
            target_mm=0.3,
            rng=np.random.default_rng(0),
            planner=quickly,
            touch=toucher(known, Truth(away), np.random.default_rng(0)),
        )


@pytest.mark.parametrize(("wrong", "sentence"), [({"target_mm": 0.0}, "target"), ({"max_touches": 20}, "20 touches")])
def test_what_cannot_be_is_refused_before_the_first_touch(known, wrong, sentence):
    calls = []

    with pytest.raises(InputError, match=sentence):
        campaign(known, **({"target_mm": 0.3} | wrong), rng=np.random.default_rng(0), touch=calls.append)

    assert calls == []


def test_a_touch_on_another_step_of_the_jig_is_not_taken_for_the_planned_one(known, done):
    truth, found = done
    made = reduce(joined, (stage.touches for stage in found.stages))
    made = made.take(np.array([s == "hit" for s in made.status]))
    tip = known.kinematics.tip(made.q, truth.theta)[0]
    high = int(np.argmax([name.startswith("top") for name in made.face]))
    other = next(name for name in ("top-low", "top-high") if name != made.face[high])
    face = known.jig.by_name[other]
    moved = replace(
        made,
        face=(*made.face[:high], other, *made.face[high + 1 :]),
        offset=np.where(np.arange(len(made)) == high, face.offset, made.offset),
    )
    assert abs(tip[high] @ face.normal - face.offset) > 50

    belief = believe(known, moved)

    assert not belief.as_planned(moved)[high]
    assert belief.as_planned(moved).sum() > 0.85 * len(moved)  # some of the first did meet another face


@pytest.fixture(scope="module")
def far(arc_welder):
    """The cell with searches for a robot that may be 80 mm off, and a few of them, chosen without care."""
    wide = replace(arc_welder, touch=replace(arc_welder.touch, approach=80.0, travel=160.0))
    return wide, plan_of(candidates(wide, np.random.default_rng(4), 24, share=0.4))


@pytest.mark.parametrize("seed", [2, 9, 12])
def test_searches_that_met_another_face_or_the_table_are_told_from_the_others(far, seed):
    wide, searches = far
    truth = draw_truth(wide, np.random.default_rng([seed, 77]))
    told, made = (
        touch_batch(wide, truth, searches, np.random.default_rng(seed), blind=blind) for blind in (False, True)
    )
    hit = np.array([status == "hit" for status in made.status])
    told, made = told.take(hit), made.take(hit)
    met = [note.removeprefix("touched ") or face for face, note in zip(told.face, told.note, strict=True)]
    met = [name if name in wide.jig.by_name else "a box" for name in met]
    assert sum(a != b for a, b in zip(met, made.face, strict=True)) >= 2

    belief = believe(wide, made)

    wrong = np.array([a != b for a, b in zip(belief.touches.face, met, strict=True)])
    off = [
        np.linalg.norm(wide.kinematics.tip(made.q, theta)[0] - wide.kinematics.tip(made.q, truth.theta)[0], axis=1)
        for theta in (wide.theta, belief.theta)
    ]
    assert wrong.sum() <= 1
    assert off[1].max() < 0.7 * off[0].max()


class Corridor:
    """Ways along y = 0 to the next place, and straight up from there."""

    def clear(self, start, end):
        along = (start[:, 1] == 0) & (end[:, 1] == 0) & (np.abs(start[:, 0] - end[:, 0]) <= 1)
        return along | (start[:, 0] == end[:, 0])

    def among(self, at):
        return np.array([self.clear(np.tile(one, (len(at), 1)), at) for one in at])


def places(*at):
    n, q = len(at), np.array(at, dtype=float)
    return Plan(tuple(map(str, range(n))), ("top",) * n, np.zeros((n, 3)), np.zeros((n, 3)), q, q)


def test_a_robot_goes_back_the_way_it_has_come_where_no_other_leads_on():
    trail, plan = places([0, 0], [1, 0], [2, 0]), places([0, 3], [0, 1])

    found = begun(plan, Corridor(), trail)

    np.testing.assert_array_equal(found.way(0), [[1, 0], [0, 0], found.approach[0]])
    assert sorted(found.ids) == ["0", "1"]
    np.testing.assert_array_equal(found.way(1), found.approach[1:])
    elsewhere = places([5, 1], [6, 1])
    assert begun(elsewhere, Corridor(), trail) is elsewhere


def test_the_believed_cell_has_the_believed_robot(known, rng):
    theta = draw_truth(known, rng).theta

    np.testing.assert_allclose(believed(known, theta).theta, theta)


class Killed(Exception):
    """The program ends here."""


@pytest.mark.parametrize("stage", [2])
def test_a_campaign_that_was_killed_goes_on_with_the_plans_it_has(known, tmp_path, stage):
    truth = draw_truth(known, np.random.default_rng(2))
    inner = toucher(known, truth, np.random.default_rng(3))

    def dying(job):
        if job.number == stage:
            raise Killed
        return inner(job)

    keep = Folder(tmp_path, known, {})
    keep.keep_calibration = lambda number, calibration: None  # its touches are not in files here
    options = {"target_mm": 2.0, "planner": quickly, "keep": keep}
    with pytest.raises(Killed):
        campaign(known, rng=np.random.default_rng(1), touch=dying, **options)
    before = (tmp_path / f"plan-{stage}.csv").read_bytes()

    inner = toucher(known, truth, np.random.default_rng(3))
    found = campaign(known, rng=np.random.default_rng(1), touch=inner, **options)

    assert found.reached
    assert (tmp_path / f"plan-{stage}.csv").read_bytes() == before


def test_plans_of_another_cell_or_changed_by_hand_are_refused(known, first, arc_welder, tmp_path):
    told = {"approach_mm": 25.0, "travel_mm": 60.0}
    Folder(tmp_path, known, {}).keep_plan(1, first, told)

    with pytest.raises(InputError, match="another cell"):
        Folder(tmp_path, arc_welder, {}).planned(1)

    path = tmp_path / "plan-1.csv"
    path.write_text(path.read_text().replace("0.0", "0.5", 1))
    with pytest.raises(InputError, match="changed after it was planned"):
        Folder(tmp_path, known, {}).planned(1)


def test_a_campaign_that_stops_names_no_option_that_it_does_not_have(known, first, tmp_path, monkeypatch):
    def stop(*_, **__):
        raise TouchError("move it there by hand, then go on with --resume --trust-position")

    monkeypatch.setattr("oed.campaigns.connection.open_controller", stop)
    job = Job(1, known, first, True, 1.0)

    with pytest.raises(TouchError, match="go on with the same command and --trust-position"):
        over_port(tmp_path, known, Connection("loop://", "line"), Settings())(job)


def test_a_virtual_robot_scatters_anew_in_each_stage(known, first, tmp_path, monkeypatch):
    seeds = []

    def noted(connection, *_, **__):
        seeds.append(connection.seed)
        raise TouchError("enough")

    monkeypatch.setattr(Connection, "session", noted)
    for number in (1, 2):
        with pytest.raises(TouchError, match="enough"):
            over_port(tmp_path, known, Connection("sim", seed=5, protocol="line"), Settings())(
                Job(number, known, first, True, 1.0)
            )

    assert len(set(seeds)) == 2


def test_a_stage_without_all_its_rows_is_not_complete(known, first, tmp_path):
    assert touches_of(tmp_path / "touches-1.csv", known, first) is None
