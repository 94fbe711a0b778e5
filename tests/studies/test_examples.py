"""The examples run, stay short, and do what they say."""

import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

from identify.model.joint_error_models import ERROR_MODELS
from identify.model.measurement import MEASUREMENTS
from oed.criteria.criteria import CRITERIA
from probe.controllers import PROTOCOLS

EXAMPLES = sorted(Path(__file__).parents[2].joinpath("studies", "examples").glob("*[a-z].py"))
NUMBER = re.compile(r"[+-]?\d+\.?\d*")


@pytest.fixture
def ran(capsys):
    """Numbers that an example prints, a list a line; what it adds to the tables is taken out again."""
    before = [(table, dict(table)) for table in (CRITERIA, ERROR_MODELS, MEASUREMENTS, PROTOCOLS)]

    def run(name):
        module = import_module(f"studies.examples.{name}")
        getattr(module, "main", lambda: None)()
        return [[float(x) for x in NUMBER.findall(line)] for line in capsys.readouterr().out.splitlines()]

    yield run
    for module in [module for module in sys.modules if module.startswith("studies.examples.")]:
        del sys.modules[module]
    for table, rows in before:
        table.clear()
        table.update(rows)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_shorter_than_forty_lines(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) < 40


def test_a_plan_in_a_notebook_makes_a_robot_accurate_that_was_not(ran):
    *_, (before, after) = ran("plan_notebook")

    assert after < 0.2 < before  # [mm]


def test_a_criterion_of_ones_own_is_best_for_its_own_plan(ran):
    (_, _, own, _, promise_of_own), (_, by_v, _, promise_of_v) = ([*row] for row in ran("own_criterion"))

    assert own > by_v
    assert promise_of_v < promise_of_own


def test_a_joint_error_of_ones_own_is_identified_within_its_interval(ran):
    for *_, true, identified, sigma in ran("own_joint_error"):
        assert abs(true - identified) < 3 * sigma


def test_a_measurement_of_ones_own_adds_to_touches(ran):
    (touches, without), (both, with_heights) = ran("own_measurement")

    assert both > touches
    assert with_heights < without


def test_a_controller_of_ones_own_makes_touches(ran):
    assert ran("own_controller") == [[3, 3]]
