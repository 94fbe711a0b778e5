"""Bytes over a real pseudo-terminal and a real socket; framing against zlib-free arithmetic; ports that are none."""

import os
import pty
import socket
import tty

import pytest

from identify.model.files import InputError
from probe.line.clock import Clock
from probe.line.controller import LinkLost
from probe.line.transport import SerialTransport, open_port


def test_a_pseudo_terminal_carries_bytes_both_ways(terminal: tuple[int, str]) -> None:
    far, name = terminal
    port = SerialTransport(name)

    port.write(b"\x00ping\r\n")
    os.write(far, b"pong\xff\n")

    assert os.read(far, 100) == b"\x00ping\r\n"
    assert port.read(1.0) == b"pong\xff\n"
    assert port.read(0.0) == b""
    port.close()


def test_a_port_that_is_taken_is_refused_and_free_again_after_closing(terminal: tuple[int, str]) -> None:
    _, name = terminal
    first = open_port(name, 115200, Clock())

    with pytest.raises(InputError, match="taken by another program"):
        open_port(name, 115200, Clock())
    first.close()
    open_port(name, 115200, Clock()).close()


def test_a_cable_that_is_pulled_is_noticed_by_reading_and_by_writing() -> None:
    far, near = pty.openpty()
    tty.setraw(near)
    port = SerialTransport(os.ttyname(near))
    os.close(near)
    os.close(far)

    with pytest.raises(LinkLost, match="is gone"):
        port.read(0.5)
    with pytest.raises(LinkLost, match="is gone"):
        port.write(b"x")
    with pytest.raises(LinkLost, match="is gone"):
        port.reopen()
    with pytest.raises(LinkLost, match="is gone"):
        port.read(0.1)


def test_a_socket_is_a_port_and_can_be_opened_again_after_the_server_hung_up() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = SerialTransport(f"socket://127.0.0.1:{server.getsockname()[1]}")
        peer, _ = server.accept()
        peer.sendall(b"hello\n")
        assert port.read(1.0) == b"hello\n"
        peer.close()
        with pytest.raises(LinkLost):
            port.read(1.0)

        port.reopen()
        peer, _ = server.accept()
        port.write(b"again\n")

        assert peer.recv(100) == b"again\n"
        peer.close()
        port.close()


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("/dev/ttyTHERE_IS_NONE", "does not exist"),
        ("socket://127.0.0.1:1", "nothing listens"),
        ("carrier://pigeon", "is no port"),
        ("/dev/null", "not a serial port"),
    ],
)
def test_what_is_no_port_gets_one_sentence(url: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as error:
        open_port(url, 115200, Clock())

    assert "\n" not in str(error.value)
