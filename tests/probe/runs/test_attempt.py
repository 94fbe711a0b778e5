"""One touch: tried again, made at its speeds, judged against all others."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from run_bench import USUAL, Bench
from touching import SERVO, clear_plan

from identify.model.cell import Cell
from identify.model.touch import Plan
from probe.line.controller import Contact, NoContact, Refused, TouchError
from probe.motion.joint_path import Geometry

pytestmark = [pytest.mark.usefixtures("unsynced"), pytest.mark.xdist_group("runs bench")]


def test_a_miss_is_tried_again_and_three_in_a_row_end_the_run(bench: Bench) -> None:
    bench.world.open_wire = True

    with pytest.raises(TouchError, match=r"3 touches in a row failed, the last \(t003\)"):
        bench.run()

    assert bench.status() == {"t001": "miss", "t002": "miss", "t003": "miss"}
    assert bench.robot.log.count("search") == 9
    bench.world.open_wire = False
    assert bench.run().hits == 5


def test_a_single_failure_is_made_good_by_a_retry(bench: Bench) -> None:
    bench.robot.fail = [None, None, None, None, Refused("DEADMAN"), None, None, Refused("NOTREACHED")]

    assert bench.run().hits == 8

    assert len(bench.reasons()) == 2


def test_a_touch_that_all_others_speak_against_is_made_again(cell: Cell, tmp_path: Path) -> None:
    bench = Bench(cell, clear_plan(cell, 30, seed=2), tmp_path)
    original, wrong = bench.robot.search, list[float]()

    def bent(q: np.ndarray, rate: float) -> Contact | NoContact:
        start, found = bench.world.q, original(q, rate)
        if wrong:
            return found
        wrong.append(1.0)  # the very first touch, which no prediction speaks against yet
        late = found.q + 0.12 * (q - start)
        bench.world.q = late + 1e-6 * (q - start)
        return Contact(late, bench.world.q.copy(), bench.world.boot, bench.robot.last)

    bench.robot.search = bent  # type: ignore[method-assign]

    assert bench.run(replace(USUAL, disagreement=1.0)).hits == 30
    assert any("from what the other touches predict" in reason for reason in bench.reasons())
    assert sorted(bench.status()) == sorted(bench.plan.ids)
    made = dict(zip(bench.hits().ids, bench.hits().q, strict=True))
    first = min(np.abs(made["t001"] - truth).max() for truth in bench.world.truth[1:])
    assert first < 0.01 * SERVO * 50


def test_a_touch_far_from_the_prediction_is_repeated_at_once(cell: Cell, tmp_path: Path) -> None:
    bench = Bench(cell, clear_plan(cell, 30, seed=2), tmp_path)

    original, wrong = bench.robot.search, list[float]()

    def bent(q: np.ndarray, rate: float) -> Contact | NoContact:
        start, found = bench.world.q, original(q, rate)
        if len(bench.world.truth) != 30 or wrong:
            return found
        wrong.append(1.0)  # the wire gives way: what it says comes a quarter of the search too late
        late = found.q + 0.25 * (q - start)
        bench.world.q = late + 1e-6 * (q - start)
        return Contact(late, bench.world.q.copy(), bench.world.boot, bench.robot.last)

    bench.robot.search = bent  # type: ignore[method-assign]

    assert bench.run().hits == 30
    (reason,) = bench.reasons()
    assert "mm from the prediction" in reason
    assert float(reason.split()[0]) < -5.0
    assert bench.hits().note[29] == ""


def test_the_override_slows_everything_but_the_search(bench: Bench, cell: Cell, plan: Plan, tmp_path: Path) -> None:
    rates: dict[float, list[tuple[str, float]]] = {}
    for override in (1.0, 0.5):
        other = Bench(cell, plan, tmp_path / str(override))
        other.path.parent.mkdir()
        heard = rates.setdefault(override, [])
        move, search = other.robot.move, other.robot.search
        other.robot.move = lambda q, r, h=heard, m=move: (h.append(("move", r)), m(q, r))[1]  # type: ignore[method-assign]
        other.robot.search = lambda q, r, h=heard, s=search: (h.append(("search", r)), s(q, r))[1]  # type: ignore[method-assign]
        other.run(replace(USUAL, override=override))

    fast, slow = rates[1.0][1:], rates[0.5][1:]
    assert [kind for kind, _ in fast] == [kind for kind, _ in slow]
    for (kind, f), (_, s) in zip(fast, slow, strict=True):
        assert s == pytest.approx(f if kind == "search" else f / 2, rel=2e-2)


def test_no_joint_and_no_tip_moves_faster_than_allowed(bench: Bench) -> None:
    robot, geometry = bench.cell.robot, Geometry(bench.cell, USUAL)
    original, worst = bench.robot.move, []

    def watched(q: np.ndarray, rate: float) -> np.ndarray:
        seconds = bench.world.duration(bench.world.q, q, rate)
        if seconds > 0:
            joints = (np.abs(q - bench.world.q) / seconds / robot.speed).max()
            worst.append(max(joints, geometry.length(bench.world.q, q) / seconds / USUAL.move_speed))
        return original(q, rate)

    bench.robot.move = watched  # type: ignore[method-assign]
    bench.run()

    assert max(worst) <= 1.001
