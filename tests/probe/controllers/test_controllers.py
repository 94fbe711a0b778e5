"""Finding the controller at a port: every way in which it is not there, one sentence each, and no motion."""

import os
import pty
import tty
from pathlib import Path

import numpy as np
import pytest
import serial
from transcripts import read_transcript

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.io.description import library, read_robot
from probe.controllers import PROTOCOLS, open_controller, recognised
from probe.virtual.server import serve
from probe.virtual.truth import Truth, draw_truth

HEARD = {"line": b"noise\r\n? NAK*F1B2\n", "grbl": b"\r\nGrbl 1.1h ['$' for help]\r\n", "linuxcnc": b"HELLO NAK\r\n"}


@pytest.fixture(scope="module")
def truth(arc_welder: Cell) -> Truth:
    return draw_truth(arc_welder, np.random.default_rng(3), scale=0.1)


def sentence(*arguments: object, **options: object) -> str:
    """What a user reads where no controller could be opened."""
    with pytest.raises(InputError) as error:
        open_controller(*arguments, **options)  # type: ignore[arg-type]
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("protocol", ["line", "grbl"])
def test_a_write_that_a_busy_computer_took_too_long_for_is_no_lost_port(
    arc_welder: Cell, truth: Truth, protocol: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The defect: where this process had to wait a second within a write, the port "hung up"."""
    write, calls = serial.Serial.write, list[bytes]()

    def written(self: serial.Serial, data: bytes) -> int | None:
        calls.append(data)
        done = write(self, data)
        if len(calls) == 2:
            raise serial.SerialTimeoutException("Write timeout")
        return done

    monkeypatch.setattr(serial.Serial, "write", written)
    with serve(arc_welder, truth, protocol=protocol, speed=float("inf")) as served:
        controller = open_controller(served.url, protocol, arc_welder.robot)

        assert controller.state().homed
        assert len(calls) > 3
        controller.close()


@pytest.mark.parametrize("protocol", ["line", "grbl"])
def test_a_controller_is_found_and_its_conversation_written_down(
    arc_welder: Cell, truth: Truth, protocol: str, tmp_path: Path
) -> None:
    transcript = tmp_path / "said.txt"
    with serve(arc_welder, truth, protocol=protocol, speed=float("inf")) as served:
        controller = open_controller(served.url, protocol, arc_welder.robot, transcript=transcript)
        state = controller.state()
        controller.close()

        np.testing.assert_allclose(state.q, served.robot.q, atol=1e-4)
        assert not state.moving
        said = b"".join(line for way, line in read_transcript(transcript.read_text()) if way == ">")
        assert said == b"".join(served.heard)
        assert served.robot.executed == []


@pytest.mark.parametrize(("spoken", "asked"), [("line", "grbl"), ("grbl", "line"), ("line", "linuxcnc")])
def test_a_controller_of_another_protocol_is_named(arc_welder: Cell, truth: Truth, spoken: str, asked: str) -> None:
    with serve(arc_welder, truth, protocol=spoken, speed=float("inf")) as served:
        text = sentence(served.url, asked, arc_welder.robot)

        assert f"speaks {spoken}, not {asked}; say --protocol {spoken}" in text
        assert served.robot.executed == []


@pytest.mark.parametrize("protocol", HEARD)
def test_every_protocol_is_recognised_by_its_voice(protocol: str) -> None:
    assert recognised(HEARD[protocol]) == protocol
    assert set(HEARD) == set(PROTOCOLS)


def test_noise_is_nobody_and_a_wrong_baud_rate_is_suspected(arc_welder: Cell, noisy_port: str) -> None:
    assert "is 9600 its baud rate" in sentence(noisy_port, "line", arc_welder.robot, baud=9600)


def test_a_port_with_nobody_at_it(arc_welder: Cell) -> None:
    far, near = pty.openpty()
    tty.setraw(near)

    assert "nobody speaks line" in sentence(os.ttyname(near), "line", arc_welder.robot)

    os.close(far)
    os.close(near)


def test_a_protocol_that_does_not_exist(arc_welder: Cell) -> None:
    assert "did you mean 'grbl'" in sentence("/dev/null", "gbrl", arc_welder.robot)


def test_a_port_that_is_taken_by_another_program(arc_welder: Cell, truth: Truth) -> None:
    for port in ("pty", "socket"):
        with serve(arc_welder, truth, port=port, speed=float("inf")) as served:
            first = open_controller(served.url, "line", arc_welder.robot)

            assert "another program" in sentence(served.url, "line", arc_welder.robot)

            first.state()
            first.close()


def test_a_controller_of_another_robot(arc_welder: Cell, truth: Truth) -> None:
    other = read_robot(library("robots")["scara"])
    with serve(arc_welder, truth, speed=float("inf")) as served:
        text = sentence(served.url, "line", other)

    assert f"it has 6 joints, the robot of the cell {len(other.joints)}" in text
