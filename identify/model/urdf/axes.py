"""From the axes of a chain at zero to the parameters of its links: common normals, Hayati's where nearly parallel."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identify.model.frames import inverse, rotation

PARALLEL = np.sin(np.radians(5))  # sine of the angle below which two axes count as nearly parallel
COINCIDENT = 1e-10  # [mm], below which two parallel axes are one line


@dataclass(frozen=True, eq=False)
class Axis:
    """The line a joint turns about, or the direction it slides along, while every joint reads zero."""

    point: Float[np.ndarray, " 3"]  # [mm], in the frame of the base
    direction: Float[np.ndarray, " 3"]  # unit length, the positive sense of the joint


@dataclass(frozen=True, eq=False)
class Chain:
    """What `Robot` needs: a constant frame before the first joint, five parameters a link, one behind the last."""

    base_T_first: Float[np.ndarray, "4 4"]
    links: Float[np.ndarray, "joints 5"]  # theta, d, a, alpha, beta [rad] or [mm]
    last_T_flange: Float[np.ndarray, "4 4"]
    frames: tuple[Float[np.ndarray, "4 4"], ...]  # in that of the base, before the first joint and behind each link


def chain(axes: Sequence[Axis], base_T_flange: Float[np.ndarray, "4 4"]) -> Chain:
    """Link parameters of joints on these axes whose flange stands at `base_T_flange` while every joint reads zero.

    Joint values keep their zero and sign: the third axis of each link's frame is the axis of the joint behind it.
    """
    T = base_T_first = _first(axes[0])
    ends = [*axes[1:], Axis(base_T_flange[:3, 3], base_T_flange[:3, 2])]
    links, frames = [], [T]
    for axis in ends:
        x = base_T_flange[:3, 0] if axis is ends[-1] else T[:3, 0]
        link = _link(T[:3, :3].T @ (axis.point - T[:3, 3]), T[:3, :3].T @ axis.direction, T[:3, :3].T @ x)
        links.append(link)
        T = T @ _transform(link)
        frames.append(T)
    # 0.0 is added so that no zero is negative
    return Chain(base_T_first, np.array(links) + 0.0, _tidy(inverse(T) @ base_T_flange), tuple(frames))


def _first(axis: Axis) -> Float[np.ndarray, "4 4"]:
    """A frame on the first axis, abreast of the base and turned as little as may be: often the base itself."""
    z = axis.direction
    across = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
    x = across - (across @ z) * z
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    T[:3, 3] = axis.point - (axis.point @ z) * z
    return _tidy(T)


def _link(
    p: Float[np.ndarray, " 3"], z: Float[np.ndarray, " 3"], x: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " 5"]:
    """Link parameters from a joint's frame to the line through p along z; x settles what coincident lines leave open.

    Along the common normal beta is 0 (Denavit and Hartenberg 1955). It runs off to infinity as the lines become
    parallel, so there the next frame sits at p and beta turns it (Hayati and Mirmirani 1985).
    """
    if np.hypot(z[0], z[1]) >= PARALLEL:
        theta = np.arctan2(z[0], -z[1])
        if np.cos(theta) < -1e-9:  # of the two senses of the normal, the one that turns x less
            theta = np.arctan2(-z[0], z[1])
        c, s = np.cos(theta), np.sin(theta)
        along, across = c * p[0] + s * p[1], c * p[1] - s * p[0]
        sine = s * z[0] - c * z[1]  # of alpha, signed
        return np.array([theta, p[2] + across / sine * z[2], along, np.arctan2(sine, z[2]), 0.0])
    a = np.hypot(p[0], p[1])
    theta = np.arctan2(p[1], p[0]) if a > COINCIDENT else np.arctan2(x[1], x[0])
    u = rotation(-theta, 0.0, 0.0) @ z
    alpha, beta = np.arctan2(-u[1], u[2]), np.arctan2(u[0], np.hypot(u[1], u[2]))
    return np.array([theta, p[2], a if a > COINCIDENT else 0.0, alpha, beta])


def _transform(link: Float[np.ndarray, " 5"]) -> Float[np.ndarray, "4 4"]:
    """Rz(theta) Trans(a, 0, d) Rx(alpha) Ry(beta) (equation 4)."""
    theta, d, a, alpha, beta = link
    turn = rotation(theta, 0.0, 0.0)
    T = np.eye(4)
    T[:3, :3] = turn @ rotation(0.0, 0.0, alpha) @ rotation(0.0, beta, 0.0)
    T[:3, 3] = turn @ [a, 0.0, d]
    return T


def _tidy(T: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """A transform without the last digits of rounding, so that an identity is one."""
    whole = np.round(T)
    limit = np.full((4, 4), 1e-14)
    limit[:3, 3] = COINCIDENT
    return np.where(np.abs(T - whole) < limit, whole, T)
