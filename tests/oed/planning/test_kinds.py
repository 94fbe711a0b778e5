"""One design over several kinds: within its minutes, better than each alone, and delivered as promised."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest

from identify.estimation.calibrate import calibrate
from identify.model.cell import Device, Point
from identify.model.files import InputError
from identify.model.io.kinds_plan import readings_text
from identify.model.io.measurements import COLUMNS, READERS, joints_of, read_measurements, sigma_of
from identify.model.measurement import MEASUREMENTS, Kind, Rows
from identify.model.touch import Table
from identify.model.zone import zone_poses
from oed.candidates.kinds import POSTURES, free
from oed.planning.kinds import plan_kinds
from oed.planning.kinds_problem import kinds_problem
from probe.virtual.batch import touch_batch
from probe.virtual.truth import draw_truth

ANCHORS = {"a": Point(np.array([450.0, -50.0, 10.0])), "b": Point(np.array([-50.0, 350.0, 10.0]))}
WIRE = Device(minutes=0.2, sigma=0.02, range=(300.0, 900.0))


@pytest.fixture(scope="module")
def cell(arc_welder):
    return replace(arc_welder, points=ANCHORS, devices={"distance": WIRE})


@pytest.fixture(scope="module")
def problem(cell):
    return kinds_problem(cell, ["touch", "distance"], np.random.default_rng(0), count=500)


@pytest.fixture(scope="module")
def both(cell):
    return plan_kinds(cell, ["touch", "distance"], 10.0, rng=np.random.default_rng(0), count=500)


def test_a_plan_keeps_its_minutes(both):
    assert both.minutes == pytest.approx(0.1 * both.counts["touch"] + 0.2 * both.counts["distance"])
    assert 9.8 < both.minutes <= 10.0 + 1e-9


def test_both_kinds_promise_more_than_each_alone_in_the_same_minutes(both):
    assert both.promise.rms_mm < min(alone.rms_mm for alone in both.alone.values())
    assert both.promise.p95_mm < min(alone.p95_mm for alone in both.alone.values())


def test_more_minutes_promise_more(both):
    errors = [error for _, error in both.curve]

    assert errors == sorted(errors, reverse=True)


def test_what_no_number_of_distances_tells_is_said_with_its_number(arc_welder):
    """Two anchors leave the turn about the line that joins them to the tolerance of the base; a third fixes it."""
    bar = Device(minutes=0.15, sigma=0.005, range=(400.0, 400.0), max_tilt=np.radians(75))
    third = ANCHORS | {"c": Point(np.array([-50.0, -50.0, 10.0]))}
    cells = [replace(arc_welder, points=points, devices={"distance": bar}) for points in (ANCHORS, third)]
    two = plan_kinds(cells[0], ["distance"], 6.0, count=200)
    limit = kinds_problem(cells[1], ["distance"], np.random.default_rng(0), count=200).limit()
    turned = arc_welder.spread[3] * 200  # [mm]: the tolerance of the base at half the width of the zone

    assert two.limit.rms_mm > 0.2 * turned > 10 * limit.rms_mm
    assert two.limit.rms_mm < two.promise.rms_mm < two.limit.rms_mm / 0.7
    assert any(f"however many of these are made, {two.limit.rms_mm:.3f} mm" in note for note in two.notes)
    assert set(two.limit.names) <= {f"base.{axis}" for axis in ("x", "y", "z", "rz", "ry", "rx")}


def test_the_certificate_bounds_plans_by_chance(problem):
    design, _ = problem.design(8.0, excursions=20)
    rng = np.random.default_rng(1)

    for _ in range(20):
        share = rng.uniform()
        touches = rng.choice(500, int(80 * share), replace=False)
        distances = rng.choice(500, int(40 * (1 - share)), replace=False)
        rows = np.concatenate([problem.offers[0].of(touches), problem.offers[1].of(distances)])
        C = problem.prior.updated(rows).root(problem.tip)
        assert 1 / ((C**2).sum() / len(C)) <= design.relaxation.level * (1 + 1e-6)
    assert 0.6 < design.efficiency <= 1


def test_a_robot_that_is_measured_by_the_plan_is_as_accurate_as_promised(cell, both):
    rng = np.random.default_rng(5)
    truth = draw_truth(cell, rng, scale=0.2)
    touches, distances = both.parts
    made = touch_batch(cell, truth, touches.plan, rng)
    made = made.take(np.array(made.status) == "hit")
    tip = cell.kinematics.tip(distances.table.q, truth.theta)[0]
    places = np.array([cell.places[name] for name in distances.table.anchor])
    length = np.linalg.norm(tip - places, axis=1) + 0.02 * rng.standard_normal(len(tip))

    calibration = calibrate(cell, made, replace(distances.table, distance=length), errors="cell")

    zone = zone_poses(cell, truth.theta, 200)
    off = [cell.kinematics.tip(zone, theta)[0] for theta in (calibration.theta, truth.theta)]
    assert np.percentile(np.linalg.norm(off[0] - off[1], axis=1), 95) < both.promise.p95_mm


@pytest.mark.parametrize(
    ("kinds", "budget", "words"),
    [
        (["touhc"], 5.0, "kind 'touhc' is not known; did you mean 'touch'"),
        (["touch"], -1.0, "above 0"),
        (["touch"], 0.01, "less than the cheapest"),
        ([], 5.0, "no kind is named"),
    ],
)
def test_what_cannot_be_planned_is_refused_in_words(cell, kinds, budget, words):
    with pytest.raises(InputError, match=words):
        plan_kinds(cell, kinds, budget, count=200)


@dataclass(frozen=True, eq=False)
class Heights(Table):
    """What a dial gauge reads: z of the tip."""

    ids: tuple[str, ...]
    q: np.ndarray
    z: np.ndarray
    sigma: np.ndarray
    placement: None = None
    tool: None = None
    temperature: None = None
    payload: None = None


@pytest.fixture
def height(monkeypatch):
    """A kind that the tables did not hold, with one row in each."""

    def equation(wire, table, places):
        m = len(table)
        return Rows(table.q, np.eye(3)[[2] * m], table.z, np.zeros(m), table.sigma, table.ids, np.arange(m))

    def read(sheet, cell, trust_units):
        q = joints_of(sheet, cell.robot, trust_units)
        return Heights(tuple(sheet.text("id")), q, sheet.numbers("height_mm"), sigma_of(sheet, cell.sigma("height")))

    def make(cell, theta, at):
        z = cell.kinematics.tip(at.q, theta)[0][:, 2]
        return Heights(tuple(map(str, range(len(z)))), at.q, z, np.full(len(z), cell.sigma("height")))

    monkeypatch.setitem(MEASUREMENTS, "height", Kind(Heights, equation, ("height_mm",), "a gauge", "read the gauge"))
    monkeypatch.setitem(COLUMNS, "height", ("height_mm",))
    monkeypatch.setitem(READERS, "height", read)
    monkeypatch.setitem(POSTURES, "height", (partial(free, kind="height"), make))


def test_a_kind_added_to_the_tables_is_planned_read_and_used(height, arc_welder, tmp_path):
    plan, file = plan_kinds(arc_welder, ["height"], 10.0, count=200), tmp_path / "heights.csv"
    head, *lines = readings_text(plan.parts, arc_welder.robot).splitlines()
    filled = [f"{line}{z:.4f}" for line, z in zip(lines, plan.parts[0].table.z, strict=True)]
    file.write_text("\n".join([head, *filled, ""]))

    (table,) = read_measurements(file, arc_welder)
    found = calibrate(arc_welder, table, folds=0, errors="cell")

    assert isinstance(table, Heights)
    assert found.sigma[2] < 0.9 * arc_welder.spread[2]
    assert found.theta == pytest.approx(arc_welder.theta, abs=1e-3)  # nominal readings
    file.write_text("\n".join([head, f"{lines[0]}abc", ""]))
    with pytest.raises(InputError, match="height_mm is 'abc', expected a number"):
        read_measurements(file, arc_welder)
