"""What the tests of all makers' programs share: joints to write down, and a judge of what comes out."""

from dataclasses import dataclass

import numpy as np
from hypothesis import Phase
from hypothesis import strategies as st
from identified import identified
from measured import table_2
from oracle import forward
from scipy.spatial.transform import Rotation

from identify.model.cell import Cell
from identify.model.frames import inverse, transform
from identify.model.ik import reach
from identify.model.io.description import library, read_cell

CELL: Cell = read_cell(library("cells")["arc-welder"])
TRUTH = table_2(CELL)
EXACT, SAME = identified(CELL, TRUTH), identified(CELL, CELL.theta)  # a robot known exactly, one as it is believed
LOW = np.array([-0.7, -0.2, -0.6, -1.0, 0.5, -2.0])
HIGH = np.array([0.7, 0.5, 0.3, 1.0, 1.3, 2.0])
Q = np.array([0.1, 0.2, -0.3, 0.4, 0.9, 0.3])
AS_DRAWN = (Phase.explicit, Phase.reuse, Phase.generate)  # an example takes a tenth of a second: none is made smaller
ROUND_MM, ROUND_DEG = 0.003, 0.003  # what three decimals leave, with some room for the lever of an angle

joints = st.tuples(*(st.floats(lo, hi) for lo, hi in zip(LOW, HIGH, strict=True)), st.booleans()).map(
    lambda drawn: np.array([*drawn[:4], drawn[4] * (-1 if drawn[6] else 1), drawn[5]])
)


@st.composite
def wounded(draw: st.DrawFn, text: str, words: list[str]) -> str:
    """A program of which up to nine characters are gone, and a word may stand in their place."""
    a = draw(st.integers(0, len(text)))
    b = draw(st.integers(a, min(len(text), a + 9)))
    return text[:a] + draw(st.sampled_from(["", *words])) + text[b:]


@dataclass(frozen=True)
class Sides:
    """On which side of the arm the wrist stands, from the drawing of the arm."""

    front: bool
    above: bool


def sides(q: np.ndarray) -> Sides:
    """Planar trigonometry of the paper's arm: 350 mm from axis 2 to 3, 350 mm on to the wrist, square to it at zero."""
    lean, fore = q[1], q[1] + q[2]
    elbow = 350 * np.array([np.sin(lean), np.cos(lean)])  # forward, up
    wrist = elbow + 350 * np.array([np.cos(fore), -np.sin(fore)])
    return Sides(bool(wrist[0] > 0), bool(elbow[1] * wrist[0] - elbow[0] * wrist[1] > 0))


def base_T_tip(q: np.ndarray, theta: np.ndarray = CELL.theta) -> np.ndarray:
    """Where the controller believes the tip to be, in the robot's base."""
    return inverse(transform(CELL.theta[:6])) @ forward(CELL.robot, q, theta)


def wpr(T: np.ndarray) -> np.ndarray:
    """X Y Z [mm] and rz, ry, rx [deg] of a pose."""
    return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_euler("ZYX", degrees=True)])


def from_wpr(values: np.ndarray) -> np.ndarray:
    """The pose of X Y Z [mm], rz, ry, rx [deg]."""
    T = np.eye(4)
    T[:3, 3], T[:3, :3] = values[:3], Rotation.from_euler("ZYX", values[3:], degrees=True).as_matrix()
    return T


def quaternion(T: np.ndarray) -> np.ndarray:
    """X Y Z [mm] and a quaternion, scalar first."""
    return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)])


def from_quaternion(values: np.ndarray) -> np.ndarray:
    """The pose of X Y Z [mm] and a quaternion, scalar first."""
    T = np.eye(4)
    T[:3, 3], T[:3, :3] = values[:3], Rotation.from_quat(values[3:], scalar_first=True).as_matrix()
    return T


def off(commanded: np.ndarray, wanted: np.ndarray, q: np.ndarray) -> tuple[float, float]:
    """How far [mm, deg] the true robot ends from a wanted pose when its nominal controller is told another."""
    jig_T_base = transform(CELL.theta[:6])
    told = jig_T_base @ commanded
    found = reach(CELL.kinematics, CELL.theta, told[None, :3, 3], told[None, :3, :3], q[None])
    assert found.reached()[0]
    return off_joints(found.q[0], wanted)


def off_joints(q: np.ndarray, wanted: np.ndarray) -> tuple[float, float]:
    """How far [mm, deg] the true robot is from a pose wanted in the base where its controller is told joints."""
    wanted = transform(CELL.theta[:6]) @ wanted
    true = forward(CELL.robot, q, TRUTH)
    turn = Rotation.from_matrix(true[:3, :3].T @ wanted[:3, :3]).magnitude()
    return float(np.linalg.norm(true[:3, 3] - wanted[:3, 3])), float(np.degrees(turn))


FRAME = from_wpr(np.array([500.0, -100.0, 200.0, 30.0, -10.0, 5.0]))  # of a user, in the robot's base
