r"""An interpreter of the RAPID statements that touchcal emits, written from ABB's technical reference manual RAPID.

Statement -> semantics: `MoveAbsJ j \NoEOffs, v, fine, t`: joint motion at the speed v of the tip. `MoveL p, v,
fine, t \WObj:=w`: straight. `SearchL \Stop, di, found, to, v, t \WObj:=w`: straight to `to`; at the edge of di the
position of that moment goes to `found` and the robot stops; if it arrives, ERR_WHLSEARCH is raised with the robot
at `to`; with di high at the start, ERR_SIGSUPSEARCH without a motion. The ERROR clause of the routine runs with
ERRNO; the path has to be stored before another motion, and cleared and started after it. `WaitDI di, 0 \MaxTime:=s
\TimeFlag:=late`: waits up to s seconds, late says if in vain. `CalcRobT` and `CalcJointT` are the controller's own
kinematics; `Write` writes a line; a string holds 80 characters. `Stop` waits for start. A num has 23 bits.
"""

import re

import numpy as np
from blocks import tree

KINDS = ((r"(LOCAL )?(PROC|FUNC string) \w+\(.*\)", r"ERROR", r"END(PROC|FUNC)"), (r"IF .* THEN", r"ELSE", r"ENDIF"))


class RapidError(Exception):
    """An error with a number, to be handled by an ERROR clause."""


class Return(Exception):
    """The end of a routine, with a value where it is a function."""


class Target:
    """A jointtarget or robtarget."""

    def __init__(self, robax=None, pose=None) -> None:
        self.robax, self.pose = robax, pose


