"""Planes of unknown pose tell no length; one known length does, and a tool that is to be fitted may begin at zero."""

from dataclasses import replace

import numpy as np
import pytest

from identify.estimation.calibrate import calibrate
from identify.model.cell import Device, Point
from identify.model.files import InputError
from identify.model.zone import zone_poses
from oed.candidates.kinds import measurements
from probe.virtual.batch import touch_batch
from probe.virtual.readings import readings
from probe.virtual.truth import draw_truth
from studies.scale import laid_over


@pytest.fixture(scope="module")
def hidden(arc_welder):
    return draw_truth(arc_welder, np.random.default_rng(8), scale=0.1)


@pytest.fixture(scope="module")
def positions(arc_welder, hidden):
    rng = np.random.default_rng(1)
    cell = replace(arc_welder, devices={"position": Device(sigma=0.03)})
    return readings(cell, measurements(cell, "position", rng, 60)[0], hidden.theta, rng)


def test_a_tool_that_is_to_be_fitted_begins_at_zero_and_ends_where_it_is(arc_welder, hidden, positions):
    found = calibrate(replace(arc_welder, tool=None), positions, folds=0, errors="cell")

    off = found.theta[-6:-3] - hidden.theta[-6:-3]
    assert np.linalg.norm(hidden.theta[-6:-3]) > 300
    assert np.linalg.norm(off) < 2.0  # [mm], of lengths known to 3


def test_sockets_of_unknown_place_need_one_known_length_beside_the_touches_of_a_jig(arc_welder, hidden):
    rng = np.random.default_rng(3)
    places = {"a": np.array([60.0, 40.0, 260.0]), "b": np.array([330.0, 250.0, 330.0])}
    cell = replace(arc_welder, points={name: Point(place) for name, place in places.items()})
    contacts = readings(cell, measurements(cell, "contact", rng, 40)[0], hidden.theta, rng)
    fitted = replace(cell, points={name: Point(None) for name in places})

    with pytest.raises(InputError, match="no length is known"):
        calibrate(fitted, contacts, folds=0, errors="cell")
    from oed.planning.plan import plan

    touches = touch_batch(arc_welder, hidden, plan(arc_welder, 30, "V", "even", rng, count=600).plan, rng)
    found = calibrate(fitted, touches.take(np.array(touches.status) == "hit"), contacts, folds=0, errors="cell")
    values = {s.name: s.value for s in found.shared}
    for name, place in places.items():
        at = np.array([values[f"point.{name}.{axis}"] for axis in "xyz"])
        assert np.linalg.norm(at - place) < 0.5  # [mm]


def test_planes_that_are_seen_from_a_stand_of_unknown_pose_are_a_jig_and_know_their_lengths(arc_welder, hidden):
    from oed.planning.plan import plan

    rng = np.random.default_rng(4)
    touches = touch_batch(arc_welder, hidden, plan(arc_welder, 40, "V", "even", rng, count=600).plan, rng)
    touches = touches.take(np.array(touches.status) == "hit")
    cell = replace(arc_welder, placements={"elsewhere": None})

    found = calibrate(cell, replace(touches, placement=("elsewhere",) * len(touches)), folds=0, errors="cell")

    stand = {s.name: s.value for s in found.shared}
    place = np.array([stand[f"placement.elsewhere.{axis}"] for axis in "xyz"])
    assert np.linalg.norm(place - hidden.theta[:3]) < 5.0  # [mm]


def test_planes_of_unknown_offset_need_one_known_length(arc_welder, hidden):
    """Plates that lean as is known and stand anywhere: the touches alone are refused, distances to a pin suffice."""
    from oed.planning.plan import plan

    rng = np.random.default_rng(4)
    touches = touch_batch(arc_welder, hidden, plan(arc_welder, 60, "V", "even", rng, count=600).plan, rng)
    touches = touches.take(np.array(touches.status) == "hit")
    jig = arc_welder.the_jig
    plates = replace(jig, faces=tuple(replace(face, tolerance=1000.0) for face in jig.faces))
    pin = {"pin": Point(np.array([450.0, -50.0, 10.0]), 0.02)}
    wire = {"distance": Device(sigma=0.02, range=(250.0, 900.0))}
    cell = replace(arc_welder, jig=plates, points=pin, devices=wire)
    distances = readings(cell, measurements(cell, "distance", rng, 30)[0], hidden.theta, rng)

    with pytest.raises(InputError, match="no length is known"):
        calibrate(replace(cell, points={}), touches, folds=0, errors="cell")
    found = calibrate(cell, touches, distances, folds=0, errors="cell")

    q = zone_poses(arc_welder, hidden.theta, 100)
    tips = [arc_welder.kinematics.tip(q, theta)[0] for theta in (found.theta, hidden.theta)]
    assert abs(laid_over(*tips)[1] - 1) < 5e-4
