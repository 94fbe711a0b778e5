"""What a stream of bytes can do, and a record of what went over it."""

from typing import IO, Protocol

from probe.line.clock import Clock

LONGEST = 4096  # [bytes] without a line end before they are noted as they are


class Transport(Protocol):
    """A stream of bytes that may break and may be opened again."""

    url: str

    def write(self, data: bytes) -> None:
        """Send bytes; raises LinkLost where the port is gone."""
        ...

    def read(self, timeout: float) -> bytes:
        """Whatever has arrived, waiting up to `timeout` [s, on the wall] for the first byte; raises LinkLost."""
        ...

    def reopen(self) -> None:
        """Close and open again; raises LinkLost where the port is still gone."""
        ...

    def close(self) -> None:
        """Give the port back; harmless when that is done already."""
        ...


class Recorder:
    """A transport that writes down what was sent (>) and heard (<), a line each, with seconds since the start."""

    def __init__(self, inner: Transport, file: IO[str], clock: Clock) -> None:
        self.url = inner.url
        self._inner = inner
        self._file = file
        self._clock = clock
        self._start = clock.now()
        self._rest = {">": b"", "<": b""}

    def write(self, data: bytes) -> None:
        """Send and note bytes."""
        self._inner.write(data)
        self._note(">", data)

    def read(self, timeout: float) -> bytes:
        """Receive and note bytes."""
        data = self._inner.read(timeout)
        self._note("<", data)
        return data

    def reopen(self) -> None:
        """Open again, and note it."""
        self._flush()
        self._line("-", "reopen")
        self._inner.reopen()

    def close(self) -> None:
        """Close, and end the transcript."""
        self._flush()
        self._inner.close()
        if not self._file.closed:
            self._file.close()

    def _note(self, direction: str, data: bytes) -> None:
        *whole, self._rest[direction] = (self._rest[direction] + data).split(b"\n")
        for line in whole:
            self._line(direction, _printable(line + b"\n"))
        if len(self._rest[direction]) > LONGEST:
            self._line(direction, _printable(self._rest[direction]))
            self._rest[direction] = b""

    def _flush(self) -> None:
        for direction, rest in self._rest.items():
            if rest and not self._file.closed:
                self._line(direction, _printable(rest))
            self._rest[direction] = b""

    def _line(self, direction: str, text: str) -> None:
        self._file.write(f"{self._clock.now() - self._start:10.3f} {direction} {text}\n")
        self._file.flush()


def _printable(data: bytes) -> str:
    return data.decode("latin-1").encode("unicode_escape").decode("ascii")
