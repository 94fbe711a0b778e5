"""What a serial robot is: joints, their five link parameters each, and the names of all parameters."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

POSE_NAMES = ("x", "y", "z", "rz", "ry", "rx")
LINK_NAMES = ("theta", "d", "a", "alpha", "beta")


@dataclass(frozen=True)
class Joint:
    """One revolute or prismatic joint: A = Rz(theta) Trans(a, 0, d) Rx(alpha) Ry(beta) (equation 4)."""

    name: str
    prismatic: bool
    theta: float  # [rad], offset added to the joint value where the joint is revolute
    d: float  # [mm], offset added to the joint value where the joint is prismatic
    a: float  # [mm]
    alpha: float  # [rad]
    beta: float  # [rad]
    lower: float  # [rad] or [mm]
    upper: float  # [rad] or [mm]
    speed: float  # [rad/s] or [mm/s]

    @property
    def link(self) -> tuple[float, float, float, float, float]:
        """Nominal theta, d, a, alpha, beta."""
        return self.theta, self.d, self.a, self.alpha, self.beta


@dataclass(frozen=True)
class Capsule:
    """A segment with a radius that moves with a link; link 0 stands still, link N carries the torch."""

    link: int
    start: tuple[float, float, float]  # [mm], in the frame of the link
    end: tuple[float, float, float]  # [mm]
    radius: float  # [mm]


@dataclass(frozen=True, eq=False)
class Robot:
    """A serial robot of any number of joints, between a base and a flange."""

    name: str
    joints: tuple[Joint, ...]
    source: str = ""
    capsules: tuple[Capsule, ...] = ()
    base_T_first: Float[np.ndarray, "4 4"] = field(
        default_factory=lambda: np.eye(4)
    )  # a URDF's base link, before joint 1
    last_T_flange: Float[np.ndarray, "4 4"] = field(default_factory=lambda: np.eye(4))  # behind the last joint's frame

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of all 12 + 5 N parameters in the order base, joints, tool."""
        return (
            *(f"base.{name}" for name in POSE_NAMES),
            *(f"{joint.name}.{name}" for joint in self.joints for name in LINK_NAMES),
            *(f"tool.{name}" for name in POSE_NAMES),
        )

    @cached_property
    def angular(self) -> tuple[bool, ...]:
        """Whether each parameter is an angle; the others are lengths."""
        return tuple(name.split(".")[1] in {"theta", "alpha", "beta", "rz", "ry", "rx"} for name in self.parameters)

    @cached_property
    def prismatic(self) -> tuple[bool, ...]:
        """Whether each joint is prismatic."""
        return tuple(joint.prismatic for joint in self.joints)

    @cached_property
    def lower(self) -> Float[np.ndarray, " joints"]:
        """Lower joint limits [rad] or [mm]."""
        return np.array([joint.lower for joint in self.joints])

    @cached_property
    def upper(self) -> Float[np.ndarray, " joints"]:
        """Upper joint limits [rad] or [mm]."""
        return np.array([joint.upper for joint in self.joints])

    @cached_property
    def speed(self) -> Float[np.ndarray, " joints"]:
        """Highest joint speeds [rad/s] or [mm/s]."""
        return np.array([joint.speed for joint in self.joints])

    @cached_property
    def links(self) -> Float[np.ndarray, " links"]:
        """Nominal link parameters of all joints, five each [rad] or [mm]."""
        return np.array([value for joint in self.joints for value in joint.link])

    def theta(self, base: Float[np.ndarray, " 6"], tool: Float[np.ndarray, " 6"]) -> Float[np.ndarray, " parameters"]:
        """The parameter vector of this robot standing at `base` and carrying `tool` [mm, rad]."""
        return np.concatenate([base, self.links, tool])

    def joint_unit(self) -> Float[np.ndarray, " joints"]:
        """Factors from file units (deg or mm) to the inside (rad or mm), one a joint."""
        return np.where(self.prismatic, 1.0, np.pi / 180)

    def parameter_unit(self) -> Float[np.ndarray, " parameters"]:
        """Factors from file units (deg or mm) to the inside (rad or mm), one a parameter."""
        return np.where(self.angular, np.pi / 180, 1.0)
