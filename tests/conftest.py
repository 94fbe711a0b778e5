"""What many tests share: seeded randomness, the cell of the paper, measured data that lies beside the repository."""

import os
import pty
import signal
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from linuxcncrsh_fake import FakeLinuxCNC
from measured import poses_over_jig, table_2, touches_at
from readme import Demo
from touching import Ticks

from identify.estimation.calibrate import calibrate
from identify.model.cell import Cell, Wire
from identify.model.io.calibration_file import Calibration, write_calibration
from identify.model.io.description import library, read_cell, read_jig, read_robot
from identify.model.jig import Jig
from oed.cli import main
from probe.controllers.linuxcnc import LinuxCNC
from probe.virtual.collision import Surroundings
from probe.virtual.robot import VirtualRobot

# the same examples on every run, and no deadline: this machine may be busy
settings.register_profile("touchcal", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("touchcal")

# a shell's background jobs, and the programs that they start, are not stopped by Ctrl-C; tests start some to stop them
signal.signal(signal.SIGINT, signal.default_int_handler)

# threads cost more than small matrices gain, and workers wait for each other's; theirs begin with this environment
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# lines are folded for a person, on a screen; workers are given the width of whoever runs the tests
os.environ.pop("COLUMNS", None)
os.unsetenv("COLUMNS")  # readline, which pytest loads, sets it behind os.environ

SHARED = Path(__file__).parents[2] / "shared" / "data"


def pytest_addoption(parser: pytest.Parser) -> None:
    """How many ways of the driver are judged a cell: a few in the suite, 100 by hand."""
    parser.addoption("--ways", type=int, default=0, help="ways of the driver judged a cell (tests/probe/motion)")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Function]) -> None:
    """Tests that share what takes long to make run on one worker, so that it is made once (`--dist loadgroup`).

    They share the demo, or a fixture of their module.
    """
    for item in items:
        fixtures = item._fixtureinfo.name2fixturedefs
        shared = any(definitions[-1].scope == "module" for definitions in fixtures.values())
        if (shared or "demo" in fixtures) and not item.get_closest_marker("xdist_group"):
            group = "demo" if "demo" in fixtures else str(item.path.relative_to(item.config.rootpath))
            item.add_marker(pytest.mark.xdist_group(group))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240)


@pytest.fixture(autouse=True)
def unhurt(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """No virtual robot hits anything with arm or torch in a test that is not about that.

    A test marked `collides` expects it; in one marked `ghost` arm and torch pass through everything.
    """
    collisions, collide = list[str](), VirtualRobot._collide

    def noted(robot: VirtualRobot, motion: Any) -> None:
        collisions.append(str(motion.trip.collision))
        collide(robot, motion)

    monkeypatch.setattr(VirtualRobot, "_collide", noted)
    if request.node.get_closest_marker("ghost"):
        monkeypatch.setattr(Surroundings, "first", lambda surroundings, q, theta: None)
    yield
    assert not collisions or request.node.get_closest_marker("collides"), collisions


@pytest.fixture
def unsynced(monkeypatch: pytest.MonkeyPatch) -> None:
    """No waiting for the disk: a killed program loses nothing that it wrote, a power cut is not tried here."""
    monkeypatch.setattr(os, "fsync", lambda handle: None)


@pytest.fixture(scope="session")
def arc_welder() -> Cell:
    """The cell of the paper, as the library describes it; one object, so that its functions compile once."""
    return read_cell(library("cells")["arc-welder"])


@pytest.fixture(scope="session")
def found(arc_welder: Cell) -> Calibration:
    """What a hundred touches of the paper's hidden robot tell of it."""
    rng = np.random.default_rng(5)
    touches = touches_at(arc_welder, table_2(arc_welder), poses_over_jig(arc_welder, 100, rng), rng)
    return calibrate(arc_welder, touches, folds=0, parameters="identifiable", errors="cell")


@pytest.fixture
def found_folder(arc_welder: Cell, found: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of that robot, with its cell and its calibration."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cell.yaml").write_text(library("cells")["arc-welder"].read_text())
    write_calibration(tmp_path / "calibration.json", found)
    return tmp_path


@pytest.fixture(scope="session")
def box() -> Jig:
    """A workpiece to locate."""
    return read_jig(library("jigs")["cube"])


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Demo:
    """What the first command of the README made."""
    return Demo.made(tmp_path_factory.mktemp("clone"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Measured data, not part of the repository."""
    if not SHARED.is_dir():
        pytest.skip(f"measured data is not at {SHARED}")
    return SHARED


@pytest.fixture
def touchcal(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """The command line, in this process: what it exits with, what it says, and what it says on stderr."""

    def run(*arguments: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as stop:
            main([str(argument) for argument in arguments])
        said = capsys.readouterr()
        return stop.value.code, said.out, said.err

    return run


@pytest.fixture
def linuxcnc() -> FakeLinuxCNC:
    """A stand-in for LinuxCNC that fails to order."""
    return FakeLinuxCNC(Ticks())


@pytest.fixture
def controller(linuxcnc: FakeLinuxCNC, arc_welder: Cell) -> LinuxCNC:
    """The backend, in control of that."""
    made = LinuxCNC(linuxcnc, arc_welder.robot, linuxcnc.clock)
    made.connect()
    return made


@pytest.fixture
def noisy_port() -> Iterator[str]:
    """A port whose other end speaks at another baud rate: bytes that mean nothing."""
    far, near = pty.openpty()
    tty.setraw(near)
    os.set_blocking(far, False)
    ended = threading.Event()

    def babble() -> None:
        rng = np.random.default_rng(1)
        while not ended.is_set():
            os.write(far, rng.integers(0x80, 0x100, 20, dtype=np.uint8).tobytes())
            time.sleep(0.05)

    thread = threading.Thread(target=babble)
    thread.start()
    yield os.ttyname(near)
    ended.set()
    thread.join()
    os.close(near)
    os.close(far)


@pytest.fixture(scope="session")
def irb120_cell():
    """Nobody measured where the tracker stands and where the reflector sits."""
    return Cell(read_robot(library("robots")["irb120"]), None, base=None, tool=None, wire=Wire(0.0, "point"))


@pytest.fixture(scope="session")
def irb120_measured(shared_data):
    data = np.genfromtxt(shared_data / "irb120" / "positions.csv", delimiter=",", names=True)

    def columns(*names):
        return np.column_stack([data[name] for name in names])

    return {
        "q": np.radians(columns(*(f"q{i}_deg" for i in range(1, 7)))),
        "readback": np.radians(columns(*(f"q{i}_readback_deg" for i in range(1, 7)))),
        "point": columns("x_mm", "y_mm", "z_mm"),
    }
