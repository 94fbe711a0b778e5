"""How a controller counts the joints of its robot, on pendant and line and in programs.

The border is every file that controller or pendant reads or writes (plan.csv, touches.csv, positions.csv, pendant.csv,
the line, programs): there stand the controller's counts. Everything else computes with the joints of the model.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from jaxtyping import Float

from identify.model.files import InputError

EXACT = 9  # decimals to which a matrix of signs and couplings is rounded


@dataclass(frozen=True)
class JointCounting:
    """model = sign * (counts + coupled counts - zero), joint by joint, in degrees (mm for a prismatic joint).

    An empty tuple is the usual: every sign +1, every zero 0, no coupling; `pulses` empty means not known.
    """

    sign: tuple[int, ...] = ()  # +1 or -1 a joint
    zero: tuple[float, ...] = ()  # [deg] or [mm] a joint: what the controller shows where the model stands at 0
    coupled: tuple[tuple[int, int, int], ...] = ()  # joint, the joint whose count is added to it, +1 or -1
    pulses: tuple[float, ...] = ()  # pulses of one degree (or mm) a joint
    uncoupled: bool = False  # whether a file states that no count depends on another joint

    @property
    def differs(self) -> bool:
        """Whether the controller's counts are other numbers than the joints of the model."""
        return bool(self.coupled) or -1 in self.sign or any(self.zero)

    @property
    def stated(self) -> bool:
        """Whether a file says how the counts of one joint depend on another."""
        return self.uncoupled or self.differs

    def from_controller(self, counts: Float[np.ndarray, "*rows joints"]) -> Float[np.ndarray, "*rows joints"]:
        """Joints of the model [deg] or [mm] from the controller's counts."""
        return self._signs(counts.shape[-1]) * (counts @ self._coupling(counts.shape[-1]).T - self._zeros(counts))

    def to_controller(self, joints: Float[np.ndarray, "*rows joints"]) -> Float[np.ndarray, "*rows joints"]:
        """The controller's counts from joints of the model [deg] or [mm]."""
        uncoupled = np.linalg.inv(self._coupling(joints.shape[-1])).round(EXACT)
        return (self._signs(joints.shape[-1]) * joints + self._zeros(joints)) @ uncoupled.T

    @cached_property
    def per_degree(self) -> Float[np.ndarray, " joints"]:
        """Pulses of one degree (or mm) a joint; raises InputError if they are not known."""
        if not self.pulses:
            raise InputError(
                "the pulses of a degree are not known; write joints: {pulses_per_deg: [...]} in cell.yaml, "
                "one number a joint"
            )
        return np.array(self.pulses)

    def matrix(self, joints: int) -> tuple[Float[np.ndarray, "joints joints"], Float[np.ndarray, " joints"]]:
        """A and b of model = A counts + b [deg] or [mm]."""
        signs = self._signs(joints)
        return signs[:, None] * self._coupling(joints), -signs * self._zeros(signs)

    @classmethod
    def of_matrix(cls, A: Float[np.ndarray, "joints joints"], b: Float[np.ndarray, " joints"]) -> Self | None:
        """The counting with model = A counts + b; None if A is more than signs and couplings of single joints."""
        sign = np.diag(A).round(EXACT)
        coupling = sign[:, None] * A.round(EXACT) - np.eye(len(A))
        if (np.abs(sign) != 1).any() or not np.isin(coupling, (-1.0, 0.0, 1.0)).all():
            return None
        zero = (0.0 - sign * b).round(EXACT) + 0.0
        return cls(
            tuple(sign.astype(int).tolist()) if (sign < 0).any() else (),
            tuple(zero.tolist()) if zero.any() else (),
            tuple((int(i), int(j), int(coupling[i, j])) for i, j in np.argwhere(coupling)),
        )

    def _signs(self, joints: int) -> Float[np.ndarray, " joints"]:
        return np.array(self.sign, dtype=float) if self.sign else np.ones(joints)

    def _zeros(self, rows: Float[np.ndarray, "*rows joints"]) -> Float[np.ndarray, " joints"]:
        return np.array(self.zero) if self.zero else np.zeros(rows.shape[-1])

    def _coupling(self, joints: int) -> Float[np.ndarray, "joints joints"]:
        """Ones on the diagonal, and the sign of each coupling."""
        C = np.eye(joints)
        for joint, with_, sign in self.coupled:
            C[joint, with_] += sign
        return C


AS_MODEL = JointCounting()  # a controller that counts as the model does


def circle(coupled: Sequence[tuple[int, int, int]]) -> bool:
    """Whether couplings lead back to where they began, so that they cannot be undone."""
    size = 1 + max((max(joint, with_) for joint, with_, _ in coupled), default=0)
    E = np.zeros((size, size))
    for joint, with_, _ in coupled:
        E[joint, with_] = 1
    return bool(np.linalg.matrix_power(E, size).any())
