"""pybotics: modified Denavit-Hartenberg parameters, world and tool, fitted as in its example."""

import numpy as np
from pybotics.geometry import matrix_2_vector, vector_2_matrix
from pybotics.kinematic_chain import MDHKinematicChain
from pybotics.optimization import OptimizationHandler, optimize_accuracy
from pybotics.robot import Robot
from pybotics.tool import Tool
from scipy.optimize import least_squares

Problem = dict[str, np.ndarray]


def robot(problem: Problem) -> Robot:
    """The nominal robot: a row has alpha and a of the link before it; those of the last link are the tool's."""
    theta, d, a, alpha, _ = problem["dh"].T
    before = np.column_stack([np.append(0, alpha[:-1]), np.append(0, a[:-1]), theta, d])
    last = vector_2_matrix(np.array([a[-1], 0, 0, 0, 0, alpha[-1]]))
    robot = Robot(MDHKinematicChain.from_parameters(before), Tool(last @ vector_2_matrix(problem["tool"])))
    robot.world_frame = vector_2_matrix(problem["base"])
    return robot


def identify(problem: Problem) -> Problem:
    """All parameters of chain, tool position and world against the measured positions."""
    nominal = robot(problem)
    assert np.allclose(matrix_2_vector(nominal.world_frame), problem["base"])
    handler = OptimizationHandler(
        nominal, kinematic_chain_mask=True, tool_mask=[True] * 3 + [False] * 3, world_mask=True
    )
    solution = least_squares(
        fun=optimize_accuracy, x0=handler.generate_optimization_vector(), args=(handler, problem["q"], problem["point"])
    )
    handler.apply_optimization_vector(solution.x)
    return {"tip": np.array([handler.robot.fk(q)[:3, 3] for q in problem["q_unseen"]])}


METHODS = {"pybotics": identify}
