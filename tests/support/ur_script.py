"""An interpreter of the URScript that touchcal emits, written from the URScript manual.

Statement -> semantics: `movej(q, a, v)`: joint motion at v rad/s of the leading axis; with `t` in that time. A
thread begun by `run` goes on while the program that began it runs; `kill` ends it, `join` waits for it; `sync()`
waits for the next control cycle; `stopj(a)` brakes to rest. `get_actual_joint_positions()` are the encoders of this
cycle. A variable that is assigned in a function is the global one if there is one and `local` does not stand before
it. `floor` gives a whole number, `to_str` all digits of one. Blocks end with `end`.

URScript is near enough to Python to be run as Python: blocks lose their `end`, `run`, `kill` and `join` get
parentheses, a thread becomes a generator that waits at each motion.
"""

import re
import textwrap

import numpy as np

from probe.virtual.records import CONTACT, SEARCH


class Halted(Exception):
    """The program ended by itself."""


class UrScript:
    """One robot, and the PC that listens to it."""

    def __init__(self, machine, files: dict[str, str], name: str, listens: bool = True) -> None:
        self.machine, self.listens = machine, listens
        self.sent = ""
        self.thread = None
        self.tripped = False
        self.code = translated(files[f"{name}.script"])

    def run_program(self) -> None:
        names = (
            "movej",
            "stopj",
            "sync",
            "sleep",
            "get_standard_digital_in",
            "get_actual_joint_positions",
            "popup",
            "run",
            "kill",
            "join",
            "socket_open",
            "socket_close",
            "socket_send_line",
            "socket_send_string",
            "socket_send_byte",
            "halt",
            "thread_movej",
        )
        scope = {name: getattr(self, name) for name in names}
        scope |= {"floor": lambda value: int(np.floor(value)), "to_str": str, "__builtins__": {}}
        exec(self.code, scope)

    # motions and time

    def movej(self, q, a=1.4, v=1.05, t=0.0):
        assert 0 < v < 4
        self.machine.move(np.degrees(q), rate=v)

    def thread_movej(self, q, a=1.4, v=1.05, t=0.0):
        robot = self.machine.robot
        robot.new_search()
        self.tripped, self.contacts = False, len(robot.touches)
        end = self.machine.q(np.degrees(q))
        outcome = robot.begin(SEARCH, end, float(np.abs(end - robot.q).max()) / t, watch=False)
        assert outcome is None, outcome

    def sync(self):
        """To the next cycle in which something changes: nothing in the loop depends on the others."""
        robot = self.machine.robot
        outcome = robot.advance(robot.expected[1])
        if len(robot.touches) > self.contacts:
            self.tripped = True
            self.machine.latches.append(self.machine.counts)
        elif outcome is not None:
            self._resume()

    def _resume(self):
        try:
            next(self.thread)
        except StopIteration:
            self.thread = None

    def stopj(self, a):
        robot = self.machine.robot
        assert self.thread is None, "the thread still moves the robot"
        while robot.moving:
            outcome = robot.advance(robot.due)
        assert outcome.kind == CONTACT

    def sleep(self, seconds):
        self.machine.wait(seconds)

    def run(self, thread):
        self.thread = thread()
        next(self.thread)
        return self.thread

    def kill(self, handle):
        assert handle is self.thread
        self.thread = None

    def join(self, handle):
        while self.thread is not None:
            self.sync()

    # inputs, joints, the socket

    def get_standard_digital_in(self, number):
        assert 0 <= number <= 7
        return self.tripped if self.machine.robot.moving else self.machine.closed

    def get_actual_joint_positions(self):
        return np.radians(self.machine.counts)

    def popup(self, text, title="", blocking=False):
        assert blocking
        self.machine.pause(text)

    def halt(self):
        raise Halted

    def socket_open(self, host, port, name):
        return self.listens

    def socket_close(self, name):
        self.listens = False

    def socket_send_line(self, text, name):
        self.sent += text + "\n"

    def socket_send_string(self, text, name):
        self.sent += text

    def socket_send_byte(self, value, name):
        self.sent += chr(value)


def translated(text: str) -> str:
    """The script as Python."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    shared = {match[1] for line in lines if (match := re.match(r"(\w+) = ", line))}
    out, local, inside = [], set(), ""
    for line in lines:
        indent, code = re.match(r"( *)(.*)", line).groups()
        if code == "end":
            continue
        if match := re.match(r"(def|thread) (\w+)\((.*)\):", code):
            inside, local = match[1], set(match[3].split(", "))
            out.append(f"{indent}def {match[2]}({match[3]}):")
            out.append(f"{indent}  global {', '.join(sorted(shared - local))}")
            continue
        inside = inside if indent else ""
        if match := re.match(r"local (\w+) = ", code):
            assert match[1] not in shared
            code = code.removeprefix("local ")
        code = re.sub(r"\brun (\w+)\(\)", r"run(\1)", code)
        code = re.sub(r"^(kill|join) (\w+)$", r"\1(\2)", code)
        code = "halt()" if code == "halt" else code
        if inside == "thread" and code.startswith("movej("):
            code = f"yield thread_{code}"
        out.append(indent + code)
    return textwrap.dedent("\n".join(out))
