"""What thousands of schedules reckon alike, reckoned once: ways and predictions depend on nothing but their inputs."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from identify.model.jig import Face
from probe.motion.room import Room
from probe.runs.prediction import Predictor

MOST = 20000  # answers, after which all are forgotten
_answers: dict[tuple[object, ...], Any] = {}


def kept(key: tuple[object, ...], reckon: Callable[[], Any]) -> Any:
    """An answer, reckoned where nobody has asked for it before."""
    if key not in _answers:
        if len(_answers) >= MOST:
            _answers.clear()
        _answers[key] = reckon()
    return _answers[key]


class KeptRoom(Room):
    """A room that remembers its answers by what was asked and by what is known of the robot."""

    def _key(self, *asked: object) -> tuple[object, ...]:
        return (self._stops.tobytes(), self.theta.tobytes(), self._covariance.tobytes(), *asked)

    def route(self, start: np.ndarray, goal: np.ndarray, via: Sequence[np.ndarray] = ()) -> list[np.ndarray]:
        asked = (start.tobytes(), goal.tobytes(), *(q.tobytes() for q in via))
        return list(kept(self._key("route", *asked), lambda: super(KeptRoom, self).route(start, goal, via)))

    def hits(self, face: Sequence[Face], approach: np.ndarray, contact: np.ndarray) -> list[str]:
        asked = (*(one.name for one in face), approach.tobytes(), contact.tobytes())
        return list(kept(self._key("hits", *asked), lambda: super(KeptRoom, self).hits(face, approach, contact)))


class KeptPredictor(Predictor):
    """A predictor that remembers what it learnt from the same touches in the same order."""

    def _key(self, *asked: object) -> tuple[object, ...]:
        return (*((q.tobytes(), face.name) for q, face in self._rows), *asked)

    def judge(self, q: np.ndarray, face: Face) -> Any:
        return kept(self._key("judge", q.tobytes(), face.name), lambda: super(KeptPredictor, self).judge(q, face))

    def first_contact(self, start: np.ndarray, end: np.ndarray, face: Face) -> Any:
        key = self._key("first", start.tobytes(), end.tobytes(), face.name)
        return kept(key, lambda: super(KeptPredictor, self).first_contact(start, end, face))

    def learn(self, q: np.ndarray, face: Face) -> None:
        def learnt() -> tuple[np.ndarray, np.ndarray]:
            super(KeptPredictor, self).learn(q, face)
            del self._rows[-1]
            return self.theta, self.covariance

        self.theta, self.covariance = kept(self._key("learn", q.tobytes(), face.name), learnt)
        self._rows.append((q, face))
