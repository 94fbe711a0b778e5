"""Where a position counts from: table, program, default, in this order; and back again."""

import numpy as np
from programs import CELL
from scipy.spatial.transform import Rotation

from identify.model.frames import transform
from identify.programs.frames_and_tools import places
from identify.programs.records import Record, Ref
from identify.programs.setup import Setup

FLANGE_T_TIP = transform(CELL.tool)


def frame(seed):
    T = np.eye(4)
    T[:3, :3] = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    T[:3, 3] = np.random.default_rng(seed).uniform(-500, 500, 3)
    return T


def place(frame=None, tool=None, **tables):
    record = Record("P1", 1, "euler", (), frame or Ref(), tool or Ref())
    (found,) = places([record], Setup(**tables), FLANGE_T_TIP)
    return found


def test_the_pose_of_the_tip_comes_back_from_the_pose_of_the_tool():
    found, T = place(Ref("1"), Ref("2"), frames={"1": frame(1)}, tools={"2": frame(2)}), frame(3)

    np.testing.assert_allclose(found.base_T_tip(found.frame_T_tool(T)), T, atol=1e-9)


def test_a_flange_in_a_frame_is_where_both_put_it():
    found, T = place(Ref("1"), Ref("2"), frames={"1": frame(1)}, tools={"2": frame(2)}), frame(3)

    base_T_flange = found.base_T_tip(T) @ np.linalg.inv(FLANGE_T_TIP)

    np.testing.assert_allclose(base_T_flange, frame(1) @ T @ np.linalg.inv(frame(2)), atol=1e-9)


def test_the_table_wins_over_the_program_and_the_program_over_the_default():
    ref = Ref("Station", frame(5))

    np.testing.assert_array_equal(place(ref, frames={"STATION": frame(6)}).base_T_frame, frame(6))
    np.testing.assert_array_equal(place(ref, frames={"other": frame(6)}).base_T_frame, frame(5))
    np.testing.assert_array_equal(place().base_T_frame, np.eye(4))


def test_a_frame_that_a_table_does_not_have_is_not_known_and_without_a_table_it_is_assumed():
    missing, assumed = place(Ref("7"), frames={"1": frame(1)}), place(Ref("7"))

    assert missing.why == "frame: frame 7 is not in the table"
    assert assumed.why == ""
    assert assumed.assumptions == ("frame 7 is taken for the robot's base; say otherwise in a table (--setup)",)
