"""What changes while touches are made: each planted change is estimated, and sound touches are not accused."""

from dataclasses import replace

import numpy as np
import pytest
from findings import SIGMA, TOUCHES, findings
from measured import table_2, touches_at

from identify.model.measurement import measurement_model, rows


def shifted(touches, cell, theta_of):
    """The same touches by a robot whose parameters change from touch to touch."""
    model, planes = measurement_model(cell.robot), rows(cell.wire, [touches])
    was = model.residual(theta_of(0), planes)
    now = np.array([model.residual(theta_of(i), planes.take(np.array([i])))[0] for i in range(len(touches))])
    return replace(touches, offset=touches.offset + now - was)


def cut(theta, change):
    """The tool of a wire that is longer."""
    from identify.model.frames import rotation

    longer = theta.copy()
    longer[-6:-3] += change * rotation(*theta[-3:])[:, 2]
    return longer


@pytest.mark.parametrize("seed", range(6))
def test_sound_touches_are_not_accused(seed, arc_welder, touch_poses):
    touches = touches_at(arc_welder, table_2(arc_welder), touch_poses, np.random.default_rng(seed), SIGMA)

    assert findings(arc_welder, touches).keys() <= {"outliers"}


@pytest.mark.parametrize(("at", "change"), [(40, 0.3), (60, 0.3), (90, -0.3), (50, -2.0)])
def test_a_wire_that_changed_its_stick_out_is_found_and_the_touch_named(at, change, arc_welder, touch_poses, rng):
    theta = table_2(arc_welder)
    sound = touches_at(arc_welder, theta, touch_poses, rng, SIGMA)
    touches = shifted(sound, arc_welder, lambda i: cut(theta, change) if i >= at else theta)

    found = findings(arc_welder, touches)

    named = found["stick-out changed"].ids  # the best, and those that a touch across the wire leaves open
    assert touches.ids[at] in named
    assert len(named) <= 3
    told = float(found["stick-out changed"].text.split("wire is ")[1].split()[0])
    assert told == pytest.approx(abs(change), abs=0.08)
    assert ("longer" if change > 0 else "shorter") in found["stick-out changed"].text
    assert found.keys() <= {"stick-out changed", "outliers"}


def test_a_jig_that_moves_is_called_drift_with_its_way(arc_welder, touch_poses, rng):
    theta = table_2(arc_welder)
    moved = theta.copy()
    moved[2] += 0.4  # the robot rises against the jig
    sound = touches_at(arc_welder, theta, touch_poses, rng, SIGMA)
    touches = shifted(sound, arc_welder, lambda i: theta + i / (TOUCHES - 1) * (moved - theta))
    times = tuple(f"2026-01-01T10:{i // 2:02d}:{30 * (i % 2):02d}Z" for i in range(TOUCHES))

    found = findings(arc_welder, replace(touches, time=times))

    assert found.keys() <= {"drift", "outliers"}
    way = found["drift"].text.split("(")[1].split(")")[0]
    assert float(way.split("z ")[1].split()[0]) == pytest.approx(0.4, abs=0.08)
    assert "60 minutes" in found["drift"].text
