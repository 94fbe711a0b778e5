"""Schedules of the hostile bench: 300 here, thousands by `python -m tests.probe.hostile`; and the judge on trial."""

from pathlib import Path

import numpy as np
import pytest
from hostile import BACKENDS, Bench
from hostile_defects import DEFECTS
from true_world import Chain

COUNT = {"line": 160, "grbl": 40, "linuxcnc": 100}  # a schedule over GRBL polls most, and takes longest


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench()


@pytest.mark.parametrize("backend", BACKENDS)
def test_no_schedule_makes_a_wrong_touch_or_a_wrong_motion(bench: Bench, backend: str) -> None:
    broken = {seed: bench.violations(seed, backend) for seed in range(COUNT[backend])}

    assert {seed: texts for seed, texts in broken.items() if texts} == {}


REPLAYED = {
    "a motion that GRBL held, its reset lost on the line, kept every later run out": ("grbl", 141),
    "a GRBL that started anew just before a motion had forgotten its target": ("grbl", 445),
    "so had one that started anew once its target was read back": ("grbl", 4908),
    "and one in contact, whose retract then led elsewhere": ("grbl", 5887),
    "and one before a search": ("grbl", 7408),
    "and one between two touches": ("grbl", 9730),
    "a motion slowed down for the watch, and asked about often, was taken for a robot that stands": ("grbl", 4411),
    "a motion was over for the driver whose wait was spoiled, where the first reports of a motion say Idle": (
        "grbl",
        2,
    ),
    "a search five times too fast, whose reports all said Idle, gave a touch": ("grbl", 1324),
    "a motion cut short on the line went where the rest of it said": ("grbl", 1071),
    "a motion astray was not watched while its reports still said Idle": ("grbl", 1130),
    "one lost byte let a robot go on for a millimetre that was to be held": ("grbl", 5065),
    "a second Ctrl-C ended the stop while the robot still slowed down": ("grbl", 2175),
    "a move that ended early where it began left no motion that was accepted": ("line", 995),
    "so did the first look at a robot whose input stuck": ("line", 1176),
}


@pytest.mark.parametrize("defect", REPLAYED)
def test_a_defect_that_a_schedule_has_shown_is_gone(bench: Bench, defect: str) -> None:
    backend, seed = REPLAYED[defect]

    assert bench.violations(seed, backend) == []


@pytest.mark.parametrize("name", DEFECTS)
def test_the_judge_sees_a_defect_that_is_planted_in_the_driver(bench: Bench, name: str) -> None:
    defect = DEFECTS[name]

    assert bench.violations(defect.seed, defect.backend) == []
    with defect.plant():
        found = bench.violations(defect.seed, defect.backend)

    assert any(defect.verdict in text.partition(" (after")[0] for text in found), found


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_seed_gives_the_same_schedule_whatever_ran_before(bench: Bench, backend: str) -> None:
    first, _, again = bench.trial(12, backend), bench.trial(5, backend), bench.trial(12, backend)
    alone = Bench().trial(12, backend)

    for other in (again, alone):
        assert other.schedule.happened == first.schedule.happened
        assert other.journal == first.journal
        assert [(m.began, m.ended) for m in other.world.record] == [(m.began, m.ended) for m in first.world.record]
        assert all(np.array_equal(a.end, b.end) for a, b in zip(other.world.record, first.world.record, strict=True))


def test_the_judge_reckons_the_tip_as_the_model_does_in_its_own_way(bench: Bench, rng: np.random.Generator) -> None:
    q = rng.uniform(-1.0, 1.0, (20, 6))

    assert np.abs(Chain(bench.cell, bench.theta).tip(q) - bench.cell.kinematics.tip(q, bench.theta)[0]).max() < 1e-9


def test_the_command_replays_a_seed_alone() -> None:
    import subprocess
    import sys

    words = [sys.executable, "-m", "tests.probe.hostile", "--backend", "line", "--seed", "3"]

    done = subprocess.run(words, cwd=Path(__file__).parents[3], capture_output=True, text=True, check=False)

    assert (done.returncode, done.stdout.partition(",")[0]) == (0, "line: 0 of 1 schedules broken")
