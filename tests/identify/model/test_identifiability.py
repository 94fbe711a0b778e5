import numpy as np
import pytest
import scipy.linalg
from measured import poses_over_jig
from oracle import error_propagation

from identify.model.cell import Cell
from identify.model.identifiability import independent, rank_of, sight, structure, weak
from identify.model.io.description import library, read_robot

OFF_AXIS = np.array([20.0, 30.0, 100.0, 0.0, 0.3, 0.0])  # a tip beside the last axis, as a generic tool has


def test_the_paper_s_robot_has_25_independent_parameters_and_23_with_joint_6_still(arc_welder):
    moving, still = structure(arc_welder), structure(arc_welder, still={5: 0.3})

    assert moving.rank == 25
    assert still.rank == 23


@pytest.mark.parametrize("robot", library("robots"))
def test_the_rank_is_that_of_the_closed_form_jacobian_over_many_poses(robot, arc_welder, rng):
    cell = Cell(read_robot(library("robots")[robot]), None, arc_welder.base, OFF_AXIS)
    poses = rng.uniform(cell.robot.lower, cell.robot.upper, (60, len(cell.robot.joints)))

    J = np.concatenate([error_propagation(cell.robot, q, cell.theta) for q in poses])
    s = scipy.linalg.svdvals(J * cell.scale)

    assert structure(cell).rank == int((s > 1e-9 * s[0]).sum())


def test_of_parallel_axes_the_outer_offset_stays_and_carries_the_inner_one(arc_welder):
    assert structure(arc_welder).combinations["j2.d"] == {"j3.d": pytest.approx(1.0, abs=1e-9)}


def test_every_eliminated_column_is_its_combination_of_kept_ones_at_every_pose(arc_welder, rng):
    found = structure(arc_welder)
    names = arc_welder.robot.parameters
    poses = rng.uniform(arc_welder.robot.lower, arc_welder.robot.upper, (20, 6))

    J = np.concatenate([error_propagation(arc_welder.robot, q, arc_welder.theta) for q in poses])
    carried = {
        name: sum((c * J[:, names.index(kept)] for kept, c in terms.items()), np.zeros(len(J)))
        for name, terms in found.combinations.items()
    }

    assert found.rank + len(carried) == len(names)
    for name, column in carried.items():
        np.testing.assert_allclose(J[:, names.index(name)], column, atol=1e-5)  # coefficients below 1e-7 are dropped


def test_a_fixed_parameter_leaves_its_place_to_the_one_it_carried(arc_welder):
    fixed = Cell(arc_welder.robot, None, arc_welder.base, arc_welder.tool, fixed=frozenset({"j3.d"}))

    found = structure(fixed)

    assert found.rank == 25
    assert "j2.d" in {found.names[i] for i in found.kept}


def test_independent_columns_agree_with_scipy_s_pivoted_rank(rng):
    A = rng.normal(size=(40, 6)) @ rng.normal(size=(6, 12))

    kept, rest = independent(A, list(range(12)))

    assert kept == list(range(6))
    assert np.linalg.matrix_rank(A) == 6
    for i, terms in rest.items():
        np.testing.assert_allclose(A[:, i], sum(c * A[:, k] for k, c in terms.items()), atol=1e-5)


def test_sight_names_what_is_lost_and_what_is_weak(rng):
    J = rng.normal(size=(30, 4)) * [100.0, 100.0, 0.01, 0.0]

    names = ["base.x", "base.y", "j1.beta", "tool.z"]

    seen = sight(J, names)

    assert seen.rank == rank_of(J) == 3
    assert seen.lost == ("tool.z",)
    assert set(weak(J.T @ J, names)) == {"j1.beta", "tool.z"}  # what is not seen is told by the prior alone


def test_touches_over_the_jig_see_all_that_the_structure_keeps(arc_welder, rng):
    found = structure(arc_welder)
    q = poses_over_jig(arc_welder, 100, rng)
    kept = list(found.kept)

    J = np.concatenate([error_propagation(arc_welder.robot, pose, arc_welder.theta)[:, kept] for pose in q])
    seen = sight(J * arc_welder.scale[kept] / 0.05, [found.names[i] for i in kept])

    assert seen.rank == found.rank
