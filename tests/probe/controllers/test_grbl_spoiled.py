"""GRBL takes a motion for another one: the arm is stopped within half a millimetre."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import pytest
from hostile import Bench
from hostile_devices import GrblDevice
from touching import Ticks
from true_world import TrueWorld

from probe.controllers.grbl import Grbl
from probe.line.controller import Refused

ASTRAY = 0.5  # [mm] of the tip
AXES = "XYZABC"


class OneDigit:
    """A transport that changes one zero of the next motion into another digit, and nothing else."""

    def __init__(self, device: GrblDevice, axis: str, digit: str) -> None:
        self.device, self.url, self.spoiled = device, device.url, 0
        self._said, self._heard = f"{axis}.0".encode(), f"{axis}.{digit}".encode()
        self.read, self.reopen, self.close = device.read, device.reopen, device.close

    def write(self, data: bytes) -> None:
        if self._said in data:
            data, self.spoiled = data.replace(self._said, self._heard), self.spoiled + 1
        self.device.write(data)


class NewStart:
    """A transport before a GRBL that starts anew just before the next motion, and whose greeting is lost."""

    def __init__(self, device: GrblDevice, *_: str) -> None:
        self.device, self.url, self.spoiled = device, device.url, 0
        self.read, self.reopen, self.close = device.read, device.reopen, device.close

    def write(self, data: bytes) -> None:
        if b"G90\n" in data and not self.spoiled:
            self.device.grbl.restart()
            self.spoiled += 1
        self.device.write(data)


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench()


@contextmanager
def grbl_of(
    bench: Bench, unit: float, start: np.ndarray, transport: type, *spoil: str
) -> Iterator[tuple[Grbl, TrueWorld, Any]]:
    with bench.still(1):
        clock = Ticks()
        world = TrueWorld(bench.cell, bench.theta, clock, start)
        line = transport(GrblDevice(world, clock, bench.truth, unit), *spoil)
        grbl = Grbl(line, bench.cell.robot, clock, axis_unit_deg=unit, reach=bench.reach)
        grbl.connect()
        yield grbl, world, line


def astray(world: TrueWorld, device: GrblDevice, start: np.ndarray, end: np.ndarray) -> float:
    """How far the tip is from where a straight motion would have led it [mm]."""
    device.follow()
    at, way = device.at(), end - start
    nearest = start + np.clip((at - start) @ way / (way @ way), 0, 1) * way
    tips = world.chain.tip(np.stack([at, nearest]))
    return float(np.linalg.norm(tips[0] - tips[1]))


def motion(bench: Bench, kind: str, i: int) -> tuple[np.ndarray, np.ndarray, float]:
    """From, to, and at which rate [rad/s]: as fast as the driver goes, 10 mm/s or 500 mm/s between touches."""
    start, contact = bench.plan.approach[i], bench.plan.q[i]
    following = bench.plan.approach[(i + 1) % len(bench.plan)]
    end, seconds = (start + 1.5 * (contact - start), 3.0) if kind == "search" else (following, 0.7)
    return start, end, float(np.abs(end - start).max() / seconds)


@pytest.mark.parametrize("unit", [0.1, 1.0])
@pytest.mark.parametrize("kind", ["move", "search"])
def test_a_changed_digit_leads_half_a_millimetre_astray_at_most(bench: Bench, kind: str, unit: float) -> None:
    start, end, rate = motion(bench, kind, 0)
    for axis in AXES:
        for digit in "1248":
            with grbl_of(bench, unit, start, OneDigit, axis, digit) as (grbl, world, line):
                with suppress(Refused):  # a change that leads hardly astray is not seen
                    getattr(grbl, kind)(end, rate)

                assert astray(world, line.device, start, end) <= ASTRAY, (axis, digit)
                assert line.spoiled == 1
                assert not line.device.moving


@pytest.mark.parametrize("unit", [0.1, 1.0])
@pytest.mark.parametrize("kind", ["move", "search"])
def test_a_start_just_before_a_motion_leads_half_a_millimetre_astray_at_most(
    bench: Bench, kind: str, unit: float
) -> None:
    """The defect: modes and offset were forgotten, and the tip went 15 mm astray in a move."""
    for i in range(len(bench.plan)):
        start, end, rate = motion(bench, kind, i)
        with grbl_of(bench, unit, start, NewStart) as (grbl, world, line):
            with pytest.raises(Refused) as refusal:
                getattr(grbl, kind)(end, rate)

            assert refusal.value.code == "ASTRAY"
            assert astray(world, line.device, start, end) <= ASTRAY
            assert line.spoiled == 1
            assert not line.device.moving
