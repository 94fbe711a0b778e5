"""The conversation with linuxcncrsh, the telnet server of LinuxCNC: one request, one answer, then the next."""

import re
import secrets

from probe.line.clock import Clock
from probe.line.controller import LinkLost, TouchError
from probe.line.transcript import Transport

ENDS = re.compile(rb"[\r\n]+")  # it ends lines with CR LF, with LF CR, and with both
VOID = "(\r\n"  # ends a request that was cut short so that it cannot run: half a line of G-code may be a motion, too
GREETED = 2.5  # [s] on the wall: a person waits for this
LONGEST = 4096  # [bytes] of a line that has not ended: what came before is thrown away
ANSWERED = 2.0  # [s] on the wall; it answers a `get` in 0.1 ms and a `set` in 0.1 to 0.2 s


class Shell:
    """Requests and answers, kept in step even where an answer was not waited for."""

    def __init__(self, transport: Transport, clock: Clock, password: str = "EMC", enable: str = "EMCTOO") -> None:
        self.transport = transport
        self.clock = clock
        self._passwords = password, enable
        self._rest = b""
        self._heard: list[str] = []
        self._in_step = False

    def greet(self) -> None:
        """Say hello and take control; raises LinkLost where nobody answers, TouchError where we are not let in."""
        password, enable = self._passwords
        self._rest, self._heard, self._in_step = b"", [], False
        self._send(f"hello {password} touchcal 1")
        if self._until(r"HELLO (ACK|NAK).*", GREETED, "is linuxcncrsh running?")[1] == "NAK":
            raise TouchError(f"linuxcncrsh does not take the password '{password}'; start it with its usual ones")
        for request in ("echo off", f"enable {enable}", "verbose on"):  # each without an answer until all are heard
            self._send(f"set {request}")
        if not self.set("set_wait received"):
            raise TouchError(f"linuxcncrsh does not take the password '{enable}'; start it with its usual ones")

    def get(self, name: str) -> str:
        """A value of LinuxCNC; raises LinkLost."""
        return self._ask(f"get {name}", rf"{name.upper()}(?: (.*))?")[1] or ""

    def set(self, request: str) -> bool:
        """Have something done; False where linuxcncrsh refuses. Raises LinkLost."""
        verb = request.partition(" ")[0].upper()
        return self._ask(f"set {request}", rf"SET {verb} (ACK|NAK)")[1] == "ACK"

    def numbers(self, name: str) -> list[float]:
        """The numbers of a value; raises LinkLost."""
        text = self.get(name)
        try:
            return [float(word) for word in text.split()]
        except ValueError:
            raise LinkLost(f"linuxcncrsh answered '{text}' to 'get {name}', expected numbers") from None

    def messages(self) -> list[str]:
        """The error messages that nobody has read yet; each question fetches one."""
        lines: list[str] = []
        silent = 0
        while silent < 3 and len(lines) < 100:
            text = self.get("error")
            silent = silent + 1 if text == "OK" else 0
            lines += [text] if text != "OK" else []
        return list(dict.fromkeys(lines))

    def abort(self) -> None:
        """Stop everything, at once: also where the answer to an earlier request has not been waited for."""
        self._in_step = False
        self._send(f"{VOID}set abort")
        self._catch_up()

    def reopen(self) -> None:
        """Open the port anew and take control again; raises LinkLost where that is not possible yet."""
        self.transport.reopen()
        self.greet()

    def _ask(self, request: str, answer: str) -> re.Match[str]:
        if not self._in_step:
            self._catch_up()
        self._in_step = False
        self._send(request)
        answers = self._until(answer)
        self._in_step = True
        return answers

    def _catch_up(self) -> None:
        """Leave behind whatever is still to be heard, by a question that only this answer fits."""
        marker = f"SYNC{secrets.token_hex(3).upper()}"
        self._send(f"{VOID}get {marker}")
        self._until(f"GET {marker} NAK")
        self._in_step = True

    def _send(self, request: str) -> None:
        self.transport.write(f"{request}\r\n".encode("ascii"))

    def _until(
        self, pattern: str, patience: float = ANSWERED, cure: str = "is LinuxCNC still running?"
    ) -> re.Match[str]:
        deadline = self.clock.now() + self.clock.at_least(patience, patience)
        other = ""
        while True:
            while self._heard:
                line = self._heard.pop(0)
                if match := re.fullmatch(pattern, line):
                    return match
                other = other or line
            if self.clock.now() > deadline:
                raise LinkLost(f"{self._unexpected(other)} at {self.transport.url}; {cure}")
            data = self._rest + self.transport.read(0.1)
            *whole, self._rest = ENDS.split(data)
            self._rest = self._rest[-LONGEST:]
            self._heard += [line.decode("latin-1") for line in whole if line]

    def _unexpected(self, line: str) -> str:
        return f"something else than linuxcncrsh answers ('{line[:60]}')" if line else "nothing answers"
