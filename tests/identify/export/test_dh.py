"""A table of four parameters is off by what it says."""

import csv

import numpy as np
import pytest
from exported import MICRO, cell_of, draws, wrong
from identified import identified
from oracle import forward
from scipy.spatial.transform import Rotation

from identify.export.exporting import export
from identify.model.frames import transform
from identify.model.io.description import library, read_robot


def dh_forward(files, q):
    """Rz(theta) Tz(d) Tx(a) Rx(alpha), one after the other, between the two frames: a reader of its own."""
    frames = {}
    for row in csv.DictReader(files["_frames.csv"].splitlines()):
        frames[row["frame"]] = transform(
            np.array(
                [
                    *(float(row[f"{k}_mm"]) for k in "xyz"),
                    *(np.radians(float(row[f"{k}_deg"])) for k in ("rz", "ry", "rx")),
                ]
            )
        )
    T = frames["jig_to_first"]
    for row, value in zip(csv.DictReader(files[".csv"].splitlines()), q, strict=True):
        theta, d = np.radians(float(row["theta_deg"])), float(row["d_mm"])
        theta, d = (theta, d + value) if row["type"] == "prismatic" else (theta + value, d)
        step = np.eye(4)
        step[:3, :3] = Rotation.from_euler("ZX", [theta, np.radians(float(row["alpha_deg"]))]).as_matrix()
        step[:3, 3] = [float(row["a_mm"]) * np.cos(theta), float(row["a_mm"]) * np.sin(theta), d]
        T = T @ step
    return T @ frames["last_to_tip"]


@pytest.mark.parametrize("name", ["arc-welder", "irb120", "scara"])
def test_a_table_of_four_parameters_moves_as_far_off_as_it_says(name, rng):
    calibration = wrong(cell_of(read_robot(library("robots")[name])), rng)
    robot = calibration.cell.robot

    result = export(calibration, "dh-csv")

    apart = [dh_forward(result.files, q) - forward(robot, q, calibration.theta) for q in draws(robot, rng, 100)]
    off = [np.linalg.norm(T[:3, 3]) for T in apart]
    assert max(off) < 1.5 * result.deviation.max_mm + MICRO
    assert np.median(off) > 0.2 * result.deviation.mean_mm - MICRO


def test_axes_that_stay_parallel_cost_nothing_and_have_no_lengths_that_run_away(arc_welder, rng):
    theta = arc_welder.theta.copy()
    theta[arc_welder.robot.parameters.index("j2.a")] += 1.0

    result = export(identified(arc_welder, theta), "dh-csv")

    assert result.notes == ()
    assert result.deviation.max_mm < MICRO


def test_axes_a_hundred_thousandth_of_a_degree_off_parallel_end_in_numbers_all_the_same(arc_welder):
    theta = arc_welder.theta.copy()
    theta[arc_welder.robot.parameters.index("j2.beta")] = np.radians(0.1)
    theta[arc_welder.robot.parameters.index("j2.alpha")] = np.radians(1e-5)

    result = export(identified(arc_welder, theta), "dh-csv")

    table = [[float(cell) for cell in row.split(",")[2:]] for row in result.files[".csv"].splitlines()[1:]]
    assert np.isfinite(table).all()
    assert np.abs(table).max() < 1000
    assert 0.1 < result.deviation.max_mm < 3.0  # what the fifth parameter would have carried


def test_four_parameters_are_copied_where_there_is_no_fifth(arc_welder):
    files = export(identified(arc_welder, arc_welder.theta), "dh-csv").files

    assert files[".csv"].splitlines()[2] == "j2,revolute,-90.0,0.0,350.0,0.0"
