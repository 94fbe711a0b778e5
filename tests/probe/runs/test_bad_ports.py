"""A port that floods, trickles a byte a second, or says nothing: every run ends soon, and the arm stands."""

import socket
import threading
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from hostile import BACKENDS, Bench, Schedule, Trial

from identify.model.files import InputError
from probe.controllers import open_controller
from probe.line.clock import Clock
from probe.line.controller import TouchError
from probe.motion.settings import Settings

WITHIN = 10.0  # [s]
VOICES = ("deluge", "trickle", "mute")
AT = {
    "line": (3, 40, 75, 110),
    "grbl": (3, 60, 110, 150, 190),
    "linuxcnc": (3, 100, 250, 500),
}  # calls of the transport


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench()


@pytest.mark.parametrize("voice", VOICES)
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_run_at_a_port_that_is_beside_itself_ends_within_ten_seconds(
    bench: Bench, backend: str, voice: str, tmp_path: Path
) -> None:
    for call in AT[backend]:
        with bench.still(call):
            trial = Trial(bench, Schedule(call, backend, events={call: voice}), tmp_path / str(call))
            trial.path.parent.mkdir()
            with pytest.raises(TouchError) as caught:
                trial.once(Settings(search_speed=10.0))
            late = trial.clock.t - trial.line.happened_at
            trial.oracle.expect_rest(30.0, f"the port had gone {voice} at call {call}")

        assert late <= WITHIN, f"{late:.1f} s after call {call}"
        assert trial.oracle.faults == []
        assert len(str(caught.value)) < 300
        assert "\n" not in str(caught.value)


@contextmanager
def port_that(says: bytes, pause: float) -> Iterator[str]:
    """A real socket at which somebody talks without end, whatever is asked."""
    ended = threading.Event()

    def talk() -> None:
        while not ended.is_set():
            with suppress(OSError):
                line, _ = server.accept()
                with line:
                    while not ended.wait(pause):
                        line.sendall(says)

    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.2)
        thread = threading.Thread(target=talk, daemon=True)
        thread.start()
        yield f"socket://127.0.0.1:{server.getsockname()[1]}"
        ended.set()
        thread.join()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("says", "pause"), [(bytes(range(128, 250)) * 100, 0.002), (b"<", 0.5)], ids=["flood", "trickle"]
)
def test_at_a_real_port_that_talks_without_end_one_sentence_comes_and_no_memory_goes(
    bench: Bench, backend: str, says: bytes, pause: float
) -> None:
    tracemalloc.start()
    try:
        with port_that(says, pause) as url, pytest.raises(InputError) as caught:
            open_controller(url, backend, bench.cell.robot, clock=Clock(4.0))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()

    assert peak < 1e6  # bytes; the flood is ten times that
    assert any(text in str(caught.value) for text in ("makes no sense", "nobody speaks"))
