"""Where the next touch should be, by all touches so far: a sudden disagreement is then seen at once."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.jig import Face
from identify.model.measurement import Rows, measurement_model
from identify.uncertainty.information import map_step

UNKNOWN = 1e3  # a base or a tool to be fitted may be anywhere: so many times the usual prior
BLOCK = 32  # touches: CasADi compiles a map for each number of rows
LOOKS = 16  # at a search, between which distances are taken for straight
STEPS = 3  # of Gauss and Newton after each touch; the last estimate is close already


@dataclass(frozen=True)
class Surprise:
    """A touch against what is known."""

    residual: float  # [mm] along the normal against the nominal model
    difference: float  # [mm] against the prediction from all touches so far
    expected: float  # [mm], 1 sigma of that difference

    def beyond(self, floor: float) -> bool:
        """Whether the difference is more than five sigma and a floor [mm] for what the model leaves out."""
        return abs(self.difference) > 5 * self.expected + floor


class Predictor:
    """The most probable parameters given the priors of the cell and the touches so far (Gauss-Newton, all touches).

    This guards the run against touches on the wrong thing; it identifies nothing that leaves the run.
    """

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        self._model = measurement_model(cell.robot)
        self._prior = np.where(np.isfinite(cell.prior), cell.prior, UNKNOWN * cell.scale)
        self.theta = cell.theta.copy()
        self.covariance = np.diag(self._prior**2)
        self._rows: list[tuple[Float[np.ndarray, " joints"], Face]] = []

    def judge(self, q: Float[np.ndarray, " joints"], face: Face) -> Surprise:
        """A new touch at joint values `q` against what is known."""
        rows = self._stack([(q, face)])
        r, J = self._model.linearize(self.theta, rows)
        variance = float(J[0] @ self.covariance @ J[0] + rows.sigma[0] ** 2)
        nominal = self._model.residual(self.cell.theta, rows)
        return Surprise(float(nominal[0]), float(r[0]), float(np.sqrt(variance)))

    def first_contact(
        self, start: Float[np.ndarray, " joints"], end: Float[np.ndarray, " joints"], face: Face
    ) -> tuple[float, float]:
        """The fraction of a search at which it should meet a face, NaN if never, and 1 sigma along the normal [mm]."""
        s = np.linspace(0.0, 1.0, LOOKS)
        q = start + s[:, None] * (end - start)
        r = self._model.residual(self.theta, self._stack([(each, face) for each in q]))
        inside = np.flatnonzero(r <= 0)
        if not len(inside) or inside[0] == 0:
            return np.nan, np.nan
        i = int(inside[0])
        fraction = float(s[i - 1] + (s[i] - s[i - 1]) * r[i - 1] / (r[i - 1] - r[i]))
        return fraction, self.judge(start + fraction * (end - start), face).expected

    def learn(self, q: Float[np.ndarray, " joints"], face: Face) -> None:
        """Take a touch as true."""
        self._rows.append((q, face))
        rows = self._stack(self._rows, BLOCK)
        for _ in range(STEPS):
            r, J = self._model.linearize(self.theta, rows)
            step, M = map_step(r, J, rows.sigma, self.theta - self.cell.theta, self._prior)
            self.theta = self.theta + self._prior * step
        self.covariance = np.linalg.inv(M) * np.outer(self._prior, self._prior)

    def _stack(self, touches: list[tuple[Float[np.ndarray, " joints"], Face]], block: int = 1) -> Rows:
        """Rows of the model, filled up to whole blocks with rows that weigh nothing."""
        wire, touch = self.cell.wire, self.cell.touch
        more = -len(touches) % block
        touches, m = touches + touches[:1] * more, len(touches) + more
        return Rows(
            q=np.stack([q for q, _ in touches]),
            normal=np.stack([face.normal for _, face in touches]),
            offset=np.array([face.offset + wire.ball for _, face in touches]),
            radius=np.full(m, wire.flat),
            sigma=np.array(
                [np.hypot(touch.sigma, face.tolerance) for _, face in touches[: m - more]] + [np.inf] * more
            ),
            ids=tuple(map(str, range(m))),
            owner=np.arange(m),
        )
