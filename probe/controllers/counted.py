"""A controller that counts the joints in its own way: the driver's side is the model's, the line's is the controller's.

Backends speak radians and millimetres of what the line counts. This one stands before a backend where the cell says
that the controller counts otherwise (`joints:`), and converts every joint row on its way there and back.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from identify.model.robot import Robot
from probe.line.controller import Contact, Controller, Latch, NoContact, State


class Counted:
    """The controller behind a backend, in joints of the model [rad] or [mm]; raises what the backend raises."""

    def __init__(self, backend: Controller, robot: Robot) -> None:
        self.name, self.joints = backend.name, backend.joints
        self._backend, self._robot = backend, robot

    @property
    def sequence(self) -> int:
        """The number that the next command will carry."""
        return self._backend.sequence

    def state(self) -> State:
        """How things stand now."""
        state = self._backend.state()
        return replace(state, q=self._model(state.q))

    def move(self, q: Float[np.ndarray, " joints"], rate: float) -> Float[np.ndarray, " joints"]:
        """Move straight to `q`; where the robot stands afterwards."""
        return self._model(self._backend.move(self._counts(q), rate))

    def search(self, q: Float[np.ndarray, " joints"], rate: float) -> Contact | NoContact:
        """Move straight towards `q` until the wire touches."""
        result = self._backend.search(self._counts(q), rate)
        if isinstance(result, NoContact):
            return NoContact(self._model(result.q))
        return replace(result, q=self._model(result.q), stop=self._model(result.stop))

    def latch(self) -> Latch | None:
        """The last latch of this boot."""
        latch = self._backend.latch()
        return None if latch is None else replace(latch, q=self._model(latch.q))

    def stop(self) -> None:
        """Stop the robot and return when it stands still."""
        self._backend.stop()

    def close(self) -> None:
        """Give the port back."""
        self._backend.close()

    def _counts(self, q: Float[np.ndarray, " joints"]) -> Float[np.ndarray, " joints"]:
        return self._robot.to_controller(q) * self._robot.joint_unit()

    def _model(self, counts: Float[np.ndarray, " joints"]) -> Float[np.ndarray, " joints"]:
        return self._robot.from_controller(counts / self._robot.joint_unit())
