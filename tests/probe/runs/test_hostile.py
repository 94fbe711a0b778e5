"""Schedules of the hostile bench: a few of each backend here, thousands by `python -m tests.probe.hostile`."""

import pytest
from hostile import BACKENDS, Bench

COUNT = {"line": 24, "grbl": 4, "linuxcnc": 10}  # a schedule over GRBL polls most, and takes longest


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench()


@pytest.mark.parametrize("backend", BACKENDS)
def test_no_schedule_makes_a_wrong_touch_or_a_wrong_motion(bench: Bench, backend: str) -> None:
    broken = {seed: bench.violations(seed, backend) for seed in range(COUNT[backend])}

    assert {seed: texts for seed, texts in broken.items() if texts} == {}
