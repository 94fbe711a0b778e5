"""Ways of the driver, judged by another code path: random skips, resumes at random touches, plans in random order."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from identify.model.cell import DEG, Cell, Priors, Zone
from identify.model.io.description import library, read_cell, read_jig
from identify.model.shape import Shape
from identify.model.urdf.chain import read_urdf
from oed.candidates.candidates import candidates
from oed.planning.plan import plan
from probe.motion.room import Room

pytest.importorskip("coal")
from coal_check import CoalCheck

MOST = 3  # touches of a face
WAYS = 25  # of each cell and of each of three beliefs: 300 in all
PRIORS = Priors((3.0, 0.5 * DEG), (3.0, 1 * DEG), (1.0, 0.3 * DEG))
ARMS = {  # URDF, flange, jig, base x, y, z, and tool x, z, ry
    "m10ia": ("fanuc_m10ia_support/urdf/m10ia.urdf", "u-fixture", (200, 1100, -150), (40, 350, 22)),
    "kr5": ("kuka_kr5_support/urdf/kr5_arc.urdf", "cube150", (75, 1025, -100), (60, 360, 35)),
}


def arm(name: str, data: Path) -> Cell:
    """An arm of the shop with its meshes before a jig."""
    urdf, jig, (x, y, z), (tx, tz, ry) = ARMS[name]
    return Cell(
        read_urdf(data / "robots" / urdf, "base_link", "tool0"),
        read_jig(data / "jigs" / f"{jig}.yaml"),
        np.array([x, y, z, -90 * DEG, 0, 0]),
        np.array([tx, 0, tz, 0, ry * DEG, 0]),
        zone=Zone(np.array([[0.0, 200.0], [0.0, 200.0], [0.0, 200.0]]), 60 * DEG),
        priors=PRIORS,
    )


def leaning(cell: Cell) -> Cell:
    """The cell with a plate that leans over its jig, and a post beside it."""
    T, U = np.eye(4), np.eye(4)
    c, s = np.cos(0.5), np.sin(0.5)
    T[:3, :3], T[:3, 3] = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), (150, -120, 260)
    U[:3, 3] = (460, 150, 120)
    return replace(
        cell, obstacles=(Shape(0, "plate", "box", (200, 80, 12), T), Shape(0, "post", "cylinder", (25, 240), U))
    )


@pytest.fixture(params=["library", "leaning", *ARMS])
def cell(request: pytest.FixtureRequest) -> Cell:
    if request.param in ARMS:
        return arm(request.param, request.getfixturevalue("shared_data"))
    cell = read_cell(library("cells")["arc-welder"])
    return leaning(cell) if request.param == "leaning" else cell


def test_no_way_of_the_driver_hits_jig_table_or_obstacles_by_a_judge_of_its_own(cell: Cell, rng) -> None:
    touches = candidates(cell, rng, 40)
    room, check = Room(cell, list(touches.approach)), CoalCheck(cell)
    hits = []
    for share in (1.0, 1e-2, 1e-4):  # of the tolerances' variance, before and after touches
        room.believe(cell.theta, share * np.diag(cell.spread**2))
        ways = 0
        while ways < WAYS:
            a, b = rng.choice(len(touches), 2, replace=False)  # skipped, resumed or shuffled: any touch after any other
            route = room.route(touches.approach[a], touches.approach[b])
            legs = zip([touches.approach[a], *route], route, strict=False)
            hits += [(a, b, hit) for start, end in legs if (hit := check.way(start, end))]
            ways += bool(route)

    assert hits == []


def test_a_plan_has_no_violation_by_a_judge_of_its_own(cell: Cell, rng) -> None:
    check, faces = CoalCheck(cell), cell.the_jig.faces
    touches = candidates(cell, rng, 500)
    some = np.concatenate([np.flatnonzero(touches.face == i)[:MOST] for i in range(len(faces))])  # a ramp's with them
    made = plan(cell, 8, strategy="even", count=500).plan

    wrong = [why for i in some for why in check.touch(faces[touches.face[i]], touches.q[i], touches.approach[i])]
    for i, name in enumerate(made.face):
        wrong += check.touch(cell.the_jig.by_name[name], made.q[i], made.approach[i])
        way = np.vstack([made.approach[i - 1 : i], made.way(i)]) if i else made.approach[:1]
        wrong += [hit for a, b in pairwise(way) if (hit := check.way(a, b, 0.03))]

    assert len(some) >= 3 * MOST
    assert wrong == []


def test_the_judge_of_its_own_sees_what_is_wrong_with_a_touch(rng) -> None:
    cell = read_cell(library("cells")["arc-welder"])
    touches, check = candidates(cell, rng, 5), CoalCheck(cell)
    face, q, approach = touches.faces[touches.face[0]], touches.q[0], touches.approach[0]
    deeper, straighter = approach + 1.2 * (q - approach), replace(cell, touch=replace(cell.touch, max_tilt=0.0))

    assert check.touch(face, q, approach) == []
    assert any("off its face" in why for why in check.touch(face, deeper, approach))
    assert any(" at " in why for why in check.touch(face, approach, deeper))
    assert "leans too far" in CoalCheck(straighter).touch(face, q, approach)
    assert "beyond the limits" in check.touch(face, q, approach + 7)


def test_the_judge_of_its_own_sees_what_straight_ways_would_hit(rng) -> None:
    cell = read_cell(library("cells")["arc-welder"])
    touches, check = candidates(cell, rng, 30), CoalCheck(cell)

    straight = [check.way(a, b, 0.05) for a, b in zip(touches.approach[:-1], touches.approach[1:], strict=True)]

    assert sum(map(bool, straight)) >= 5
