"""GRBL takes a motion of which one digit was changed on its way: the arm is stopped within half a millimetre."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress

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


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench()


@contextmanager
def grbl_of(bench: Bench, unit: float, axis: str, digit: str) -> Iterator[tuple[Grbl, TrueWorld, OneDigit]]:
    with bench.still(1):
        clock = Ticks()
        world = TrueWorld(bench.cell, bench.theta, clock, bench.plan.approach[0])
        line = OneDigit(GrblDevice(world, clock, bench.truth, unit), axis, digit)
        grbl = Grbl(line, bench.cell.robot, clock, axis_unit_deg=unit)
        grbl.connect()
        yield grbl, world, line


@pytest.mark.parametrize("unit", [0.1, 1.0])
@pytest.mark.parametrize("kind", ["move", "search"])
def test_a_changed_digit_leads_half_a_millimetre_astray_at_most(bench: Bench, kind: str, unit: float) -> None:
    start, contact = bench.plan.approach[0], bench.plan.q[0]
    # as fast as the driver goes: 10 mm/s in a search, 500 mm/s between touches
    end, seconds = (start + 1.5 * (contact - start), 3.0) if kind == "search" else (bench.plan.approach[1], 0.7)
    rate = float(np.abs(end - start).max() / seconds)
    for axis in AXES:
        for digit in "1248":
            with grbl_of(bench, unit, axis, digit) as (grbl, world, line):
                with suppress(Refused):  # a change that leads hardly astray is not seen
                    getattr(grbl, kind)(end, rate)
                line.device.follow()
                at = line.device.at()
                way = end - start
                nearest = start + np.clip((at - start) @ way / (way @ way), 0, 1) * way
                tips = world.chain.tip(np.stack([at, nearest]))

                assert line.spoiled == 1
                assert np.linalg.norm(tips[0] - tips[1]) <= ASTRAY, (axis, digit)
                assert not line.device.moving
