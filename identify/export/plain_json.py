"""The identified robot as one JSON document: what robot.yaml holds, with base and tool."""

import json
from collections.abc import Mapping
from importlib.metadata import version

import numpy as np
from jaxtyping import Float

from identify.export.formats import Format, Forward, Original
from identify.model.frames import transform
from identify.model.io.calibration_file import Calibration
from identify.model.io.entries import pose_entry, pose_of, robot_entry, robot_of
from identify.model.io.joint_counting import counting_entry
from identify.model.io.schema import PoseEntry, RobotFile
from identify.model.kinematics import Kinematics


def write(calibration: Calibration, original: Original | None) -> tuple[Mapping[str, str], tuple[str, ...]]:
    """The JSON text."""
    robot = calibration.cell.robot
    entry = {
        "touchcal": version("touchcal"),
        "inputs": dict(calibration.inputs),
        "base": pose_entry(calibration.theta[:6]),
        "tool": pose_entry(calibration.theta[-6:]),
        "robot": robot_entry(robot.identified(calibration.theta)),
        "joints": counting_entry(robot.counting, [joint.name for joint in robot.joints]),
    }
    return {".json": json.dumps(entry, indent=1) + "\n"}, ()


def read(files: Mapping[str, str], calibration: Calibration) -> Forward:
    """jig_T_tip of the robot in the document."""
    entry = json.loads(files[".json"])
    robot = robot_of(RobotFile.model_validate(entry["robot"]))
    base, tool = (pose_of(PoseEntry.model_validate(entry[name])) for name in ("base", "tool"))
    theta, kinematics = robot.theta(np.asarray(base), np.asarray(tool)), Kinematics(robot)

    def tip(q: Float[np.ndarray, "poses joints"]) -> Float[np.ndarray, "poses 4 4"]:
        T = np.tile(transform(np.zeros(6)), (len(q), 1, 1))
        T[:, :3, 3], T[:, :3, :3] = kinematics.tip(q, theta)
        return T

    return tip


FORMAT = Format(".json", write, read, beyond=True)
