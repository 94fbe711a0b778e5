"""Bytes to and from a serial port, whatever it is made of: the only place that opens one."""

import errno
import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import serial
from serial.tools import list_ports

from identify.model.files import InputError
from probe.line.clock import Clock
from probe.line.controller import LinkLost, Unwritten
from probe.line.transcript import Recorder, Transport

MOST = 4096  # [bytes] read at once: a port that never falls silent must not keep the reader
POLL = 0.005  # [s] real: changing pyserial's timeout reconfigures the port, so it is set once and waited for in steps


class SerialTransport:
    """A port of pyserial by URL: /dev/ttyUSB0, COM5, socket://host:port, rfc2217://host:port."""

    def __init__(self, url: str, baud: int = 115200) -> None:
        self.url = url
        self.baud = baud
        self._port: Any = self._open()  # pyserial types its platforms apart

    def _open(self) -> Any:
        return serial.serial_for_url(self.url, self.baud, timeout=POLL, write_timeout=1.0, exclusive=True)

    def write(self, data: bytes) -> None:
        """Send bytes; raises LinkLost where the port is gone or takes nothing for a second."""
        try:
            self._ready().write(data)
        except serial.SerialTimeoutException as error:  # also where all was written, and this process had to wait
            raise self._lost(error, Unwritten) from error
        except (serial.SerialException, OSError) as error:
            raise self._lost(error) from error

    def read(self, timeout: float) -> bytes:
        """Whatever has arrived, waiting up to `timeout` [s, on the wall] for the first byte; raises LinkLost."""
        try:
            port = self._ready()
            data = b""
            for _ in range(math.ceil(timeout / POLL)):
                data = port.read(1)
                if data:
                    break
            else:
                data = port.read(1) if port.in_waiting else b""
            while 0 < len(data) < MOST and (waiting := port.in_waiting):  # a socket tells only that something waits
                data += port.read(waiting)
        except (serial.SerialException, OSError, TypeError) as error:  # TypeError: pyserial, closed under a reader
            raise self._lost(error) from error
        return data

    def reopen(self) -> None:
        """Close and open again; raises LinkLost where the port is still gone."""
        self.close()
        try:
            self._port = self._open()
        except (serial.SerialException, OSError) as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Give the port back; harmless when that is done already."""
        port, self._port = self._port, None
        if port is None:
            return
        socket_of_port = getattr(port, "_socket", None)
        with suppress(serial.SerialException, OSError):  # it was gone before
            port.close()
        if socket_of_port is not None:
            socket_of_port.close()  # pyserial leaves it open where the other side has hung up

    def _ready(self) -> Any:
        if self._port is None:
            raise serial.SerialException("the port is closed")
        return self._port

    def _lost(self, error: Exception, kind: type[LinkLost] = LinkLost) -> LinkLost:
        return kind(f"port {self.url} is gone ({error}); plug the cable in again, then go on with --resume")


def open_port(url: str, baud: int, clock: Clock, transcript: Path | None = None) -> Transport:
    """Open a port, and a transcript of what goes over it where one is wanted; raises InputError with the reason."""
    try:
        port = SerialTransport(url, baud)
    except (serial.SerialException, OSError, ValueError) as error:
        raise InputError(_why_not(url, error)) from None
    if transcript is None:
        return port
    try:
        return Recorder(port, transcript.open("w", encoding="ascii", newline="\n"), clock)
    except OSError as error:
        port.close()
        raise InputError(f"{transcript}: cannot be written: {error.strerror}; choose another place") from None


def _why_not(url: str, error: Exception) -> str:
    number, text = getattr(error, "errno", None), str(error)
    if isinstance(error, ValueError):
        return f"port '{url}' is no port: {error}; write /dev/ttyUSB0, COM5, socket://host:port or rfc2217://host:port"
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in text or "Access is denied" in text:
        return f"port '{url}' is taken by another program; close that program first"
    if number in (errno.EACCES, errno.EPERM):
        return f"port '{url}' may not be opened by you; on Linux, join its group: sudo usermod -aG dialout $USER"
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO) or "FileNotFoundError" in text:
        return f"port '{url}' does not exist; {_existing()}"
    if "refused" in text:
        return f"nothing listens at '{url}'; start the controller's server, or correct host and port"
    if number == errno.ENOTTY or "(25," in text:
        return f"'{url}' is not a serial port; {_existing()}"
    return f"port '{url}' cannot be opened: {text}"


def _existing() -> str:
    ports = [port.device for port in list_ports.comports()]
    return f"ports of this machine: {', '.join(ports)}" if ports else "this machine has no serial port: plug it in"
