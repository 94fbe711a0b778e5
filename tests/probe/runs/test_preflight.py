"""Whole plans are refused before the first motion, with every reason at once."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from run_bench import USUAL, Bench, hidden
from touching import clear_plan

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.touch import Plan
from probe.motion.joint_path import Geometry
from probe.motion.settings import Settings
from probe.runs.preflight import validate

pytestmark = [pytest.mark.usefixtures("unsynced"), pytest.mark.xdist_group("runs bench")]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda plan: replace(plan, face=("roof", *plan.face[1:])), "has no face 'roof'"),
        (lambda plan: replace(plan, q=plan.q + np.eye(6)[5] * 2 * np.pi), "limits of this robot"),
        (lambda plan: replace(plan, normal=np.roll(plan.normal, 1, axis=1)), "for another jig"),
        (lambda plan: replace(plan, point=plan.point + 200.0), "for another robot or cell"),
        (lambda plan: replace(plan, approach=plan.q + 0.05 * (plan.approach - plan.q)), "before the face"),
        (lambda plan: replace(plan, approach=plan.q + 3.0 * (plan.approach - plan.q)), "further than travel_mm"),
    ],
)
def test_a_plan_that_does_not_fit_is_refused_before_anything_moves(
    bench: Bench, change: Callable[[Plan], Plan], sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        bench.run(plan=change(bench.plan))

    assert bench.robot.log == []


def test_a_plan_that_goes_where_arm_or_torch_hit_is_refused_with_touch_bodies_and_place(bench: Bench) -> None:
    plan, jig = bench.plan, bench.cell.jig
    assert jig is not None
    low = next(i for i, face in enumerate(plan.face) if jig.by_name[face].normal[2] == 1)
    deep = plan.approach[low] + 6 * (plan.q[low] - plan.approach[low])  # on along the search, far into the jig
    via = np.full((len(plan), 1, 6), np.nan)
    via[low, 0] = deep

    with pytest.raises(InputError, match=rf"touch '{plan.ids[low]}': .* and box \d meet near \(.*\) mm; plan again"):
        bench.run(plan=replace(plan, via=via))

    assert bench.robot.log == []


def test_where_no_clear_way_leads_on_the_plan_is_refused(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    plan, geometry = clear_plan(bench.cell, 30, seed=3), Geometry(bench.cell, USUAL)
    pairs = ((i, j) for i in range(30) for j in range(30) if i != j)
    crossing = next(pair for pair in pairs if hidden(geometry, plan.approach[list(pair)]))
    monkeypatch.setattr("probe.motion.roadmap.lifts", lambda edges, q: np.full_like(q, np.nan))  # no way over it

    with pytest.raises(InputError, match=r"no clear way was found from touch .* meet near \("):
        bench.run(plan=plan.take(np.array(crossing)))

    assert bench.robot.log == []


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        (Settings(override=0.0), "override is 0"),
        (Settings(search_speed=-1.0), "search_speed is -1"),
        (Settings(search_speed=2000.0), "search slower"),
        (Settings(retries=-1), "-1 retries"),
    ],
)
def test_settings_that_make_no_sense_are_refused(bench: Bench, settings: Settings, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        bench.run(settings)

    assert bench.robot.log == []


def test_a_plan_for_a_robot_with_fewer_joints_is_refused(cell: Cell, plan: Plan) -> None:
    with pytest.raises(InputError, match="for 5 joints, the robot 'arc-welder' has 6"):
        validate(replace(plan, q=plan.q[:, :5], approach=plan.approach[:, :5], via=plan.via[..., :5]), cell, USUAL)


def test_every_mistake_of_a_plan_is_told_at_once(cell: Cell, plan: Plan) -> None:
    wrong = replace(plan, normal=np.roll(plan.normal, 1, axis=1))

    with pytest.raises(InputError) as error:
        validate(wrong, cell, USUAL)

    assert len(error.value.mistakes) == len(plan)


def test_a_controller_of_another_robot_is_refused(bench: Bench) -> None:
    bench.robot.joints = 7

    with pytest.raises(InputError, match="moves 7 joints"):
        bench.run()
