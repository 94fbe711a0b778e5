"""A host of the virtual cell made by hand: bytes over a pseudo-terminal or a socket, and a CRC computed bit by bit."""

import os
import select
import socket
import time
import tty

import numpy as np


def crc(text: str) -> str:
    """CRC-16/CCITT, start FFFF, polynomial 1021, most significant bit first."""
    register = 0xFFFF
    for byte in text.encode():
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1 ^ 0x1021 if register & 0x8000 else register << 1) & 0xFFFF
    return f"{register:04X}"


def line(text: str) -> bytes:
    return f"{text}*{crc(text)}\n".encode()


class RawHost:
    """Whoever holds the other end of a virtual cell's port."""

    def __init__(self, url: str) -> None:
        self._buffer = b""
        self._socket = None
        if url.startswith("socket://"):
            host, port = url.removeprefix("socket://").split(":")
            self._socket = socket.create_connection((host, int(port)))
            self._file = self._socket.fileno()
        else:
            self._file = os.open(url, os.O_RDWR | os.O_NOCTTY)
            tty.setraw(self._file)

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
        else:
            os.close(self._file)

    def send(self, data: bytes) -> None:
        os.write(self._file, data)

    def read(self, timeout: float = 5.0) -> str:
        """The next line without its end; raises TimeoutError where none comes, OSError where the port is gone."""
        deadline = time.monotonic() + timeout
        while b"\n" not in self._buffer:
            if not select.select([self._file], [], [], max(0.0, deadline - time.monotonic()))[0]:
                raise TimeoutError(f"no line within {timeout} s, got {self._buffer!r}")
            data = os.read(self._file, 4096)
            if not data:
                raise OSError("the port is gone")
            self._buffer += data
        raw, _, self._buffer = self._buffer.partition(b"\n")
        return raw.decode("ascii", "replace").rstrip("\r")

    def silent(self, seconds: float) -> bool:
        """Whether nothing comes for a while."""
        return not self._buffer and not select.select([self._file], [], [], seconds)[0]

    def say(self, text: str, timeout: float = 5.0) -> str:
        """One numbered line of TOUCH/1, and the first answer, its CRC judged and taken off."""
        self.send(line(text))
        return self.hear(timeout)

    def hear(self, timeout: float = 5.0) -> str:
        text, star, check = self.read(timeout).rpartition("*")
        assert star, f"no CRC in {check!r}"
        assert check == crc(text), f"wrong CRC in {text}*{check}"
        return text


def joints(q: np.ndarray) -> str:
    """Degrees between commas, as TOUCH/1 writes them."""
    return ",".join(f"{value:.6f}" for value in np.degrees(q))


def field(answer: str, key: str) -> str:
    """The value of key=value in an answer."""
    return dict(word.split("=", 1) for word in answer.split() if "=" in word)[key]


def angles(answer: str, key: str = "q") -> np.ndarray:
    return np.radians([float(value) for value in field(answer, key).split(",")])
