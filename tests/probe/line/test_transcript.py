"""A transcript holds every byte of both ways, whatever it is."""

import io
import os

from hypothesis import given
from hypothesis import strategies as st
from transcripts import read_transcript

from probe.line.clock import Clock
from probe.line.transcript import Recorder
from probe.line.transport import SerialTransport


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
