"""Problems of the race: the racer is not told the truth, and what it is told fits the truth."""

import numpy as np
import pytest

from studies.racers import with_scipy
from studies.racers.peers_problems import SIGMA, UNSEEN, candidates, folder, irb120, touches, tracker


@pytest.mark.parametrize("question", [tracker, touches])
def test_the_drawing_does_not_fit_and_the_poses_to_foretell_are_others(question):
    asked = question(np.random.default_rng(1), 30)
    told = dict(asked.told)

    nominal = with_scipy.residual(told)(with_scipy.start(told))

    measured = 30 * (3 if question is tracker else 1)
    assert np.sqrt((nominal[:measured] ** 2).mean()) > 100  # in units of the scatter: millimetres off
    assert asked.hidden.shape == (UNSEEN, 3)
    assert not {q.tobytes() for q in told["q"]} & {q.tobytes() for q in told["q_unseen"]}
    assert float(told["sigma"]) == SIGMA


def test_a_seed_asks_the_same_again():
    first, second = (tracker(np.random.default_rng(5), 10) for _ in range(2))

    np.testing.assert_array_equal(first.hidden, second.hidden)


def test_measurements_that_are_not_there_are_told_by_their_file(monkeypatch, tmp_path):
    monkeypatch.setenv("TOUCHCAL_DATA", str(tmp_path))

    assert folder("irb120") == tmp_path / "irb120"
    for ask in (irb120, lambda rng, count: candidates(count, rng)):
        with pytest.raises(FileNotFoundError):
            ask(np.random.default_rng(0), 5)
