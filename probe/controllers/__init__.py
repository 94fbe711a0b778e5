"""Robot controllers by the protocol they speak, and who it is that answers where it is another.

In the order in which data walks through:

    line              TOUCH/1 over a serial line or a socket
    grbl_words        reports, probe results and motions of GRBL as text
    grbl_link         lines to and from a GRBL that echoes messages
    grbl              six-axis GRBL 1.1 and grblHAL
    linuxcncrsh       the conversation with linuxcncrsh, the telnet server of LinuxCNC
    linuxcnc_machine  what LinuxCNC can be asked through linuxcncrsh, in its own units
    linuxcnc_mdi      motions and questions in the language of LinuxCNC
    linuxcnc          a LinuxCNC whose axes X Y Z A B C are the joints of the robot
    counted           a controller that counts the joints otherwise than the model
"""

import re
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any

from identify.model.files import InputError, nearest
from identify.model.robot import Robot
from probe.controllers.counted import Counted
from probe.line.clock import Clock
from probe.line.controller import Controller, LinkLost, TouchError, Unwritten
from probe.line.transcript import Transport

PROTOCOLS = {
    "line": "probe.controllers.line:Line",
    "grbl": "probe.controllers.grbl:Grbl",
    "linuxcnc": "probe.controllers.linuxcnc:LinuxCNC",
}
VOICES = {  # what each is heard to say, even to a language that is not its own
    "line": rb"TOUCH/1|\? NAK\*[0-9A-F]{4}",
    "grbl": rb"Grbl|\[VER:|\[MSG:|\[GC:|^(ok|error:\d+|ALARM:\d+)\r?$|<\w+(:\d)?\|",
    "linuxcnc": rb"^(HELLO|SET|GET|SHUTDOWN) (ACK|NAK)|^[A-Z_]+ (ACK|NAK)\r?$",
}
ENOUGH = 4096  # bytes to recognise a voice by


class _Overheard:
    """A transport that keeps the first bytes it hears."""

    def __init__(self, inner: Transport, expected: str) -> None:
        self.url, self.heard, self._inner = inner.url, b"", inner
        self.expected = expected if expected in VOICES else ""  # nobody knows what a controller of the user's own says
        self.write, self.reopen, self.close = inner.write, inner.reopen, inner.close

    def read(self, timeout: float) -> bytes:
        """As the transport does; raises LinkLost as soon as somebody else than expected is heard."""
        data = self._inner.read(timeout)
        if self.expected and data and len(self.heard) < ENOUGH:
            self.heard += data
            if recognised(self.heard) not in ("", self.expected):
                raise LinkLost("somebody else answers")
        return data


def open_controller(
    port: str,
    protocol: str,
    robot: Robot,
    *,
    baud: int = 115200,
    clock: Clock | None = None,
    transcript: Path | None = None,
    **options: Any,
) -> Controller:
    """Open a port and find the controller of the robot there; nothing moves.

    `clock` runs faster than the wall where a simulated cell does (`Clock(20)`); `transcript` is written with what goes
    over the line; `options` are those of the backend (`home=True`, `axis_unit_deg=0.1`). Raises InputError with one
    sentence: the protocol unknown, the port absent or taken, nobody or somebody else there, a wrong baud rate.
    """
    if protocol not in PROTOCOLS:
        names = ", ".join(PROTOCOLS)
        raise InputError(f"protocol '{protocol}' is unknown{nearest(protocol, PROTOCOLS)}; there are {names}")
    from probe.line.transport import open_port

    clock = clock or Clock()
    module, _, name = PROTOCOLS[protocol].partition(":")
    backend = getattr(import_module(module), name)
    for option in options:
        if option not in signature(backend).parameters:
            raise InputError(
                f"protocol '{protocol}' has no option '{option}'; leave it out, or choose another protocol"
            )
    transport = _Overheard(open_port(port, baud, clock, transcript), protocol)
    try:
        controller = backend(transport, robot, clock, **options)
        try:
            controller.connect()
        except Unwritten:  # a busy computer: once more from the start
            transport.reopen()
            controller.connect()
        transport.expected = ""
    except TouchError as error:
        transport.close()
        raise InputError(_why_not(port, protocol, baud, transport.heard, error)) from None
    except BaseException:
        transport.close()
        raise
    return Counted(controller, robot) if robot.counting.differs else controller


def recognised(heard: bytes) -> str:
    """The protocol that was overheard, or nothing."""
    return next((name for name, voice in VOICES.items() if re.search(voice, heard, re.MULTILINE)), "")


def _why_not(port: str, protocol: str, baud: int, heard: bytes, error: TouchError) -> str:
    if "is gone" in str(error) and not heard:
        return f"'{port}' hangs up; is another program connected to it?"
    other = recognised(heard)
    if not isinstance(error, LinkLost):
        return f"the controller at '{port}' cannot be used: {error}"
    if other and other != protocol:
        return f"the controller at '{port}' speaks {other}, not {protocol}; say --protocol {other}"
    if heard and not other:
        return f"what comes from '{port}' makes no sense; is {baud} its baud rate, and {protocol} its protocol?"
    return f"nobody speaks {protocol} at '{port}'; is the controller on, and the cable in the right port?"
