"""The accuracy ladder in the report names every way with its numbers."""

from identify.compensation.ladder import FRAMES, MODEL, ZEROS, Rung
from identify.model.io.calibration_file import Errors
from identify.report.ladder import ways

SIZES = {"nothing": (4.5, 6.75), ZEROS: (1.5, 3.25), FRAMES: (0.75, 1.125), MODEL: (0.062, 0.125)}  # mean, 95 % [mm]
RUNGS = [Rung(way, Errors(100, mean, mean, p95, 2 * p95)) for way, (mean, p95) in SIZES.items()]


def test_every_way_has_a_row_and_a_bar():
    section = ways(RUNGS)

    for rung in RUNGS:
        assert f"{rung.way}</td>" in section
        assert f"{rung.errors.p95_mm:.3f}</td>" in section
        assert f"{rung.way}: 95 % below {rung.errors.p95_mm:.3f} mm" in section


def test_there_is_no_section_where_nothing_is_predicted():
    assert ways(()) == ""
