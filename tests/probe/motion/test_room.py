"""Ways of the driver, judged by another code path: random skips, resumes at random touches, plans in random order."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identify.model.cell import DEG, Cell, Priors, Zone
from identify.model.io.description import library, read_cell, read_jig
from identify.model.shape import Shape
from identify.model.urdf.chain import read_urdf
from oed.candidates.candidates import candidates
from probe.motion.room import Room

pytest.importorskip("coal")
from coal_check import CoalCheck

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


def test_the_judge_of_its_own_sees_what_straight_ways_would_hit(rng) -> None:
    cell = read_cell(library("cells")["arc-welder"])
    touches, check = candidates(cell, rng, 30), CoalCheck(cell)

    straight = [check.way(a, b, 0.05) for a, b in zip(touches.approach[:-1], touches.approach[1:], strict=True)]

    assert sum(map(bool, straight)) >= 5
