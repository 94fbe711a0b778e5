"""A compiled function gives every row what it gives the row alone, however many there are."""

import casadi as ca
import numpy as np
import pytest

from identify.model.compiled import batch
from identify.model.compiled.batch import BLOCKS, FEWEST, Mapped
from identify.model.kinematics import Kinematics


def double():
    a = ca.SX.sym("a")
    return Mapped(ca.Function("f", [a], [2 * a]))


@pytest.fixture
def worth_it(monkeypatch):
    """Columns are worth it from the first row."""
    monkeypatch.setattr(batch, "WORTH", 0)


@pytest.mark.parametrize("count", [1, FEWEST, *BLOCKS, BLOCKS[0] + 1, 2 * BLOCKS[-1] + 1])
@pytest.mark.usefixtures("worth_it")
def test_any_number_of_rows_fits(count, rng):
    x = rng.normal(size=(count, 1))

    (found,) = double()(x)

    np.testing.assert_array_equal(found, 2 * x[:, 0])


@pytest.mark.usefixtures("worth_it")
def test_rows_asked_for_again_and_again_stay_what_they_are(rng):
    x, twice = rng.normal(size=(300, 1)), double()

    found = [twice(x)[0] for _ in range(batch.AGAIN + 2)]

    assert {300, BLOCKS[0], BLOCKS[-1]} == {size for size, _ in twice._blocks}
    np.testing.assert_array_equal(found, np.tile(2 * x[:, 0], (len(found), 1)))


def test_many_rows_give_what_each_row_gives_alone(arc_welder, rng, monkeypatch):
    q = rng.uniform(arc_welder.robot.lower, arc_welder.robot.upper, (23, 6))
    theta = arc_welder.theta + rng.normal(0, 1e-3, (23, arc_welder.theta.size))
    alone = [Kinematics(arc_welder.robot).tip_jacobian(row, t) for row, t in zip(q, theta, strict=True)]
    monkeypatch.setattr(batch, "CHUNK", 5)  # rows fall into five calls, the last one shorter

    position, J = Kinematics(arc_welder.robot).tip_jacobian(q, theta)

    np.testing.assert_array_equal(position, np.concatenate([p for p, _ in alone]))
    np.testing.assert_array_equal(J, np.concatenate([j for _, j in alone]))


@pytest.mark.parametrize(
    ("q", "theta"),
    [
        (np.zeros(5), np.zeros(42)),
        (np.zeros((6, 1)), np.zeros(42)),
        (np.zeros((3, 6)), np.zeros((2, 42))),
        (np.zeros((3, 6)), np.array(1.0)),
        (np.zeros((1, 3, 6)), np.zeros(42)),
    ],
)
def test_arrays_of_another_shape_are_refused(arc_welder, q, theta):
    with pytest.raises(ValueError, match=r"tip: .*expected"):
        arc_welder.kinematics.tip(q, theta)
