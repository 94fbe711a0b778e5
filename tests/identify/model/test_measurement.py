"""Every kind of measurement: zero at what the oracle measures, slopes that differences confirm, and named points."""

import numpy as np
import pytest
from instruments import ANCHOR, equations, measured

from identify.model.cell import Wire
from identify.model.measurement import MEASUREMENTS, measurement_model, rows


@pytest.mark.parametrize("kind", MEASUREMENTS)
def test_what_an_exact_instrument_reads_leaves_no_residual(kind, arc_welder, q):
    found = equations(kind, arc_welder, q)

    r = measurement_model(arc_welder.robot).residual(arc_welder.theta, found)

    assert len(found) == len(q) * {"touch": 1, "distance": 1, "pose": 6}.get(kind, 3)
    np.testing.assert_allclose(r, 0, atol=1e-6)


def test_kinds_stand_beside_each_other_as_they_would_alone(arc_welder, q):
    tables = [measured(kind, arc_welder, q) for kind in ("touch", "pose", "distance", "position")]
    point, model = Wire(0.0, "point"), measurement_model(arc_welder.robot)
    theta = arc_welder.theta + 0.01 * arc_welder.scale

    together = model.linearize(theta, rows(point, tables, places={"pin": ANCHOR}))
    alone = [model.linearize(theta, rows(point, [table], places={"pin": ANCHOR})) for table in tables]

    for k in (0, 1):
        np.testing.assert_allclose(together[k], np.concatenate([one[k] for one in alone]), rtol=1e-12, atol=1e-12)


def test_a_turn_of_the_tool_is_seen_by_a_pose_as_a_distance_at_a_lever(arc_welder, q):
    found, model = equations("pose", arc_welder, q), measurement_model(arc_welder.robot)
    theta = arc_welder.theta.copy()
    theta[-3] += 1e-4

    r = model.residual(theta, found).reshape(len(q), 6)

    np.testing.assert_allclose(np.linalg.norm(r[:, 3:], axis=1), 100 * 1e-4, rtol=1e-3)
