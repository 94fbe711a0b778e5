"""figaroh: calibration by its BaseCalibration on a URDF, selection by its SOCP and its Detmax."""

import random
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from figaroh.calibration.base_calibration import BaseCalibration
from figaroh.calibration.calibration_tools import calc_updated_fkm
from figaroh.optimal.base_optimal_calibration import Detmax, SOCPOptimizer
from figaroh.tools.load_robot import load_robot
from scipy.spatial.transform import Rotation

warnings.simplefilter("ignore")
Problem = dict[str, np.ndarray]
JOINTS = [f"j{i + 1}" for i in range(6)]


def urdf(dh: np.ndarray) -> str:
    """The nominal arm: joints turn about z; between them stands what the link before has fixed."""
    parts, before = ['<robot name="racer"><link name="link0"/>'], np.zeros(4)
    for i, (theta, d, a, alpha, _) in enumerate(dh):
        parts.append(_joint(JOINTS[i], i, before, theta, "revolute"))
        before = np.array([d, a, alpha, 0.0])
    return "".join([*parts, _joint("flange", len(dh), before, 0.0, "fixed"), "</robot>"])


def _joint(name: str, i: int, before: np.ndarray, theta: float, kind: str) -> str:
    d, a, alpha, _ = before
    rpy = Rotation.from_euler("XZ", [alpha, theta]).as_euler("xyz")
    return (
        f'<link name="link{i + 1}"/><joint name="{name}" type="{kind}"><parent link="link{i}"/>'
        f'<child link="link{i + 1}"/><origin xyz="{a / 1000:.12g} 0 {d / 1000:.12g}" rpy="{rpy[0]:.15g} {rpy[1]:.15g} '
        f'{rpy[2]:.15g}"/>'
        '<axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>'
    )


CONFIGURATION = """
robot: {{name: racer, properties: {{joints: {{active_joints: [j1, j2, j3, j4, j5, j6]}}}}}}
tasks:
  calibration:
    enabled: true
    parameters:
      calibration_level: full_params
      include_non_geometric: false
      regularization_coefficient: 0.0
      outlier_threshold: 0.05
      estimation: {{method: {method}, priors: {{translation: {length}, rotation: {angle}, joint_offset: {angle}}}}}
    kinematics: {{base_frame: universe, tool_frame: flange}}
    measurements:
      markers: [{{name: tip, reference_joint: j6, measurable_dof: [true, true, true, false, false, false]}}]
      poses: {{base_pose: [0, 0, 0, 0, 0, 0], tool_pose: [0, 0, 0, 0, 0, 0]}}
    data: {{source_file: {data}, number_of_samples: {count}}}
"""


class Calibration(BaseCalibration):  # type: ignore[misc]
    """Positions in the frame of the tracker, metres; its documentation asks for a cost function of one's own."""

    def cost_function(self, var: np.ndarray) -> np.ndarray:
        """Measured less predicted positions."""
        predicted = calc_updated_fkm(self.model, self.data, var, self.q_measured, self.calib_config)
        return np.asarray(self.PEE_measured - predicted)


def identify(method: str) -> Callable[[Problem], Problem]:
    """Calibration by one of its estimation methods, from its files."""

    def solve(problem: Problem) -> Problem:
        with tempfile.TemporaryDirectory() as place:
            return _identify(problem, method, Path(place))

    return solve


def _identify(problem: Problem, method: str, folder: Path) -> Problem:
    table = np.column_stack([problem["point"] / 1000, problem["q"]])
    header = ",".join(["x1", "y1", "z1", *JOINTS])
    np.savetxt(folder / "data.csv", table, delimiter=",", header=header, comments="", fmt="%.12g")
    (folder / "robot.urdf").write_text(urdf(problem["dh"]))
    length, angle = problem["scale"][6 + 1] / 1000, problem["scale"][6]
    text = CONFIGURATION.format(
        method=method, length=length, angle=angle, data=folder / "data.csv", count=len(problem["q"])
    )
    (folder / "racer.yaml").write_text(text)
    robot = load_robot(str(folder / "robot.urdf"), package_dirs=str(folder))
    calibration: Any = Calibration(robot, str(folder / "racer.yaml"))
    calibration.calib_config |= {"known_baseframe": False, "known_tipframe": False}
    calibration.initialize()
    solution, _ = calibration.solve_optimisation(enable_logging=False)
    count = len(problem["q_unseen"])
    config = {**calibration.calib_config, "NbSample": count}
    predicted = calc_updated_fkm(calibration.model, calibration.data, solution.x, problem["q_unseen"], config)
    return {"tip": 1000 * np.reshape(predicted, (3, count)).T}


def _pool(problem: Problem) -> dict[int, np.ndarray]:
    return {i: np.outer(row, row) for i, row in enumerate(problem["rows"])}


def socp(problem: Problem) -> Problem:
    """Weights by its second-order cone program; the touches of the largest weights are chosen, as it ranks them."""
    weights, ranked = SOCPOptimizer(_pool(problem), {"NbSample": len(problem["rows"])}).solve()
    return {"weights": np.array(weights), "indices": np.array(list(ranked)[: int(problem["n"])])}


class Remembering(Detmax):  # type: ignore[misc]
    """Its `cur_set` stays empty, whatever it finds: the last set that it valued is the one it ends with."""

    def get_critD(self, set: list[int]) -> float:
        """The criterion, and a note of what it was asked for."""
        self.last = list(set)
        return float(super().get_critD(set))


def detmax(problem: Problem) -> Problem:
    """Exchange from a random start."""
    random.seed(0)
    search = Remembering(_pool(problem), int(problem["n"]))
    search.main_algo()
    return {"indices": np.array(search.last)}


METHODS = {
    "figaroh structural": identify("structural"),
    "figaroh map": identify("map"),
    "figaroh SOCP": socp,
    "figaroh Detmax": detmax,
}
