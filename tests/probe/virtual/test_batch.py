"""All touches of a plan at once: what comes out fits the hidden truth, and nothing else."""

import numpy as np
import pytest
from virtual_support import make_plan, with_effects

from identify.model.cell import Cell
from identify.model.measurement import measurement_model, rows
from identify.model.touch import Plan, Touches
from probe.virtual.batch import search_end, touch_batch
from probe.virtual.truth import Truth, read_truth, truth_path


@pytest.fixture(scope="module")
def table2(arc_welder: Cell) -> Truth:
    return read_truth(truth_path("library:arc-welder"), arc_welder)


@pytest.fixture(scope="module")
def plan(arc_welder: Cell) -> Plan:
    return make_plan(arc_welder, 80)


def gaps(cell: Cell, theta: np.ndarray, touches: Touches) -> np.ndarray:
    """Distance of the end of a flat wire from the plane of each touch [mm]."""
    position, R = cell.kinematics.tip(touches.q, theta)
    along = np.einsum("ij,ij->i", touches.normal, R[:, :, 2])
    return np.einsum("ij,ij->i", touches.normal, position) - touches.offset - cell.wire.radius * np.sqrt(1 - along**2)


def hits(touches: Touches) -> Touches:
    return touches.take(np.array(touches.status) == "hit")


def test_without_noise_every_hit_lies_on_its_face_for_the_true_robot_alone(arc_welder, table2, plan, rng):
    touches = hits(touch_batch(arc_welder, table2, plan, rng, sigma=0.0))

    assert len(touches) > 50
    assert np.abs(gaps(arc_welder, table2.theta, touches)).max() < 1e-6
    assert np.sqrt(np.mean(gaps(arc_welder, arc_welder.theta, touches) ** 2)) > 5


def test_hits_scatter_along_the_normal_by_the_sigma_asked_for(arc_welder, table2, plan, rng):
    drawn = [hits(touch_batch(arc_welder, table2, plan, rng, sigma=0.2)) for _ in range(20)]

    scatter = np.concatenate([gaps(arc_welder, table2.theta, touches) for touches in drawn])
    assert np.std(scatter) == pytest.approx(0.2, rel=0.06)  # 1400 draws: 2 % is one sigma
    assert abs(np.mean(scatter)) < 4 * 0.2 / np.sqrt(len(scatter))


def test_the_nominal_robot_touches_where_the_plan_says(arc_welder, plan, rng):
    touches = touch_batch(arc_welder, Truth(arc_welder.theta), plan, rng, sigma=0.0)

    assert set(touches.status) == {"hit"}
    assert np.abs(touches.q - plan.q).max() < 1e-7


def test_a_late_relay_carries_every_latch_beyond_the_face_by_delay_times_speed(arc_welder, plan, rng):
    slow = with_effects(Truth(arc_welder.theta), relay_delay=0.01)

    depth = -gaps(arc_welder, arc_welder.theta, touch_batch(arc_welder, slow, plan, rng, sigma=0.0, timing=True))

    late = arc_welder.touch.speed * np.array([0.01, 0.011])  # delay, and delay with one servo period
    assert depth.max() < late[1] * 1.001
    assert np.median(depth) == pytest.approx(late.mean(), rel=0.05)


def test_a_wire_cut_after_forty_touches_shortens_the_tool_from_the_forty_first_on(arc_welder, plan, rng):
    cut = with_effects(Truth(arc_welder.theta), wire=((40, -2.0),))

    touches = touch_batch(arc_welder, cut, plan, rng, sigma=0.0)

    off = np.abs(gaps(arc_welder, arc_welder.theta, touches))
    assert off[:40].max() < 1e-6
    assert off[40:].min() > 1.0  # 2 mm along the wire, seen at 40 degrees of tilt or less


def test_searches_end_at_the_travel_or_at_a_joint_limit(arc_welder, plan):
    end = search_end(arc_welder, plan)

    reach = (end - plan.approach) / (plan.q - plan.approach)
    assert np.nanmax(reach) == pytest.approx(arc_welder.touch.travel / arc_welder.touch.approach)
    assert (end <= arc_welder.robot.upper + 1e-12).all()
    assert (end >= arc_welder.robot.lower - 1e-12).all()


@pytest.fixture(scope="module")
def bending(tmp_path_factory, arc_welder):
    """A true robot that bends, turns unevenly and grows, where the cell knows of no such thing."""
    path = tmp_path_factory.mktemp("truth") / "truth.yaml"
    path.write_text(
        "errors: [harmonics, compliance, thermal]\n"
        "parameters: {j2.cos1: 0.05, j3.sag4: 0.2, j2.growth: 30, j4.growth: 30}\n"
        "effects: {warming: [{touch: 0, temperature_c: 20}, {touch: 60, temperature_c: 40}]}\n"
    )
    return read_truth(path, arc_welder)


def test_a_robot_may_truly_have_errors_that_its_cell_knows_nothing_of(arc_welder, bending, plan, rng):
    touches = hits(touch_batch(arc_welder, bending, plan, rng, sigma=0.0))

    geometric = gaps(arc_welder, arc_welder.theta, touches)
    true = rows(arc_welder.wire, [touches], bending.robot)
    assert np.sqrt(np.mean(geometric**2)) > 0.3
    off = measurement_model(bending.robot).residual(bending.theta, true)
    assert np.abs(off).max() < 0.01  # [mm]: the directions are recorded, temperatures too
    assert touches.temperature.max() > 35