class AbbRapid:
    """One module of a controller, and the files of HOME:."""

    def __init__(self, machine, files: dict[str, str], name: str) -> None:
        self.machine = machine
        self.home: dict[str, str] = {}
        self.open = ""
        self.globals: dict = {}
        self.stored = False
        text = re.sub(r"^\s*!.*$", "", files[f"{name}.mod"], flags=re.MULTILINE)
        lines, rest = [], ""
        for line in (line.strip() for line in text.splitlines() if line.strip()):
            whole = re.fullmatch(r".*;|.*THEN|ELSE|ERROR|END\w+|MODULE \w+|(LOCAL )?(PROC|FUNC).*", line)
            rest = f"{rest} {line}".strip()
            if whole:
                lines.append(rest)
                rest = ""
        assert lines[0] == f"MODULE {name}"
        assert lines[-1] == "ENDMODULE"
        self.routines = {}
        for node in tree(lines[1:-1], KINDS):
            if isinstance(node, str):
                self._declare(node, self.globals)
            else:
                match = re.fullmatch(r"(?:LOCAL )?(?:PROC|FUNC string) (\w+)\((.*)\)", node[0])
                assert len(match[1]) <= 32
                parameters = [word.split()[1] for word in match[2].split(", ") if word]
                self.routines[match[1]] = (parameters, node[1], node[2])

    def run(self, name: str) -> None:
        self.call(name, [])

    def call(self, name: str, arguments):
        parameters, body, handler = self.routines[name]
        scope = dict(zip(parameters, arguments, strict=True))
        try:
            self.block(body, scope)
        except RapidError as error:
            if not handler:
                raise
            self.globals["ERRNO"] = error.args[0]
            try:
                self.block(handler, scope)
            except Return as returned:
                return returned.args[0]
        except Return as returned:
            return returned.args[0]
        return None

    def block(self, nodes, scope) -> None:
        for node in nodes:
            if isinstance(node, str):
                self.step(node.removesuffix(";"), scope)
            else:
                condition = re.fullmatch(r"IF (.*) THEN", node[0])[1]
                self.block(node[1] if self.value(condition, scope) else node[2], scope)

    def _declare(self, line: str, scope) -> None:
        match = re.fullmatch(r"(?:LOCAL )?(?:VAR|CONST) \w+ (\w+)(?::=(.*?))?;?", line)
        assert match, line
        scope[match[1]] = self.value(match[2], scope) if match[2] else None

    def step(self, line: str, scope) -> None:
        machine = self.machine
        if line in ("ConfL \\Off", "RestoPath"):
            return
        if line.startswith("VAR "):
            self._declare(line, scope)
        elif line == "Stop":
            machine.pause("Stop")
        elif line == "StorePath":
            self.stored = True
        elif line == "ClearPath":
            self.stored = False
        elif line in ("StartMove", "RAISE"):
            assert line == "StartMove"
            assert not self.stored
        elif line == "RETURN":
            raise Return(None)
        elif match := re.fullmatch(r"RETURN (.*)", line):
            raise Return(self.value(match[1], scope))
        elif match := re.fullmatch(r'Open "HOME:" \\File:="([\w.]+)", (\w+) \\(Write|Append)', line):
            self.open = match[1]
            self.home[self.open] = "" if match[3] == "Write" else self.home.get(self.open, "")
        elif re.fullmatch(r"Close \w+", line):
            self.open = ""
        elif match := re.fullmatch(r"Write \w+, (.*)", line):
            text = self.value(match[1], scope)
            assert len(text) <= 80, text
            self.home[self.open] += text + "\n"
        elif match := re.fullmatch(r"TPWrite (.*)", line):
            assert len(self.value(match[1], scope)) <= 80
        elif match := re.fullmatch(r"WaitTime (\S+)", line):
            machine.wait(float(match[1]))
        elif match := re.fullmatch(r"WaitDI (\w+), 0 \\MaxTime:=(\S+) \\TimeFlag:=(\w+)", line):
            scope[match[3]] = not machine.opens(float(match[2]))
        elif match := re.fullmatch(r"(MoveAbsJ|MoveL|SearchL) (.*)", line):
            self.motion(match[1], match[2], scope)
        elif match := re.fullmatch(r"IF (.*?) (\w+:=.*)", line):
            if self.value(match[1], scope):
                self.step(match[2], scope)
        elif match := re.fullmatch(r"(\w+):=(.*)", line):
            (scope if match[1] in scope else self.globals)[match[1]] = self.value(match[2], scope)
        elif match := re.fullmatch(r"(\w+) (.*)", line):
            self.call(match[1], self.value(f"[{match[2]}]", scope))
        else:
            raise AssertionError(f"not a statement of the manual: {line}")

    def motion(self, kind: str, text: str, scope) -> None:
        machine = self.machine
        if kind == "MoveAbsJ":
            match = re.fullmatch(r"(.*) \\NoEOffs, (\w+), fine, (\w+)", text)
            (robax, _), speed = self.value(match[1], scope), self.value(match[2], scope)[0]
            length = np.linalg.norm(machine.pose(np.array(robax))[0] - machine.pose(machine.counts)[0])
            machine.move(np.array(robax), seconds=max(float(length) / speed, 0.2))
        elif kind == "MoveL":
            match = re.fullmatch(r"(\w+), (\w+), fine, \w+ \\WObj:=\w+", text)
            assert not machine.robot.arm.closed or "Found" not in match[1]
            machine.move_line(*self.value(match[1], scope).pose, self.value(match[2], scope)[0])
        else:
            match = re.fullmatch(r"\\Stop, (\w+), (\w+), (\w+), (\w+), \w+ \\WObj:=\w+", text)
            if machine.closed:
                raise RapidError("ERR_SIGSUPSEARCH")
            latch = machine.search_line(*self.value(match[3], scope).pose, self.value(match[4], scope)[0])
            if latch is None:
                raise RapidError("ERR_WHLSEARCH")
            self.globals[match[2]] = Target(pose=machine.pose(latch))

    def value(self, text: str, scope):
        machine = self.machine
        text = re.sub(r"\\(Tool|WObj):=\w+ ?", "", text)
        text = re.sub(r", \w+ ?(?=\))", "", text) if re.match(r"\w*\[?Calc", text) else text
        text = re.sub(r"(?<![<>:])=", "==", text)
        for old, new in ((r"\bTRUE\b", "True"), (r"\bFALSE\b", "False"), (r"\bNOT\b", "not"), (r"\bOR\b", "or")):
            text = re.sub(old, new, text)
        names = {
            "CJointT": lambda: Target(robax=machine.counts),
            "CRobT": lambda: Target(pose=machine.pose(machine.counts)),
            "CalcRobT": lambda j: Target(pose=machine.pose(np.array(j[0]))),
            "CalcJointT": lambda p: Target(robax=machine.shown(machine.solve(*p.pose, machine.robot.q))),
            "DInput": lambda signal: int(machine.closed),
            "NumToStr": lambda value, decimals: f"{np.float32(value):.{decimals}f}",
            "AsText": lambda joints: self.call("AsText", [_Robax(joints)]),
            "diTouch": None,
        }
        errors = {name: name for name in ("ERR_WHLSEARCH", "ERR_SIGSUPSEARCH")}
        return eval(text, {"__builtins__": {}}, names | errors | self.globals | scope)


class _Robax:
    """The six axes of a robjoint by their names."""

    def __init__(self, values) -> None:
        for k, value in enumerate(values):
            setattr(self, f"rax_{k + 1}", float(value))
