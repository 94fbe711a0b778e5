"""Candidates of several kinds: their rows stand by kind and measurement, and more of them promise more."""

from dataclasses import replace

import numpy as np
import pytest

from identify.model.cell import Device
from identify.model.files import InputError
from identify.model.measurement import MEASUREMENTS
from oed.planning.kinds_problem import kinds_problem

pytestmark = pytest.mark.xdist_group("kinds problem")


@pytest.fixture(scope="module")
def problem(arc_welder):
    cell = replace(arc_welder, devices={"position": Device(minutes=0.2, sigma=0.05)})
    return kinds_problem(cell, ["position", "pose"], np.random.default_rng(0), count=120)


def test_every_candidate_has_the_rows_of_its_kind(problem):
    for offer in problem.offers:
        assert set(np.bincount(offer.owner)) == {MEASUREMENTS[offer.kind].equations}
        assert len(offer.of(np.array([0, 2]))) == 2 * MEASUREMENTS[offer.kind].equations
    assert len(problem.rows) == sum(len(offer.rows) for offer in problem.offers)


def test_one_kind_alone_is_part_of_all(problem):
    (offer,) = problem.only("pose").offers

    np.testing.assert_array_equal(problem.rows[-len(offer.rows) :], offer.rows)


def test_a_design_keeps_its_minutes_and_promises_more_for_more(problem):
    promised = []
    for minutes in (2.0, 4.0):
        design, chosen = problem.design(minutes, rng=np.random.default_rng(0), excursions=1)
        spent = sum(len(index) * offer.minutes for index, offer in zip(chosen, problem.offers, strict=True))
        assert spent == pytest.approx(design.cost)
        assert spent <= minutes + 1e-9
        promised.append(problem.promised(chosen).rms_mm)

    assert promised[1] < promised[0]


def test_no_minutes_are_refused(problem):
    with pytest.raises(InputError, match=r"no plan for 0.01 minutes"):
        problem.design(0.01)


@pytest.mark.parametrize("part", ["base", "tool"])
def test_a_part_that_is_to_be_fitted_cannot_be_planned_for(arc_welder, part):
    with pytest.raises(InputError, match=f"{part}: fit leaves open where the {part} stands"):
        kinds_problem(replace(arc_welder, **{part: None}), ["position"], np.random.default_rng(0))
