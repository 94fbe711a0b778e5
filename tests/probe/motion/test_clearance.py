"""Distances are judged by points sampled densely along capsules; postures by drawings simple enough to see through."""

from dataclasses import replace

import numpy as np
import pytest
from cells import PLACES, cell_of
from drawings import balls

from identify.model.cell import DEG
from identify.model.io.description import library, read_robot
from identify.model.jig import Box, Face, Jig
from oed.candidates.candidates import candidates
from probe.motion.clearance import CLEAR, Clearance
from probe.motion.obstacles import obstacles, owners


@pytest.mark.parametrize("robot", PLACES)
def test_gaps_are_those_of_points_sampled_along_the_capsules(robot, rng):
    cell = cell_of(robot)
    clearance = Clearance(cell, cell.theta)
    q = rng.uniform(cell.robot.lower, cell.robot.upper, (15, len(cell.robot.joints)))

    outside, inside = clearance.gaps(q)

    for row, out, own in zip(q, outside, inside, strict=True):
        along = balls(cell, clearance.capsules, row)
        moving = [(p, c.radius) for p, c in zip(along, clearance.capsules, strict=True) if c.link]
        boxes = [(np.array(b.lower), np.array(b.upper)) for b in cell.jig.boxes]
        gaps = [
            np.linalg.norm(np.maximum(np.maximum(lo - p, p - hi), 0), axis=1).min() - radius
            for p, radius in moving
            for lo, hi in boxes
        ]
        assert out == pytest.approx(min(gaps), abs=0.1)
        between = [
            np.linalg.norm(along[i][:, None] - along[j], axis=2).min()
            - clearance.capsules[i].radius
            - clearance.capsules[j].radius
            for i, j in clearance.pairs
        ]
        assert own == pytest.approx(min(between), abs=0.1)


def test_hits_name_what_is_too_near(rng):
    cell = cell_of("arc-welder")
    clearance = Clearance(cell, cell.theta)
    q = rng.uniform(cell.robot.lower, cell.robot.upper, (3000, 6))

    hit = clearance.hits(q, margin=7.0)

    outside, inside = clearance.gaps(q)
    np.testing.assert_array_equal(hit == CLEAR, (outside >= 7) & (inside >= 7))
    np.testing.assert_array_equal(hit == len(clearance.solids), (outside >= 7) & (inside < 7))  # obstacles come first
    table = [s.upper[2] == 0 for s in clearance.solids].index(True)
    assert {0, 1, table} <= set(hit.tolist())


def test_a_face_belongs_to_the_box_whose_surface_it_lies_on():
    jig = cell_of("arc-welder").jig

    own = owners(jig, obstacles(jig))

    names = [face.name for face in jig.faces]
    low, high, table = own.T
    assert {n for n, o in zip(names, low, strict=True) if o} == {
        "top-low",
        "top-side",
        "front-low",
        "back-low",
        "right-low",
        "left-low",
    }
    assert {n for n, o in zip(names, high, strict=True) if o} == {
        "top-high",
        "front-high",
        "back-high",
        "right-high",
        "left-high",
    }
    assert not table.any()


def test_a_jig_without_boxes_is_kept_clear_of_by_its_faces():
    slope = Face("slope", np.array([0.0, 0, 100]), np.array([100.0, 0, 100]), np.array([0.0, 200, 0]))
    flat = Face("flat", np.array([-100.0, 0, 100]), np.array([100.0, 0, 0]), np.array([0.0, 200, 0]))
    jig = Jig("bent", (slope, flat))

    plates = obstacles(jig)

    middle = slope.origin + slope.u / 2 + slope.v / 2
    off = (middle + 30 * slope.normal)[:, None]
    assert plates[0].point(off) == pytest.approx(30)
    assert plates[0].segment(off, off + 50 * slope.normal[:, None]) == pytest.approx(30)
    np.testing.assert_array_equal(owners(jig, plates), np.eye(2, dtype=bool))


def test_without_a_jig_the_arm_has_only_itself_to_hit(rng):
    cell = replace(cell_of("arc-welder"), jig=None)
    q = rng.uniform(cell.robot.lower, cell.robot.upper, (50, 6))

    outside, inside = Clearance(cell, cell.theta).gaps(q)

    assert np.isinf(outside).all()
    assert np.isfinite(inside).all()


def test_what_stands_still_may_stand_in_the_table():
    cell = cell_of("arc-welder")
    deep = replace(cell, jig=replace_boxes(cell.jig, Box((-1000.0, -1000.0, -50.0), (1000.0, 1000.0, 0.0))))
    upright = np.array([[0, -90, 0, 0, 0, 0]]) * DEG

    outside, _ = Clearance(deep, deep.theta).gaps(upright)

    assert any(c.link == 0 for c in read_robot(library("robots")["arc-welder"]).capsules)
    assert outside[0] > 100


def replace_boxes(jig: Jig, *boxes: Box) -> Jig:
    return Jig(jig.name, jig.faces, boxes)


def test_a_torch_that_was_found_shorter_than_drawn_can_still_touch(arc_welder):
    theta = arc_welder.theta.copy()
    theta[-4] -= 25.0  # more than the wire sticks out

    found = candidates(arc_welder, np.random.default_rng(0), 300, theta=theta, root=np.zeros((len(theta), 1)))

    assert len(found) == 300
