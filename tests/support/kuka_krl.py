"""An interpreter of the KRL statements that touchcal emits, written from KUKA's manual for system integrators.

Statement -> semantics: `PTP {A1 ..}`: joint motion, the slowest axis at its $VEL_AXIS percent decides the time.
`LIN_REL {X ..}`: the tip goes straight by a vector of $BASE, the orientation stays ($ORI_TYPE=#CONSTANT), $VEL.CP
in m/s. `INTERRUPT DECL n WHEN c DO f ( )` declares, `INTERRUPT ON n` watches from then on for a rising edge: the
input must be FALSE then ($MEAS_PULSE refuses otherwise). At the edge f runs at once; `BRAKE` stops on the path;
$AXIS_INT are the axes at the edge; `RESUME` gives up the motion and goes on behind the call of the subprogram that
ran, in the level where the interrupt was declared, and needs $ADVANCE=0. `HALT` waits for start. Values of
variables declared in the .dat stay in it.
"""

import re

import numpy as np
from blocks import tree

from identify.model.frames import rotation

KINDS = ((r"IF .* THEN", r"ELSE", r"ENDIF"), (r"FOR \w+=.* TO .*", None, r"ENDFOR"), (r"WHILE .*", None, r"ENDWHILE"))
NUMBER = r"[+-]?\d+\.?\d*"


class Resumed(Exception):
    """RESUME was reached."""


class Returned(Exception):
    """The end of a routine."""


