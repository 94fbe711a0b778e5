"""Joint errors that the touches chose, and faults that residuals give away, stand in the report."""

import pytest
from identified import identified

from identify.model.io.calibration_file import Finding, Term
from identify.report.findings import chosen, findings


@pytest.fixture
def calibration(arc_welder):
    return identified(
        arc_welder,
        arc_welder.theta,
        choice=(Term("compliance", 0.08, 0.17, 0.006, True), Term("gear", 0.0801, -0.0001, 0.0004, False)),
        findings=(Finding("drift", "the tip moves by <1> mm"), Finding("outliers", "one", ("t1",))),
    )


def test_geometry_alone_leaves_what_the_first_model_leaves_and_what_it_buys(calibration):
    text = chosen(calibration)

    assert "geometry alone" in text
    assert "0.250" in text  # 0.08 + 0.17
    assert text.count("kept") == 1


def test_a_fault_is_escaped_and_outliers_have_a_table_of_their_own(calibration):
    assert findings(calibration) == "<ul><li><b>drift</b>: the tip moves by &lt;1&gt; mm</li></ul>"


def test_nothing_is_said_where_nothing_was_chosen_or_given_away(arc_welder):
    plain = identified(arc_welder, arc_welder.theta)

    assert chosen(plain) == ""
    assert findings(plain) == ""
