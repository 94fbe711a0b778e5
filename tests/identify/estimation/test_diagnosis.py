"""What identify says of faults in touches or robot: each planted fault is named, and sound touches are not accused."""

from dataclasses import replace

import numpy as np
import pytest
from findings import SIGMA, findings
from identified import identified
from irb120 import positions
from measured import TABLE_2, positions_at, table_2, touches_at

from identify.estimation.calibrate import calibrate
from identify.estimation.diagnosis import place_findings
from identify.estimation.selection import with_errors
from identify.model.calibration import FACE, SharedValue


def test_a_joint_that_turns_unevenly_is_named(arc_welder, touch_poses, rng):
    uneven = with_errors(arc_welder, ("harmonics",))
    theta = uneven.theta.copy()
    for name, value in TABLE_2.items():
        i = uneven.robot.parameters.index(name)
        theta[i] = value * uneven.robot.parameter_unit()[i]
    theta[uneven.robot.parameters.index("j3.cos2")] = np.radians(0.15)
    theta[uneven.robot.parameters.index("j3.sin2")] = np.radians(0.1)

    found = findings(arc_welder, positions_at(uneven, theta, touch_poses, rng, SIGMA))

    assert "j3 turns unevenly" in found["one bad joint"].text


def test_joints_read_back_before_the_robot_settled_are_recognised(irb120_cell, irb120_measured):
    everything = np.arange(500)

    early = findings(irb120_cell, positions(irb120_measured, everything, "readback"))
    commanded = findings(irb120_cell, positions(irb120_measured, everything))

    assert "wait until it stands" in early["joints read too early"].text
    assert "joints read too early" not in commanded


def test_touches_left_out_are_findings_with_their_names(arc_welder, touch_poses, rng):
    touches = touches_at(arc_welder, table_2(arc_welder), touch_poses, rng, SIGMA)
    offset = touches.offset.copy()
    offset[17] += 3.0

    found = findings(arc_welder, replace(touches, offset=offset))

    assert touches.ids[17] in found["outliers"].ids
    assert float(found["outliers"].text.split("by ")[1].split()[0]) == pytest.approx(-3.0, abs=0.2)


@pytest.mark.parametrize(("part", "index", "shift"), [("base", 0, 300.0), ("tool", -2, np.radians(-16))])
def test_a_base_or_tool_many_tolerances_off_is_named_with_its_size_and_no_face_is_accused(
    arc_welder, touch_poses, part, index, shift
):
    theta = arc_welder.theta.copy()
    theta[index] += shift
    faces = arc_welder.jig.faces
    shared = tuple(SharedValue(FACE + face.name, "mm", -10 * face.tolerance, 9 * face.tolerance) for face in faces)
    rows = np.hstack([np.zeros((len(faces), 1)), np.diag([(0.1 * face.tolerance) ** 2 for face in faces])])
    worse_jig = identified(arc_welder, theta, shared=shared, shared_covariance=rows)

    assert {finding.kind for finding in place_findings(replace(worse_jig, theta=arc_welder.theta))} >= {"jig"}
    (finding,) = place_findings(worse_jig)

    length, angle = getattr(arc_welder.priors, part)
    assert finding.kind == part
    assert f"{abs(shift) / (length if part == 'base' else angle):.0f} times its tolerance" in finding.text
    assert f"look at {part} of the cell file" in finding.text


def test_a_fit_that_shifts_the_base_by_sixty_tolerances_says_so_first(arc_welder, touch_poses, rng):
    theta = arc_welder.theta.copy()
    theta[:3] += 60 * arc_welder.priors.base[0] * np.array([0.6, -0.8, 0.0])

    first = calibrate(arc_welder, touches_at(arc_welder, theta, touch_poses, rng, SIGMA), folds=0, errors="cell")

    assert first.findings[0].kind == "base"
    assert "60 times its tolerance" in first.findings[0].text


def test_a_base_three_tolerances_off_is_what_tolerances_are_for(arc_welder):
    theta = arc_welder.theta.copy()
    theta[0] += 3 * arc_welder.priors.base[0]

    assert not place_findings(identified(arc_welder, theta))
