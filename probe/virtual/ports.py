"""The controller's end of a serial line: a pseudo-terminal or a loopback socket, which can be pulled and put back."""

import contextlib
import errno
import os
import select
import socket
import tempfile
import tty
from pathlib import Path
from typing import Protocol

from identify.model.files import InputError

BLOCK = 4096  # bytes read at once


class Port(Protocol):
    """Bytes to and from whoever holds the other end."""

    url: str  # what the host opens

    def read(self, timeout: float) -> bytes:
        """What has come, waiting for it up to `timeout` [s]; nothing where nobody speaks."""
        ...

    def write(self, data: bytes) -> None:
        """Send; what nobody takes is lost, as on a real line."""
        ...

    def unplug(self) -> None:
        """The cable is pulled: whoever has opened the port loses it."""
        ...

    def plug(self) -> None:
        """The cable is back: the same URL can be opened again."""
        ...

    def close(self) -> None:
        """Go for good."""
        ...


class PtyPort:
    """A pseudo-terminal behind a name that stays the same when the cable is pulled and put back."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="touchcal-virtual-")
        self._link = Path(self._folder.name) / "port"
        self.url = str(self._link)
        self._master = self._slave = -1
        self.plug()

    def plug(self) -> None:
        """A new pseudo-terminal under the old name."""
        if self._master >= 0:
            return
        self._master, self._slave = os.openpty()  # the slave stays open here, so that hosts may come and go
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._link.symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        """Hang up on the host."""
        if self._master < 0:
            return
        self._link.unlink(missing_ok=True)
        os.close(self._slave)
        os.close(self._master)
        self._master = self._slave = -1

    def read(self, timeout: float) -> bytes:
        """What the host has written."""
        if self._master < 0:
            select.select([], [], [], timeout)
            return b""
        if not select.select([self._master], [], [], timeout)[0]:
            return b""
        try:
            return os.read(self._master, BLOCK)
        except OSError as error:
            if error.errno in (errno.EIO, errno.EAGAIN):
                return b""
            raise

    def write(self, data: bytes) -> None:
        """Send as much as the host's buffer takes."""
        if self._master >= 0:
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, data)

    def close(self) -> None:
        """Remove the port and its name."""
        self.unplug()
        self._folder.cleanup()


class SocketPort:
    """A loopback socket that one host at a time may hold; a second one is turned away."""

    def __init__(self, number: int = 0) -> None:
        self._number = number
        self._listener: socket.socket | None = None
        self._host: socket.socket | None = None
        self.plug()
        self.url = f"socket://127.0.0.1:{self._number}"

    def plug(self) -> None:
        """Listen, on the same number as before."""
        if self._listener is None:
            self._listener = socket.create_server(("127.0.0.1", self._number), backlog=1)
            self._number = self._listener.getsockname()[1]

    def unplug(self) -> None:
        """Hang up and listen no longer."""
        for end in (self._host, self._listener):
            if end is not None:
                end.close()
        self._host = self._listener = None

    def read(self, timeout: float) -> bytes:
        """What the host has written; hosts come and go meanwhile."""
        ends = [end for end in (self._listener, self._host) if end is not None]
        ready = select.select(ends, [], [], timeout)[0]
        if self._listener in ready:
            self._accept()
        if self._host is None or self._host not in ready:
            return b""
        try:
            data = self._host.recv(BLOCK)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._host.close()
            self._host = None
        return data

    def _accept(self) -> None:
        """Take a host that knocks; while one is here, turn others away, and while one is leaving, let them wait."""
        if self._listener is None or (self._host is not None and _leaving(self._host)):
            return
        host, _ = self._listener.accept()
        if self._host is not None:
            host.close()
            return
        host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        host.setblocking(False)
        self._host = host

    def write(self, data: bytes) -> None:
        """Send, if somebody listens."""
        if self._host is not None:
            with contextlib.suppress(OSError):
                self._host.sendall(data)

    def close(self) -> None:
        """Go for good."""
        self.unplug()


def _leaving(host: socket.socket) -> bool:
    """Whether the other end has closed, though what it sent before may not be read yet."""
    poll = select.poll()
    poll.register(host, select.POLLRDHUP)
    return bool(poll.poll(0))


def open_port(kind: str) -> Port:
    """`pty`, `socket`, or `socket:PORT`; raises InputError where that is none, or taken."""
    if kind == "pty":
        return PtyPort()
    name, _, number = kind.partition(":")
    if name != "socket" or (number and not number.isdecimal()):
        raise InputError(f"port '{kind}' is unknown; choose pty, socket or socket:PORT")
    try:
        return SocketPort(int(number or 0))
    except (OSError, OverflowError) as error:
        raise InputError(f"port '{kind}' cannot be had: {error}; choose another number, or socket alone") from None
