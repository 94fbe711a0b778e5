"""One joint of a serial robot, its five link parameters, and the capsule around a link."""

import math
from dataclasses import dataclass

TURNING, SLIDING = math.pi / 2, 500.0  # [rad/s], [mm/s]: speeds of joints for which nobody states one
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
    mass: float = 0.0  # [kg], of the link behind the joint
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [mm], of that mass, in the frame of the link

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
