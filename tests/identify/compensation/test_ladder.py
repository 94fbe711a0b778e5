"""The accuracy ladder: every rung is the best that its parameters can do, and predicts what a hidden robot does."""

from dataclasses import replace

import numpy as np
import pytest
from cells import PLACES, cell_of
from identified import identified
from measured import table_2
from scipy.optimize import least_squares

from identify.compensation.ladder import FRAMES, MODEL, TOOL, WAYS, ZEROS, ladder
from identify.model.zone import zone_poses


@pytest.fixture(scope="module")
def rungs(found):
    return {rung.way: rung.errors for rung in ladder(found)}


def test_every_rung_is_better_than_the_one_below(rungs):
    rms = [errors.rms_mm for errors in rungs.values()]

    assert list(rungs) == [*WAYS, MODEL]
    assert rms == sorted(rms, reverse=True)


@pytest.mark.parametrize(
    ("way", "groups"), [(ZEROS, ("theta",)), (TOOL, ("theta", "tool")), (FRAMES, ("theta", "tool", "base"))]
)
def test_no_other_values_of_a_rung_do_better(way, groups, arc_welder):
    truth = table_2(arc_welder)
    q = zone_poses(arc_welder, truth)
    names = arc_welder.robot.parameters
    free = [i for i, name in enumerate(names) if name.split(".")[0] in groups or name.split(".")[1] in groups]
    tip = arc_welder.kinematics.tip(q, truth)[0]

    def off(x):
        theta = arc_welder.theta.copy()
        theta[free] += x
        return (arc_welder.kinematics.tip(q, theta)[0] - tip).ravel()

    best = least_squares(off, np.zeros(len(free)), x_scale=arc_welder.scale[free]).fun.reshape(-1, 3)
    rms = {rung.way: rung.errors.rms_mm for rung in ladder(identified(arc_welder, truth))}[way]

    assert rms == pytest.approx(np.sqrt((best**2).sum(axis=1).mean()), rel=1e-4)


def test_zeros_alone_make_a_robot_right_whose_zeros_alone_are_wrong(arc_welder):
    truth = arc_welder.theta.copy()
    truth[[arc_welder.robot.parameters.index(f"j{k}.theta") for k in (2, 3, 5)]] += [0.01, -0.02, 0.015]

    rungs = {rung.way: rung.errors for rung in ladder(identified(arc_welder, truth))}

    assert rungs["nothing"].mean_mm > 3
    assert rungs[ZEROS].max_mm < 0.01  # what the covariance leaves


def test_the_last_rung_is_what_the_hidden_robot_shows(arc_welder, found, rungs):
    q = zone_poses(arc_welder, found.theta)
    truth = arc_welder.kinematics.tip(q, table_2(arc_welder))[0]

    off, nothing = (
        np.linalg.norm(arc_welder.kinematics.tip(q, theta)[0] - truth, axis=1).mean()
        for theta in (found.theta, arc_welder.theta)
    )

    assert 0.4 < off / rungs[MODEL].mean_mm < 2.0  # one robot of the many
    assert nothing == pytest.approx(rungs["nothing"].mean_mm, rel=0.02)


@pytest.mark.parametrize("robot", PLACES)
def test_every_robot_of_the_library_has_a_ladder(robot, rng):
    cell = cell_of(robot)
    truth = cell.theta + 0.2 * cell.scale * rng.standard_normal(len(cell.theta))

    rms = [rung.errors.rms_mm for rung in ladder(identified(cell, truth))]

    assert rms == sorted(rms, reverse=True)
    assert rms[-1] < 0.01 < rms[0]


def test_a_cell_without_zone_and_jig_has_none(arc_welder):
    cell = replace(arc_welder, zone=None, jig=None)

    assert ladder(identified(cell, cell.theta)) == ()
