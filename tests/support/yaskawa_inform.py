"""An interpreter of the INFORM statements that touchcal emits, written from Yaskawa's INFORM manual.

Statement -> semantics: `MOVJ Cn VJ=p`: joint motion at p percent of the joint speeds. `MOVL Cn V=v`: the tip goes
straight at v mm/s to the pose of these pulses. `MOVL Cn V=v SRCH RIN#(k)=ON DIS=d`: the same until the direct input
goes on, at most d mm; the pulses of that moment are $PX002 and $B002 is 1, else 0. `GETS x $y` reads a system
variable, $PX000 are the pulses now. `SET`, `INC`, `JUMP *L IF c`, `CALL JOB:n`, `TIMER T=s`, `WAIT IN#(n)=OFF T=s`
(goes on after s), `MSG`, `PAUSE`. A job begins with NOP and ends with END.
"""

import re

import numpy as np

UNUSED = '"UNUSED"'


class YaskawaInform:
    """Jobs of one controller, and its variables."""

    def __init__(self, machine, files: dict[str, str], per_degree: np.ndarray) -> None:
        self.machine, self.per_degree = machine, per_degree
        self.B: dict[int, int] = {}
        self.D: dict[int, int] = {}
        self.P: dict[int, np.ndarray] = {}
        self.found = (0, np.zeros(6))
        self.jobs = {
            name.removesuffix(".JBI"): self._parsed(text) for name, text in files.items() if name.endswith(".JBI")
        }

    def _parsed(self, text: str):
        lines = text.split("\r\n")
        assert lines[0] == "/JOB"
        assert len(lines[1].removeprefix("//NAME ")) <= 32
        places = [
            np.array([int(w) for w in line.split("=")[1].split(",")]) for line in lines if re.match(r"C\d{5}=", line)
        ]
        count = int(next(line for line in lines if line.startswith("///NPOS")).split()[1].split(",")[0])
        assert count == len(places)
        assert not places or "///PULSE" in lines
        body = lines[lines.index("NOP") + 1 : lines.index("END")]
        assert all(len(line) <= 32 for line in body if line.startswith("'"))
        return body, places

    def run(self, name: str) -> None:
        lines, places = self.jobs[name]
        labels = {line: k for k, line in enumerate(lines) if line.startswith("*")}
        assert all(len(label) <= 9 for label in labels)
        at = 0
        while at < len(lines):
            target = self._step(lines[at], places)
            at = at + 1 if target is None else labels[target]

    @property
    def pulses(self) -> np.ndarray:
        return np.round(self.machine.counts * self.per_degree).astype(int)

    def _step(self, line: str, places):
        machine = self.machine
        if line.startswith(("'", "*")):
            return None
        if match := re.fullmatch(r"CALL JOB:(\w+)", line):
            return self.run(match[1])
        if match := re.fullmatch(r"MOVJ C(\d{5}) VJ=(\d+\.\d\d)", line):
            assert 0.01 <= float(match[2]) <= 100
            return machine.move(places[int(match[1])] / self.per_degree, share=float(match[2]) / 100)
        if match := re.fullmatch(r"MOVL C(\d{5}) V=(\d+\.\d)(?: SRCH (RIN#\(\d+\))=ON DIS=(\d+\.\d))?", line):
            return self._straight(places[int(match[1])] / self.per_degree, float(match[2]), match[3], match[4])
        if match := re.fullmatch(r"GETS B(\d{3}) \$B002", line):
            self.B[int(match[1])] = self.found[0]
        elif match := re.fullmatch(r"GETS PX(\d{3}) \$PX00([02])", line):
            self.P[int(match[1])] = self.pulses if match[2] == "0" else self.found[1]
        elif match := re.fullmatch(r"SET ([BD])(\d{3}) (\d+)", line):
            assert match[1] == "D" or int(match[3]) < 256
            getattr(self, match[1])[int(match[2])] = int(match[3])
        elif match := re.fullmatch(r"INC B(\d{3})", line):
            self.B[int(match[1])] += 1
        elif match := re.fullmatch(r"TIMER T=(\S+)", line):
            machine.wait(float(match[1]))
        elif match := re.fullmatch(r"WAIT IN#\(\d+\)=OFF T=(\S+)", line):
            machine.opens(float(match[1]))
        elif match := re.fullmatch(r"JUMP (\*\w+) IF B(\d{3})([=<])(\d+)", line):
            value = self.B[int(match[2])]
            return match[1] if (value == int(match[4]) if match[3] == "=" else value < int(match[4])) else None
        elif match := re.fullmatch(r"JUMP (\*\w+) IF IN#\(\d+\)=OFF", line):
            return None if machine.closed else match[1]
        elif match := re.fullmatch(r"JUMP (\*\w+)", line):
            return match[1]
        elif match := re.fullmatch(r'MSG "(.{1,48})"', line):
            self.message = match[1]
        elif line == "PAUSE":
            machine.pause(self.message)
        else:
            raise AssertionError(f"not a statement of the manual: {line}")
        return None

    def _straight(self, counts, speed: float, signal, distance) -> None:
        machine = self.machine
        goal = machine.pose(counts)
        if signal is None:
            return machine.move_line(*goal, speed)
        assert float(distance) + 0.1 >= np.linalg.norm(goal[0] - machine.pose(machine.counts)[0])
        latch = machine.search_line(*goal, speed)
        self.found = (0, self.found[1]) if latch is None else (1, np.round(latch * self.per_degree).astype(int))
        return None

    def var_dat(self, *, positions: bool = True) -> str:
        """VAR.DAT: B, I and D in rows of ten; position variables one a line, as backups of a GP88 and an SDA20D do."""
        out = ["//VAR", "///PFNUM 6,0,0,0", "///SHARE 100,100,100,100,100,128,128,0"]
        for kind, values in (("B", self.B), ("I", {}), ("D", self.D), ("R", {})):
            out += [f"///{kind}", *rows(values, 100)]
        slots = [self._slot(k) if positions else UNUSED for k in range(128)]
        return "\r\n".join([*out, "///S", *[""] * 100, "///P", *slots, "///BP", *[UNUSED] * 128, "///EX", ""])

    def _slot(self, k: int) -> str:
        """Type, configuration and tool of a position variable, its pulses, and two axes that are not there."""
        if k not in self.P:
            return UNUSED
        return f'"PULSE"0,0,1,{"0" * 24},0,1,{",".join(map(str, self.P[k]))},0,0'

    def job(self) -> str:
        """A job that names the position variables, as it is saved."""
        head = [
            "/JOB",
            "//NAME TCPOS",
            "//POS",
            f"///NPOS 0,0,0,{len(self.P)},0,0",
            "///TOOL 1",
            "///POSTYPE PULSE",
            "///PULSE",
        ]
        places = [f"P{k:05d}={','.join(map(str, values))}" for k, values in sorted(self.P.items())]
        return "\r\n".join([*head, *places, "//INST", "///DATE 2026/01/01 00:00", "NOP", "END", ""])


def rows(values: dict[int, int], count: int) -> list[str]:
    """Numbers in rows of ten."""
    return [",".join(str(values.get(k + j, 0)) for j in range(10)) for k in range(0, count, 10)]
