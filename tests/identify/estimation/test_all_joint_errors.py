"""All joint errors at once: those that measurements can show, and the refusal of rows that contradict each other."""

from dataclasses import replace

import numpy as np
import pytest

from identify.estimation.all_joint_errors import _require_agreement, shown
from identify.estimation.problem import CalibrationFailed
from identify.model.joint_error_models import ERROR_MODELS
from identify.model.measurement import rows
from identify.model.touch import Positions


def positions(cell, rng, temperature):
    q = rng.uniform(-0.5, 0.5, (4, 6))
    tip = cell.kinematics.tip(q, cell.theta)[0]
    return Positions(tuple("abcd"), q, tip, np.full(4, 0.1), temperature=np.array(temperature))


@pytest.mark.parametrize(
    ("temperature", "grows"), [([20.0, 20.0, 20.0, 20.0], False), ([20.0, 22.0, 24.0, 26.0], True)]
)
def test_links_are_said_to_grow_only_where_temperatures_differ(temperature, grows, arc_welder, rng):
    measured = rows(arc_welder.wire, [positions(arc_welder, rng, temperature)], arc_welder.robot)

    names = shown(arc_welder, measured)

    assert ("thermal" in names) == grows
    assert {*names, "thermal"} == set(ERROR_MODELS)


def test_a_model_of_the_cell_file_stays(arc_welder, rng):
    cell = replace(arc_welder, robot=replace(arc_welder.robot, errors=("thermal",)))

    assert "thermal" in shown(cell, rows(cell.wire, [positions(arc_welder, rng, [20.0] * 4)]))


def test_rows_most_of_which_contradict_each_other_give_no_parameters():
    _require_agreement(np.arange(10) < 5)

    with pytest.raises(CalibrationFailed, match="no robot near the drawing explains more than 40 % of the measurem"):
        _require_agreement(np.arange(10) < 4)