class KukaKRL:
    """One module, source and data."""

    def __init__(self, machine, files: dict[str, str], name: str) -> None:
        self.machine, self.files, self.name = machine, files, name
        self.values: dict = {}
        self.velocity: dict[int, float] = {}
        self.cp = 0.0
        self.advance = 3
        self.interrupt: dict = {}
        self.timer = None
        self.axis_int = None
        self.routines: dict[str, tuple[list, str]] = {}
        self._read_source(files[f"{name}.src"])
        if f"{name}.dat" in files:
            self._read_data(files[f"{name}.dat"])

    def _read_source(self, text: str) -> None:
        lines = [line.strip() for line in text.split("\r\n")]
        assert lines[0] == "&ACCESS RVP"
        name, body = "", []
        for line in (line for line in lines if line and not line.startswith(("&", ";"))):
            if match := re.fullmatch(r"DEF (\w+) \((?: | (\w+) :IN ?)\)", line.replace("(N", "( N")):
                name, argument, body = match[1], match[2] or "", []
                assert len(name) <= 24
            elif line == "END":
                self.routines[name] = (tree(body, KINDS), argument)
            else:
                body.append(line)

    def _read_data(self, text: str) -> None:
        lines = [line for line in text.split("\r\n") if line and not line.startswith(("&", ";"))]
        assert lines[0] == f"DEFDAT {self.name} PUBLIC"
        assert lines[-1] == "ENDDAT"
        self.order = []
        for line in lines[1:-1]:
            if match := re.fullmatch(r"DECL (\w+) (\w+)\[(\d+)\]", line):
                self.values[match[2]] = {}
                self.order.append((line, None))
            elif match := re.fullmatch(r"(?:DECL (\w+) )?(\w+)(?:\[(\d+)\])?=(.*)", line):
                self._store(match[2], match[3], self.value(match[4]))
                self.order.append((line.split("=")[0], (match[2], match[3])))
            else:
                raise AssertionError(line)

    def _store(self, name: str, index, value) -> None:
        if index is None:
            self.values[name] = value
        else:
            self.values[name][int(index)] = value

    def data(self) -> str:
        """The .dat as it is archived: its values are the last."""
        out = ["&ACCESS RVP", "&REL 2", f"DEFDAT {self.name} PUBLIC"]
        for text, place in self.order:
            if place is None:
                out.append(text)
                continue
            value = self.values[place[0]] if place[1] is None else self.values[place[0]][int(place[1])]
            out.append(f"{text}={shown(value)}")
        return "\r\n".join([*out, "ENDDAT", ""])

    def run(self) -> None:
        self.call(self.name)

    def call(self, name: str, argument=None) -> None:
        body, parameter = self.routines[name]
        if parameter:
            self.values[parameter] = argument
        declared, self.interrupt = self.interrupt, dict(self.interrupt)  # a level sees those above it
        try:
            self.block(body)
        finally:
            self.interrupt = declared

    def block(self, nodes) -> None:
        for node in nodes:
            if isinstance(node, str):
                self.step(node)
            elif match := re.fullmatch(r"IF (.*) THEN", node[0]):
                self.block(node[1] if self.value(match[1]) else node[2])
            elif match := re.fullmatch(r"FOR (\w+)=(.*) TO (.*)", node[0]):
                for k in range(int(self.value(match[2])), int(self.value(match[3])) + 1):
                    self.values[match[1]] = k
                    self.block(node[1])
            elif match := re.fullmatch(r"WHILE (.*)", node[0]):
                while self.value(match[1]):
                    self.block(node[1])

    def step(self, line: str) -> None:
        machine = self.machine
        if re.fullmatch(r"INT \w+|BAS \(#INITMOV,0\)|\$(TOOL|BASE)=\S+|\$IPO_MODE=#BASE|\$TIMER_STOP\[1\]=\w+", line):
            return
        if line == "$ORI_TYPE=#CONSTANT":
            self.constant = True
        elif line == "HALT":
            machine.pause("HALT")
        elif line == "RESUME":
            assert self.advance == 0
            raise Resumed
        elif line == "BRAKE":
            assert self.axis_int is not None, "BRAKE stands in interrupt routines alone"
        elif match := re.fullmatch(r"WAIT SEC (\S+)", line):
            machine.wait(float(match[1]))
        elif match := re.fullmatch(r"PTP (\{.*\}|\w+)", line):
            axes = self.value(match[1])
            counts = np.array([axes[f"A{k}"] for k in range(1, 7)])
            step = np.abs(machine.q(counts) - machine.robot.q)
            share = np.array([self.velocity[k] / 100 for k in range(1, 7)])
            machine.move(counts, seconds=float((step / (share * machine.cell.robot.speed)).max()))
        elif match := re.fullmatch(r"LIN_REL (\w+)", line):
            self.line(self.value(match[1]))
        elif match := re.fullmatch(r"INTERRUPT DECL (\d+) WHEN (\$\w+\[\d+\])==TRUE DO (\w+) \( \)", line):
            self.interrupt[int(match[1])] = [match[3], False]
        elif match := re.fullmatch(r"INTERRUPT (ON|OFF) (\d+)", line):
            assert match[1] == "OFF" or not machine.closed, "the measuring input is active already"
            self.interrupt[int(match[2])][1] = match[1] == "ON"
        elif match := re.fullmatch(r"(\$?[\w.]+)(?:\[(\w+)\])?=(.*)", line):
            self.assign(match[1], match[2], self.value(match[3]))
        elif match := re.fullmatch(r"(\w+) \( ?(\w*) ?\)", line):
            self.enter(match[1], int(match[2]) if match[2] else None)
        else:
            raise AssertionError(f"not a statement of the manual: {line}")

    def enter(self, name: str, argument) -> None:
        """A subprogram; RESUME in an interrupt routine ends it, if the interrupt was declared here."""
        try:
            self.call(name, argument)
        except Resumed:
            if not self.interrupt:
                raise

    def assign(self, name: str, index, value) -> None:
        if name == "$VEL_AXIS":
            assert value == int(value)
            assert 1 <= value <= 100
            self.velocity[int(self.value(index))] = value
        elif name == "$VEL.CP":
            self.cp = value
        elif name == "$ADVANCE":
            self.advance = value
        elif name == "$TIMER":
            self.timer = self.machine.robot.time
        else:
            assert name in self.values or name == "I", f"{name} is not declared"
            self._store(name, None if index is None else self.value(index), value)

    def line(self, frame) -> None:
        machine = self.machine
        assert self.constant
        assert not any(frame[k] for k in "ABC")
        position, R = machine.pose(machine.counts)
        jig_R_base = rotation(*machine.cell.base[3:])
        goal = position + jig_R_base @ np.array([frame[k] for k in "XYZ"])
        latch = machine.search_line(goal, R, 1000 * self.cp)
        active = [routine for routine, on in self.interrupt.values() if on]
        if latch is not None and active:
            self.axis_int = latch
            self.call(active[0])

    def value(self, text: str):
        text = str(text).strip()
        if match := re.fullmatch(r"\{(.*)\}", text):
            pairs = (word.split() for word in match[1].split(","))
            return {name: float(number) for name, number in pairs}
        text = re.sub(r"\bTRUE\b", "True", re.sub(r"\bFALSE\b", "False", text))
        text = re.sub(r"\bAND\b", "and", text)
        return eval(re.sub(r"\$", "S_", text), {"__builtins__": {}}, _Names(self))


class _Names(dict):
    """Variables by name; those of the system when they are asked for."""

    def __init__(self, krl) -> None:
        super().__init__()
        self.krl = krl

    def __missing__(self, name: str):
        krl, machine = self.krl, self.krl.machine
        if name == "S_MEAS_PULSE":
            return dict.fromkeys(range(1, 6), machine.closed)
        if name == "S_TIMER":
            return {1: 1000 * (machine.robot.time - krl.timer)}
        if name in ("S_AXIS_ACT", "S_AXIS_INT"):
            counts = machine.counts if name == "S_AXIS_ACT" else krl.axis_int
            return {f"A{k + 1}": value for k, value in enumerate(counts)} | {f"E{k}": 0.0 for k in range(1, 7)}
        return krl.values[name]


def shown(value) -> str:
    """A value as a data list shows it: reals with six digits behind the point."""
    if isinstance(value, dict):
        return "{" + ",".join(f"{name} {shown(float(number))}" for name, number in value.items()) + "}"
    if isinstance(value, bool):
        return str(value).upper()
    return (
        f"{value:.6g}"
        if isinstance(value, float) and abs(value) < 1
        else f"{value:.5f}"
        if isinstance(value, float)
        else str(value)
    )
