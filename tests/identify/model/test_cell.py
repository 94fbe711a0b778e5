"""A cell: how far its robot may be from the drawing, and what it says of names that it does not have."""

from dataclasses import replace

import numpy as np
import pytest

from identify.model.cell import DEG, Device, Point, Priors, Wire
from identify.model.files import InputError


def test_each_parameter_has_the_tolerance_of_its_part_and_unit(arc_welder):
    cell = replace(arc_welder, priors=Priors((1.0, 2.0), (3.0, 4.0), (5.0, 6.0)))
    scale = dict(zip(cell.robot.parameters, cell.scale, strict=True))

    expected = {"base.x": 1, "base.rz": 2, "tool.z": 3, "tool.rx": 4, "j1.d": 5, "j6.a": 5, "j2.theta": 6, "j3.beta": 6}

    assert {name: scale[name] for name in expected} == expected


def test_what_is_to_be_fitted_is_not_known_before_and_does_not_spread(arc_welder):
    cell = replace(arc_welder, base=None, fixed=frozenset({"j1.d"}))

    assert np.isinf(cell.prior[:6]).all()
    assert np.isfinite(cell.prior[6:]).all()
    assert np.isfinite(cell.scale).all()
    zero = [name for name, spread in zip(cell.robot.parameters, cell.spread, strict=True) if spread == 0]
    assert zero == [*cell.robot.parameters[:6], "j1.d"]


def test_only_a_ball_adds_its_radius_and_only_a_flat_end_its_sine():
    assert [(Wire(0.6, shape).ball, Wire(0.6, shape).flat) for shape in ("point", "ball", "flat")] == [
        (0.0, 0.0),
        (0.6, 0.0),
        (0.0, 0.6),
    ]


def test_a_device_without_a_scatter_of_its_own_has_that_of_touches(arc_welder):
    cell = replace(arc_welder, devices={"distance": Device(sigma=0.2), "pose": Device(max_tilt=5 * DEG)})

    assert cell.sigma("distance") == 0.2
    assert cell.sigma("pose") == cell.sigma("touch") == cell.touch.sigma
    assert cell.device("pose").max_tilt == 5 * DEG


def test_points_to_be_fitted_stand_at_zero(arc_welder):
    cell = replace(arc_welder, points={"pin": Point(np.ones(3)), "hole": Point(None)})

    np.testing.assert_array_equal([cell.places["pin"], cell.places["hole"]], [np.ones(3), np.zeros(3)])


def test_a_face_that_is_not_there_is_answered_with_the_nearest_and_all(arc_welder):
    sentence = arc_welder.unknown_face("top-lo")

    assert "did you mean 'top-low'?" in sentence
    assert all(name in sentence for name in arc_welder.jig.by_name)


def test_a_cell_without_a_jig_asks_for_one(arc_welder):
    cell = replace(arc_welder, jig=None)

    with pytest.raises(InputError, match="the cell has no jig; name one"):
        _ = cell.the_jig
    assert "needs a jig; name one" in cell.unknown_face("top")
