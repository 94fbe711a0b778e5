"""Bytes over a real pseudo-terminal and a real socket; framing against zlib-free arithmetic; ports that are none."""

import io
import os
import pty
import socket
import tty
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from identify.model.files import InputError
from probe.line.clock import Clock
from probe.line.controller import LinkLost
from probe.line.framing import LONGEST, Lines, checksum, seal, unseal
from probe.line.transcript import Recorder, read_transcript
from probe.line.transport import SerialTransport, open_port


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    """The far end of a pseudo-terminal, and the name of the near one."""
    far, near = pty.openpty()
    tty.setraw(near)
    yield far, os.ttyname(near)
    for end in (far, near):
        os.close(end)


def crc_by_division(text: bytes) -> int:
    """CRC-16/CCITT by long division in the field of two, from 0xFFFF."""
    register = 0xFFFF
    for byte in text:
        for bit in range(7, -1, -1):
            carry = (register >> 15) ^ (byte >> bit & 1)
            register = (register << 1 & 0xFFFF) ^ (0x1021 if carry else 0)
    return register


def test_the_checksum_is_the_published_one() -> None:
    assert checksum(b"123456789") == "29B1"  # the check value of CRC-16/CCITT-FALSE


@given(st.binary(max_size=60))
def test_the_checksum_is_a_division_of_polynomials(text: bytes) -> None:
    assert int(checksum(text), 16) == crc_by_division(text)


@given(st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=1, max_size=150))
def test_a_sealed_line_opens_to_what_it_was(text: str) -> None:
    (line,) = Lines().feed(seal(text))

    assert unseal(line) == text


@given(st.data())
def test_no_single_bit_changes_unseen(data: st.DataObject) -> None:
    sealed = seal(data.draw(st.from_regex(r"[1-9][0-9]{0,3} MOVE [0-9.,]{1,60}", fullmatch=True)))
    position, bit = data.draw(st.integers(0, len(sealed) - 2)), data.draw(st.integers(0, 7))
    flipped = sealed[:position] + bytes([sealed[position] ^ 1 << bit]) + sealed[position + 1 :]

    assert all(unseal(line) is None for line in Lines().feed(flipped))


@given(st.lists(st.text("abc*", min_size=1, max_size=20), max_size=8), st.data())
def test_lines_do_not_care_how_the_bytes_arrive(texts: list[str], data: st.DataObject) -> None:
    stream = b"".join(text.encode() + b"\r\n" for text in texts)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=10)))
    lines, heard = Lines(), list[bytes]()

    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        heard += lines.feed(stream[start:end])

    assert heard == [text.encode() for text in texts]


def test_a_line_without_end_does_not_fill_the_memory_and_costs_only_itself() -> None:
    lines = Lines()

    heard = [line for _ in range(1000) for line in lines.feed(b"x" * 100)]

    assert heard == []
    assert lines.feed(b"rest of it\ngood\n") == [b"good"]


def test_a_line_longer_than_the_protocol_allows_is_not_sent() -> None:
    with pytest.raises(ValueError, match="at most 200"):
        seal("x" * LONGEST)


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


def test_a_transcript_holds_every_byte_of_both_ways_in_order(terminal: tuple[int, str]) -> None:
    far, name = terminal
    file = io.StringIO()
    file.close, text = (lambda: None), file  # type: ignore[method-assign]
    port = Recorder(SerialTransport(name), file, Clock())

    port.write(b"1 MOVE\n2 half")
    os.write(far, b"\xff\\1 OK\r\n")
    port.read(1.0)
    port.write(b" line\n")
    port.write(b"end")
    port.close()

    heard = read_transcript(text.getvalue())
    assert [line for way, line in heard if way == ">"] == [b"1 MOVE\n", b"2 half line\n", b"end"]
    assert [line for way, line in heard if way == "<"] == [b"\xff\\1 OK\r\n"]


@given(st.binary(max_size=80))
def test_any_bytes_survive_a_transcript(data: bytes) -> None:
    class Echo:
        url = "test://echo"

        def write(self, data: bytes) -> None: ...
        def read(self, timeout: float) -> bytes:
            return data

        def reopen(self) -> None: ...
        def close(self) -> None: ...

    file = io.StringIO()
    file.close, text = (lambda: None), file  # type: ignore[method-assign]
    recorder = Recorder(Echo(), file, Clock())

    recorder.read(0.0)
    recorder.close()

    assert b"".join(line for _, line in read_transcript(text.getvalue())) == data


def test_a_faster_clock_waits_shorter_on_the_wall_but_never_too_short() -> None:
    clock = Clock(20.0)

    assert clock.real(2.0) == pytest.approx(0.1)
    assert clock.at_least(0.2, 0.05) == pytest.approx(1.0)
    assert clock.at_least(30.0, 0.05) == 30.0
