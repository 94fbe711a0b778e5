"""An interpreter of the TP statements that touchcal emits, written from FANUC's operator manual.

Statement -> semantics (source: Handling Tool operator's manual, chapter on program instructions, unless named): `J
P[i] n% FINE`: joint motion, n percent of the largest joint speed, stops exactly. `J PR[i] R[j]sec FINE`: the same
in a given time. `SKIP CONDITION DI[n]=ON` with `Skip,LBL[a],PR[b]=JPOS` on a motion: if the condition becomes true
the robot stops, the joints of that moment go to PR[b] (high-speed skip) and the next line runs; if the robot
arrives, the program jumps to LBL[a]; if the condition is true at the start, the motion ends at once. `WAIT
DI[n]=OFF TIMEOUT,LBL[a]`: waits up to $WAITTMOUT (1/100 s), then jumps. `R[R[i]]`, `PR[R[i]]`: indirect addresses.
`R[i]=PR[j,k]`:
an element of a position register. Registers are reals of 32 bits; posreg.va shows three decimals, numreg.va six.
"""

import re

import numpy as np

NUMBER = r"[+-]?\d*\.?\d+"


class FanucTP:
    """Programs of one controller, and its registers."""

    def __init__(self, machine, files: dict[str, str]) -> None:
        self.machine = machine
        self.R: dict[int, float] = {}
        self.PR: dict[int, np.ndarray] = {}
        self.timeout = 30.0
        self.skip = None
        self.programs = {
            name.removesuffix(".LS"): self._parsed(text) for name, text in files.items() if name.endswith(".LS")
        }

    def _parsed(self, text: str):
        head, _, rest = text.partition("/MN\n")
        body, _, rest = rest.partition("/POS\n")
        assert rest.endswith("/END\n")
        lines = []
        for number, line in enumerate(body.splitlines(), 1):
            match = re.fullmatch(r"\s*(\d+):\s*(.*?) ;", line)
            assert match, line
            assert int(match[1]) == number, line
            assert len(match[2]) <= 254
            if match[2].startswith("!"):
                assert len(match[2]) <= 33, line
            lines.append(match[2])
        assert f"LINE_COUNT\t= {len(lines)};" in head
        comment = re.search(r'COMMENT\t\t= "(.*)"', head)
        assert comment
        assert len(comment[1]) <= 16
        positions = {}
        for block in re.finditer(r"P\[(\d+)\]\{\n   GP1:\n\tUF : \d+, UT : \d+,\t\n(.*?)\n\};", rest, re.DOTALL):
            values = dict(re.findall(rf"J(\d)=\s*({NUMBER}) deg", block[2]))
            positions[int(block[1])] = np.array([float(values[str(k)]) for k in range(1, 7)])
        return lines, positions

    def run(self, name: str) -> None:
        lines, positions = self.programs[name]
        labels = {match[1]: k for k, line in enumerate(lines) if (match := re.fullmatch(r"LBL\[(\d+)\]", line))}
        at = 0
        while at < len(lines):
            target = self._step(lines[at], positions)
            if target == "END":
                return
            at = at + 1 if target is None else labels[target]

    def _index(self, text: str) -> int:
        """A number, or R[i]."""
        return int(self.R[int(text[2:-1])]) if text.startswith("R[") else int(text)

    def _step(self, line: str, positions):
        machine = self.machine
        if line.startswith("!") or re.fullmatch(r"LBL\[\d+\]|U(FRAME|TOOL)_NUM=\d+", line):
            return None
        if line == "END":
            return "END"
        if line == "PAUSE":
            return machine.pause(self.message)
        if match := re.fullmatch(r"MESSAGE\[(.{1,31})\]", line):
            self.message = match[1]
            return None
        if match := re.fullmatch(r"CALL (\w+)", line):
            return self.run(match[1])
        if match := re.fullmatch(r"\$WAITTMOUT=(\d+)", line):
            self.timeout = int(match[1]) / 100
            return None
        if match := re.fullmatch(r"WAIT (DI\[\d+\])=OFF TIMEOUT,LBL\[(\d+)\]", line):
            return None if machine.opens(self.timeout) else match[2]
        if match := re.fullmatch(rf"WAIT ({NUMBER})\(sec\)", line):
            return machine.wait(float(match[1]))
        if match := re.fullmatch(r"SKIP CONDITION (DI\[\d+\])=ON", line):
            self.skip = match[1]
            return None
        if match := re.fullmatch(r"J (P|PR)\[(\d+)\] (\S+?)(%|sec) FINE(?: Skip,LBL\[(\d+)\],PR\[(\d+)\]=JPOS)?", line):
            return self._motion(match, positions)
        if match := re.fullmatch(r"IF (DI\[\d+\])=OFF,JMP LBL\[(\d+)\]", line):
            return None if machine.closed else match[2]
        if match := re.fullmatch(r"IF R\[(.+?)\](<>|<)(\d+),JMP LBL\[(\d+)\]", line):
            value = self.R[self._index(match[1])]
            return match[4] if (value != int(match[3]) if match[2] == "<>" else value < int(match[3])) else None
        return self._assign(line, positions)

    def _motion(self, match, positions):
        counts = positions[int(match[2])] if match[1] == "P" else self.PR[int(match[2])]
        value = self.R[int(match[3][2:-1])] if match[3].startswith("R[") else float(match[3])
        if match[5] is None:
            assert match[4] == "%"
            assert 1 <= value <= 100
            return self.machine.move(counts, share=value / 100)
        assert self.skip, "no SKIP CONDITION before"
        if self.machine.closed:
            self.PR[int(match[6])] = self.machine.counts
            return None
        latch = self.machine.search(counts, value)
        if latch is None:
            return match[5]
        self.PR[int(match[6])] = latch
        return None

    def _assign(self, line: str, positions):
        if match := re.fullmatch(r"PR\[(.+?)(?::\w+)?\]=(?:P\[(\d+)\]|PR\[(\d+)\]|(JPOS))", line):
            value = (
                positions[int(match[2])] if match[2] else self.PR[int(match[3])] if match[3] else self.machine.counts
            )
            self.PR[self._index(match[1])] = value
            return
        if match := re.fullmatch(r"R\[(R\[\d+\]|\d+)\]=PR\[(\d+),([1-6])\]", line):
            self.R[self._index(match[1])] = float(np.float32(self.PR[int(match[2])][int(match[3]) - 1]))
            return
        match = re.fullmatch(rf"R\[(R\[\d+\]|\d+)(?::\w+)?\]=(?:({NUMBER})|R\[(\d+)\]\+(\d+))", line)
        assert match, f"not a statement of the manual: {line}"
        self.R[self._index(match[1])] = float(match[2]) if match[2] else self.R[int(match[3])] + int(match[4])
        return

    def posreg(self, count: int = 100) -> str:
        """posreg.va: joints with three decimals, three a line, a blank line behind."""
        lines = [f"[*POSREG*]$POSREG  Storage: CMOS  Access: RW  : ARRAY[1,{count}] OF Position Reg"]
        for k in range(1, count + 1):
            if k not in self.PR:
                lines.append(f"    [1,{k}] =   '' Uninitialized")
                continue
            words = [f"J{j + 1} = {bare(value):>9s} deg" for j, value in enumerate(self.PR[k])]
            lines += [
                f"    [1,{k}] =   ''   Group: 1",
                "  " + "   ".join(words[:3]) + " ",
                "  " + "   ".join(words[3:]) + " ",
                "",
            ]
        return "\n".join([*lines, ""])

    def numreg(self, count: int = 200) -> str:
        """numreg.va: whole numbers bare, others with six decimals."""
        lines = [f"[*NUMREG*]$NUMREG  Storage: CMOS  Access: RW  : ARRAY[{count}] OF Numeric Reg"]
        for k in range(1, count + 1):
            value = self.R.get(k, 0.0)
            lines.append(f"  [{k}] = {int(value) if value == int(value) else f'{value:.6f}'}  '' ")
        return "\n".join([*lines, "[*NUMREG*]$MAXREGNUM  Storage: CMOS  Access: RW  : INTEGER = 200", ""])


def bare(value: float) -> str:
    """A number without the zero before its point, as the controller writes it."""
    text = f"{value:.3f}"
    return text.replace("0.", ".", 1) if text.startswith(("0.", "-0.")) else text
