"""A dozen touches tell whether a robot has changed: seldom without a cause, surely with one, and by its right name."""

import re
from collections import Counter

import numpy as np
import pytest
from measured import poses_over_jig, table_2, touches_at, with_offsets
from scipy.stats import binom

from identify.health.causes import looked_for
from identify.health.judge import ALARM, judge, noticed
from identify.model.files import InputError
from identify.model.frames import rotation
from identify.model.io.tables import touches_text
from identify.model.measurement import measurement_model, rows
from identify.model.touch import HIT, Touches
from oed.candidates.candidates import candidates
from oed.planning.candidate_set import plan_of
from oed.planning.health_check import plan_check

DEG = np.pi / 180
SIGMA = 0.05  # [mm]


@pytest.fixture(scope="module")
def plan(arc_welder, found):
    return plan_check(arc_welder, found, looked_for(found), count=3000)[0]


def checked(cell, plan, theta, rng, sigma=SIGMA):
    """Touches of a robot with these parameters at the postures of a plan, on planes that stand where its tip is."""
    m = len(plan)
    blank = Touches(
        plan.ids,
        ("",) * m,
        plan.q,
        plan.normal,
        np.zeros(m),
        np.full(m, SIGMA),
        (HIT,) * m,
        np.full(m, np.nan),
        ("",) * m,
        ("",) * m,
    )
    where = measurement_model(cell.robot).residual(theta, rows(cell.wire, [blank]))
    return with_offsets(blank, where + sigma * rng.standard_normal(m))


@pytest.fixture(scope="module")
def check(arc_welder, found, plan):
    """Judge a robot that the calibration leaves possible, after a change of its parameters."""
    root = np.linalg.cholesky(found.covariance)

    def judged(change, rng, alarm=ALARM):
        theta = found.theta.copy()
        theta[found.index] += root @ rng.standard_normal(len(found.index))
        return judge(found, checked(arc_welder, plan, theta + change, rng, SIGMA * found.noise), alarm)

    return judged


def changed(cell, **change):
    """A change of parameters by name, dots written as underscores [mm, rad]."""
    out = np.zeros(len(cell.robot.parameters))
    for name, value in change.items():
        out[cell.robot.parameters.index(name.replace("_", "."))] = value
    return out


def test_a_robot_that_has_not_changed_is_said_to_have_as_seldom_as_is_stated(check):
    rng, trials = np.random.default_rng(2), 600

    results = [check(0.0, rng) for _ in range(trials)]

    for alarm in (0.01, 0.05, 0.2):
        low, high = binom(trials, alarm).ppf([0.005, 0.995])
        assert low <= sum(result.chance < alarm for result in results) <= high
    assert all((result.verdict == "unchanged") == (result.chance >= ALARM) for result in results)


def test_a_tool_hit_by_a_millimetre_is_called_broken_and_measured(arc_welder, check):
    rng = np.random.default_rng(3)
    verdicts, errors = Counter(), []
    wire = rotation(*arc_welder.theta[-3:])[:, 2]
    for _ in range(60):
        hit = rng.standard_normal(3)
        hit -= (hit @ wire) * wire  # across the wire; along it, it is a wire of another length
        hit /= np.linalg.norm(hit)
        result = check(changed(arc_welder, **dict(zip(("tool_x", "tool_y", "tool_z"), hit, strict=True))), rng)
        first = result.findings[0]
        verdicts[result.verdict, first.cause.name] += 1
        errors.append((first.change - hit) / first.sigma if first.cause.name == "tool" else np.full(3, np.nan))

    assert verdicts == {("broken", "tool"): 60}
    assert 0.6 < np.std(errors) < 1.5  # as sure as is said


@pytest.mark.parametrize("joint", ["j1", "j2", "j3", "j4", "j5"])
def test_a_zero_that_slips_by_a_twentieth_of_a_degree_is_named_and_measured(joint, arc_welder, check):
    rng = np.random.default_rng(4)

    results = [check(changed(arc_welder, **{f"{joint}_theta": s * 0.05 * DEG}), rng) for s in [1, -1] * 10]

    found = [next(f for f in r.findings if f.cause.name == f"{joint}.theta") for r in results]
    named = [r.findings[0] is f for r, f in zip(results, found, strict=True)]
    sizes = np.array([f.change[0] / DEG for f in found])
    assert {r.verdict for r in results} == {"drifted"}
    assert sum(named) >= 19  # where it is not the first, it is among those that are named
    assert min(f.sure for f in found) > 0.05
    assert sizes == pytest.approx([0.05, -0.05] * 10, abs=0.02)


