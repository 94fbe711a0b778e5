"""Where the next touch should be, and how well that is known."""

from pathlib import Path

import numpy as np
import pytest
from run_bench import Bench
from touching import Ticks, World, clear_plan, disturbed

from identify.model.cell import Cell
from probe.line.controller import Contact, NoContact
from probe.runs.prediction import Predictor

pytestmark = [pytest.mark.usefixtures("unsynced"), pytest.mark.xdist_group("runs bench")]


def test_the_prediction_sharpens_as_touches_come_in(cell: Cell) -> None:
    plan = clear_plan(cell, 40, seed=2)
    clock = Ticks()
    world, predictor = World(cell, disturbed(cell, 0.5), clock, plan.approach[0]), Predictor(cell)
    assert cell.jig is not None
    surprises = []

    for start, q, face in zip(plan.approach, plan.q, plan.face, strict=True):
        hit = world.first_contact(start, start + 3 * (q - start))
        assert hit is not None
        touched = start + 3 * hit * (q - start)
        surprises.append(predictor.judge(touched, cell.jig.by_name[face]))
        predictor.learn(touched, cell.jig.by_name[face])

    normalized = np.array([s.difference / s.expected for s in surprises])
    assert max(abs(s.residual) for s in surprises) > 10  # what the nominal model says
    assert np.median([abs(s.difference) for s in surprises[-10:]]) < 1.0
    assert np.abs(normalized).max() < 4  # and it knows how well it knows


def test_once_the_robot_is_known_a_search_begins_close_before_its_contact(cell: Cell, tmp_path: Path) -> None:
    bench = Bench(cell, clear_plan(cell, 30, seed=2), tmp_path)
    original, starts = bench.robot.search, list[np.ndarray]()

    def noted(q: np.ndarray, rate: float) -> Contact | NoContact:
        starts.append(bench.world.q)
        return original(q, rate)

    bench.robot.search = noted  # type: ignore[method-assign]

    assert bench.run().hits == 30
    tips = cell.kinematics.tip(np.stack([*starts, *bench.world.truth]), bench.world.theta)[0].reshape(2, 30, 3)
    way = np.linalg.norm(tips[0] - tips[1], axis=1)  # [mm]
    assert way[:3].min() > 15
    assert way[-5:].max() < 12
    assert way.min() > 2
    assert bench.reasons() == []
