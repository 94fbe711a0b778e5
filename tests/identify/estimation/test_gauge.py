"""What is a choice of frame stays where it is, and lengths that nothing measures are refused."""

from dataclasses import replace

import numpy as np
import pytest

from identify.estimation.calibrate import calibrate
from identify.estimation.verdict import refusals, with_promise
from identify.model.cell import Point, Spacing
from identify.model.files import InputError
from identify.model.frames import inverse, pose, transform
from identify.model.ik import reach
from identify.model.touch import Contacts
from identify.model.zone import Zone
from identify.uncertainty.unknowns import Unknowns

HOLES = {"hole_0": np.array([60.0, 120.0, 150.0]), "hole_1": np.array([60.0, 170.0, 150.0])}
SPREAD = 0.03  # of the priors, by which the hidden robot is off


@pytest.fixture(scope="module")
def hidden(arc_welder):
    """A robot off by a part of its tolerances."""
    rng = np.random.default_rng(3)
    return arc_welder.theta + SPREAD * arc_welder.scale * rng.standard_normal(len(arc_welder.theta))


def contacts(cell, theta, stand, m=40, seed=4, holes=HOLES):
    """Postures that a robot which stands there takes with its tip in sockets, one after the other."""
    rng = np.random.default_rng(seed)
    true = theta.copy()
    true[:6] = stand
    names = tuple(list(holes)[k % len(holes)] for k in range(m))
    point = np.stack([holes[name] for name in names])
    q = rng.uniform(cell.robot.lower, cell.robot.upper, (m, 6)) / 3
    R = cell.kinematics.tip(q, true)[1]
    found = reach(cell.kinematics, true, point, R, q, free_roll=True)
    good = found.reached()
    ids = tuple(str(k) for k in range(good.sum()))
    held = tuple(name for name, ok in zip(names, good, strict=True) if ok)
    return Contacts(ids, found.q[good], held, np.full(good.sum(), 0.02), ("table",) * int(good.sum()))


@pytest.fixture(scope="module")
def measured(arc_welder, hidden):
    return contacts(arc_welder, hidden, hidden[:6], 80)


@pytest.fixture(scope="module")
def cell(arc_welder):
    return replace(
        arc_welder,
        placements={"table": None},
        points=dict.fromkeys(HOLES, Point(None)),
        spacings=(Spacing("hole_0", "hole_1", 50.0),),
        zone=None,
    )


@pytest.fixture(scope="module")
def found(cell, measured):
    return calibrate(cell, measured, folds=0, errors="cell")


def test_the_sockets_end_at_their_spacing_and_the_tips_in_them(found, cell, measured):
    value = {shared.name: shared.value for shared in found.shared}
    holes = [np.array([value[f"point.{name}.{axis}"] for axis in "xyz"]) for name in HOLES]
    tip = cell.kinematics.tip(measured.q, found.theta)[0]

    assert np.linalg.norm(holes[1] - holes[0]) == pytest.approx(50.0, abs=0.06)
    for name in HOLES:
        here = tip[[n == name for n in measured.point]]
        assert np.linalg.norm(here - here.mean(axis=0), axis=1).mean() < 0.05


def test_a_choice_of_frame_is_said_in_words(found):
    (finding,) = [finding for finding in found.findings if finding.kind == "frame"]

    assert finding.text.startswith("6 directions of placement.table, point.hole_0, point.hole_1")
    assert "choice of frame" in finding.text


def test_without_a_known_length_the_identification_is_refused(cell, measured):
    with pytest.raises(InputError, match="no length is known among what was measured"):
        calibrate(replace(cell, spacings=()), measured, folds=0, errors="cell")


def test_a_placement_that_nobody_measured_is_named(cell, measured):
    further = replace(cell, placements=cell.placements | {"shelf": None})

    with pytest.raises(InputError, match="placement 'shelf' was not measured"):
        calibrate(further, measured, folds=0, errors="cell")


def test_the_unknowns_of_sockets_have_no_prior(cell):
    unknowns = Unknowns.of(cell)

    assert unknowns.precision[-12:].tolist() == [0.0] * 12


def test_a_placement_is_found_by_known_sockets_as_surely_as_is_said(arc_welder, hidden):
    shift = np.array([30.0, -20.0, 10.0, 0.1, 0.05, -0.05])
    second = pose(inverse(transform(shift)) @ transform(hidden[:6]))
    holes = {**HOLES, "hole_2": np.array([120.0, 120.0, 150.0])}
    points = {name: Point(place) for name, place in holes.items()}
    cell = replace(arc_welder, placements={"table": None}, points=points, zone=None)

    found = calibrate(cell, contacts(arc_welder, hidden, second, 90, 1, holes), folds=0, errors="cell")

    names = [f"placement.table.{axis}" for axis in ("x", "y", "z", "rz", "ry", "rx")]
    index = [found.names.index(name) for name in names]
    off = found.values[index] - second
    C = found.joint_covariance[np.ix_(index, index)]
    assert off @ np.linalg.solve(C, off) < 22.5  # chi-square of six, one in a thousand
    assert np.sqrt(np.diag(C))[:3].max() < 15


def test_a_frame_that_hangs_on_the_tolerance_of_the_base_is_named_before_more_measurements(cell, measured):
    zone = Zone(np.array([[0.0, 200.0], [0.0, 200.0], [100.0, 250.0]]))
    narrow = replace(cell.priors, base=(0.01, np.radians(0.001)))
    cells = [replace(cell, zone=zone), replace(cell, zone=zone, priors=narrow)]
    wide, firm = (with_promise(calibrate(one, measured, folds=0, errors="cell")) for one in cells)

    assert "let the base define the frame" in " ".join(refusals(wide))
    assert "make more touches" in " ".join(refusals(firm))