def test_a_wire_that_stands_out_farther_is_told_from_a_tool_that_was_hit(arc_welder, check):
    wire = rotation(*arc_welder.theta[-3:])[:, 2]
    longer = changed(arc_welder, **dict(zip(("tool_x", "tool_y", "tool_z"), 1.5 * wire, strict=True)))

    results = [check(longer, np.random.default_rng(seed)) for seed in range(10)]

    assert {(r.verdict, r.findings[0].cause.name) for r in results} == {("drifted", "wire")}
    assert results[0].findings[0].change == pytest.approx([1.5], abs=0.2)


def test_a_jig_that_was_moved_is_told(arc_welder, check):
    rng = np.random.default_rng(5)

    results = [check(changed(arc_welder, base_x=1.0, base_y=-0.8, base_rz=0.1 * DEG), rng) for _ in range(10)]

    assert {(r.verdict, r.findings[0].cause.name) for r in results} == {("drifted", "base")}


def test_one_touch_that_went_wrong_is_not_taken_for_a_change_of_the_robot(arc_welder, found, plan):
    rng = np.random.default_rng(6)
    touches = checked(arc_welder, plan, found.theta, rng)

    result = judge(found, with_offsets(touches, touches.offset + 2.0 * (np.arange(len(plan)) == 4)))

    assert (result.verdict, result.findings[0].cause.name) == ("doubtful", f"touch {plan.ids[4]}")


def test_two_changes_at_once_are_said_to_be_more_than_one(arc_welder, check):
    both = changed(arc_welder, j2_theta=0.2 * DEG, tool_x=2.0, j5_theta=-0.2 * DEG)

    result = check(both, np.random.default_rng(7))

    assert result.verdict != "unchanged"
    assert not result.whole


def test_what_is_promised_to_be_noticed_is_noticed(arc_welder, found, plan, check):
    rng = np.random.default_rng(8)
    smallest = noticed(found, checked(arc_welder, plan, found.theta, rng))

    for joint in ("j2", "j4"):
        slip = changed(arc_welder, **{f"{joint}_theta": smallest[f"{joint}.theta"]})
        alarms = sum(check(slip, rng).verdict != "unchanged" for _ in range(150))
        assert alarms >= binom(150, 0.95).ppf(0.001)
        assert smallest[f"{joint}.theta"] < 0.05 * DEG


def test_a_joint_on_whose_axis_the_tip_lies_is_said_to_show_little(found, arc_welder, plan):
    smallest = noticed(found, checked(arc_welder, plan, found.theta, np.random.default_rng(9)))

    assert smallest["j6.theta"] > 20 * smallest["j2.theta"]  # 8 mm of lever, where joint 2 has 800


def test_planned_touches_notice_more_than_as_many_of_those_on_offer(arc_welder, found, plan):
    rng = np.random.default_rng(10)
    offered = candidates(arc_welder, rng, 400, theta=found.theta, structured=0.0)
    planned = noticed(found, checked(arc_welder, plan, found.theta, rng))

    ratios = []
    for _ in range(20):
        some = plan_of(offered.take(rng.choice(len(offered), 12, replace=False)))
        anywhere = noticed(found, checked(arc_welder, some, found.theta, rng))
        ratios.append([planned[name] / anywhere[name] for name in planned])

    by_cause = np.median(ratios, axis=0)
    assert np.median(by_cause) < 0.85
    assert by_cause.max() < 1.2  # no cause is given up for the others


def test_too_few_touches_and_touches_of_the_fit_are_refused(arc_welder, found, plan, rng):
    touches = checked(arc_welder, plan, found.theta, rng)
    seen = touches_at(
        arc_welder, table_2(arc_welder), poses_over_jig(arc_welder, 100, g := np.random.default_rng(5)), g
    )

    with pytest.raises(InputError, match="5 touches are too few to judge a robot by; make 6 at least"):
        judge(found, touches.take(np.arange(5)))
    with pytest.raises(InputError, match=r"100 of 100 measurements were used in the fit .* touch again"):
        judge(found, seen)


def test_words_of_a_verdict_name_part_size_and_cure(arc_welder, found, plan, found_folder, touchcal):
    slipped = found.theta + changed(arc_welder, j3_theta=0.05 * DEG)
    touches = checked(arc_welder, plan, slipped, np.random.default_rng(1))
    (found_folder / "touches.csv").write_text(touches_text(touches, arc_welder.robot))

    code, out, _ = touchcal("health", "calibration.json", "touches.csv")

    assert code == 1
    assert re.search(r"drifted: zero of joint j3 by \+0.0[45]\d \+- 0.00\d deg", out)
    assert "more than 99 % sure" in out
    assert "set the joint's zero again" in out
