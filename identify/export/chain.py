"""A calibrated chain as constant transforms with motions along or about z between them, whatever its parameters were.

Every link is Z(q) B with B constant, so that base_T_flange = A Z(q1) B1 Z(q2) B2 ... Z(qN) BN C. Formats place their
frames elsewhere along and about the same axes: by slack S that Z does not notice (Z S = S Z), and by turns W from z to
the axis of their own. No parameter is ever divided by the sine of an angle, so parallel axes are nothing special.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identify.model.frames import inverse, transform
from identify.model.robot import Robot

Transform = Float[np.ndarray, "4 4"]


@dataclass(frozen=True, eq=False)
class Segments:
    """The constant parts of a chain [mm]."""

    base_T_first: Transform
    links: tuple[Transform, ...]
    last_T_flange: Transform
    prismatic: tuple[bool, ...]


def segments(robot: Robot, theta: Float[np.ndarray, " parameters"]) -> Segments:
    """The constant parts of a robot with these parameters."""
    links = robot.link_values(theta)
    return Segments(robot.base_T_first, tuple(_link(*link) for link in links), robot.last_T_flange, robot.prismatic)


def _link(theta: float, d: float, a: float, alpha: float, beta: float) -> Transform:
    """Rz(theta) Trans(a, 0, d) Rx(alpha) Ry(beta) (equation 4)."""
    turn, twist = np.array([0, 0, 0, theta, 0, 0]), np.array([0, 0, 0, 0, 0, alpha])
    slide, tilt = np.array([a, 0, d, 0, 0, 0]), np.array([0, 0, 0, 0, beta, 0])
    return transform(turn) @ transform(slide) @ transform(twist) @ transform(tilt)


def origins(
    chain: Segments, slack: Sequence[Transform] | None = None, turns: Sequence[Transform] | None = None
) -> list[Transform]:
    """Where each joint stands on the link before it, and where the flange stands on the last."""
    one = [np.eye(4)] * len(chain.links)
    S, W = one if slack is None else slack, one if turns is None else turns
    ends = [w @ inverse(s) for w, s in zip(W, S, strict=True)]
    starts = [s @ inverse(w) for s, w in zip(S, W, strict=True)]
    between = [end @ B @ start for end, B, start in zip(ends[:-1], chain.links[:-1], starts[1:], strict=True)]
    return [chain.base_T_first @ starts[0], *between, ends[-1] @ chain.links[-1] @ chain.last_T_flange]


def slack_of(chain: Segments, link_frames: Sequence[Transform], turns: Sequence[Transform]) -> list[Transform]:
    """The slack with which `origins` of a chain are the given ones."""
    S = [inverse(chain.base_T_first) @ link_frames[0] @ turns[0]]
    for B, origin, before, after in zip(chain.links[:-1], link_frames[1:], turns[:-1], turns[1:], strict=False):
        S.append(inverse(B) @ S[-1] @ inverse(before) @ origin @ after)
    return S


def turn_to(axis: Float[np.ndarray, " 3"]) -> Transform:
    """A turn that takes z to an axis, as short as may be."""
    cross, cosine = np.cross([0.0, 0.0, 1.0], axis), axis[2]
    T = np.eye(4)
    if cosine < -1 + 1e-12:
        T[:3, :3] = np.diag([1.0, -1.0, -1.0])
        return T
    K = np.array([[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]])
    T[:3, :3] += K + K @ K / (1 + cosine)
    return T


def forward(
    link_frames: Sequence[Transform], prismatic: Sequence[bool], q: Float[np.ndarray, "poses joints"]
) -> Float[np.ndarray, "poses 4 4"]:
    """base_T_flange of origins with motions along or about z between them [rad, mm]."""
    T = np.tile(np.eye(4), (len(q), 1, 1))
    for origin, slides, value in zip(link_frames, prismatic, q.T, strict=False):
        motion = np.zeros((len(q), 6))
        motion[:, 2 if slides else 3] = value
        T = T @ origin @ transform(motion)
    return T @ link_frames[-1]
