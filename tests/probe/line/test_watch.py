"""The watch on a motion: what a moving robot may report, and what it may not."""

import numpy as np
import pytest
from touching import Ticks

from probe.line.watch import Watch

START, END, RATE = np.zeros(6), np.array([10.0, -5.0, 0, 0, 0, 2.0]), 5.0  # 2 s


def watch(clock: Ticks, **options: bool) -> Watch:
    return Watch(START, END, RATE, clock, **options)


@pytest.mark.parametrize("contact", [False, True])
def test_a_robot_that_moves_as_it_was_told_is_left_alone(contact: bool) -> None:
    clock = Ticks()
    seen = watch(clock, from_contact=contact)

    for fraction in np.linspace(0, 1, 41):
        trembling = 0.01 * np.sin(1000 * fraction + np.arange(6))
        assert seen.objection(START + fraction * (END - START) + trembling, contact) == ""
        clock.sleep(0.05)


@pytest.mark.parametrize(
    ("place", "reason"),
    [
        (0.5 * END + [0, 0, 0.2, 0, 0, 0], "off the commanded path"),
        (1.02 * END, "beyond the end"),
        (0.3 * END, "moved back"),
        (0.9 * END, "expected at most"),
        (-0.02 * END, "moved back"),
    ],
)
def test_a_robot_that_leaves_its_path_or_its_pace_is_told_on(place: np.ndarray, reason: str) -> None:
    clock = Ticks()
    seen = watch(clock)
    clock.sleep(1.0)
    assert seen.objection(0.5 * END, False) == ""
    clock.sleep(1.1 if "end" in reason else 0.1)

    assert reason in seen.objection(place, False)


def test_a_robot_that_stands_still_on_its_way_is_told_on() -> None:
    clock = Ticks()
    seen = watch(clock)
    clock.sleep(1.0)
    assert seen.objection(0.4 * END, False) == ""
    clock.sleep(2.9)
    assert seen.objection(0.4 * END, False) == ""
    clock.sleep(0.2)

    assert "no progress for 3.1 s" in seen.objection(0.4 * END, False)


def test_a_robot_that_is_silent_before_it_sets_out_does_not_stand_still() -> None:
    clock = Ticks()
    seen = watch(clock)
    clock.sleep(3.4)

    assert seen.objection(0.0 * END, False) == ""
    clock.sleep(2.9)
    assert seen.objection(0.0 * END, False) == ""
    clock.sleep(0.2)
    assert "no progress for 3.1 s" in seen.objection(0.0 * END, False)


def test_a_robot_that_says_it_stands_may_be_where_its_time_allows_and_nowhere_else() -> None:
    clock = Ticks()
    seen = watch(clock)

    assert seen.objection(START, False, stands=True) == ""
    assert "expected at most" in seen.objection(0.5 * END, False, stands=True)
    clock.sleep(2.0)
    assert seen.objection(END, False, stands=True) == ""
    assert seen.objection(START, False, stands=True) == ""
    assert "off the commanded path" in seen.objection(0.5 * END + [0, 0, 0.2, 0, 0, 0], False, stands=True)


def test_a_slow_robot_that_is_asked_often_makes_progress() -> None:
    clock = Ticks()
    seen = Watch(START, END, 0.04, clock)

    for step in range(150):
        assert seen.objection(0.04 * 0.04 * step * END / 10, False) == ""
        clock.sleep(0.04)


def test_a_robot_whose_time_jumps_may_be_as_far_as_its_own_time_allows_and_stands_still_only_in_the_drivers() -> None:
    clock, skipped = Ticks(), 0.0
    clock.robot = lambda: clock.now() + skipped
    seen = watch(clock)

    assert "expected at most" in watch(clock).objection(0.4 * END, False)
    skipped = 1.0
    assert seen.objection(0.4 * END, False) == ""
    assert "expected at most" in seen.objection(0.9 * END, False)
    skipped = 9.0  # a report from before the jump
    assert seen.objection(0.4 * END, False) == ""
    clock.sleep(3.1)
    assert "no progress for 3.1 s" in seen.objection(0.4 * END, False)


def test_a_robot_that_runs_on_with_the_input_closed_is_told_on_unless_it_retracts_or_the_input_flickers() -> None:
    clock = Ticks()
    stuck, flickers, retracts = watch(clock), watch(clock), watch(clock, from_contact=True)
    said = list[str]()

    for step in range(10):
        clock.sleep(0.1)
        q = 0.05 * (step + 1) * END
        said.append(stuck.objection(q, step >= 2))
        assert flickers.objection(q, step % 3 == 2) == ""
        assert retracts.objection(q, True) == ""

    assert said[:8] == [""] * 8
    assert "with the touch input closed" in said[9]
