"""From a plan over a program and its interpreter to imported touches."""

from dataclasses import dataclass

import numpy as np
from abb_rapid import AbbRapid
from fanuc_tp import FanucTP
from kuka_krl import KukaKRL
from maker_machine import Machine, ScriptedRobot, scripted
from ur_script import UrScript
from yaskawa_inform import YaskawaInform

from identify.model.cell import Cell
from identify.model.touch import Plan, Touches
from probe.programs.evidence import imported
from probe.programs.makers import MAKERS, program, read_logs
from probe.programs.options import Options
from probe.virtual.truth import Truth

TOUCHES = 60
MISSES = frozenset({9, 31, 32})  # searches in which the jig is away
STICKS = 45  # the search after which the input stays closed
DELAY = 0.004  # [s] of the relay
PULSES = np.array([1341.38, 1907.674, 1592.889, 1022.862, 980.239, 454.754])  # of a degree, of a published Motoman
RESOLUTION = {"fanuc": 4e-5, "kuka": 1e-5, "abb": 2.5e-5, "yaskawa": 1 / PULSES.min(), "ur": 1e-5}  # [deg]


@dataclass(frozen=True, eq=False)
class Bench:
    """A cell, its plan, and what the arm truly is."""

    cell: Cell
    plan: Plan
    truth: Truth

    def robot(self, **faults) -> ScriptedRobot:
        return scripted(self.cell, self.truth, self.plan, **faults)


@dataclass(frozen=True, eq=False)
class Made:
    """What a program made: its files, the arm, the pauses and the imported touches."""

    files: dict[str, str]
    robot: ScriptedRobot
    machine: Machine
    logs: dict[str, str]
    touches: Touches
    missing: tuple[str, ...]


def execute(maker: str, machine: Machine, files: dict[str, str]) -> dict[str, str]:
    """Run all files of a program one after the other; what comes back, by name."""
    stem = "TR" if any(name.startswith("TR") for name in files) else "TC"
    names = sorted(
        {name.split(".")[0] for name in files if name.startswith(stem) and name[2].isdigit()}, key=lambda n: int(n[2:])
    )
    back: dict[str, str] = {}
    if maker == "fanuc":
        controller = FanucTP(machine, files)
        for name in names:
            controller.run(name)
            back |= {f"posreg{name[2:]}.va": controller.posreg(), f"numreg{name[2:]}.va": controller.numreg()}
    elif maker == "yaskawa":
        controller = YaskawaInform(machine, files, PULSES)
        for name in names:
            controller.run(name)
            back[f"VAR{name[2:]}.DAT"] = controller.var_dat()
    for name in names:
        if maker == "kuka":
            controller = KukaKRL(machine, files, name)
            controller.run()
            back |= {f"{name}.dat": controller.data()} if f"{name}.dat" in files else {}
        elif maker == "abb":
            controller = AbbRapid(machine, files, name)
            controller.run(name)
            back |= controller.home
        elif maker == "ur":
            controller = UrScript(machine, files, name)
            controller.run_program()
            back |= {f"{name}.log": controller.sent} if controller.sent else {}
    return back


def make(bench: Bench, maker: str, folder, options: Options, *, only: str = "", stuck: bool = False, **faults) -> Made:
    """Plan to program to interpreter to import; `only` the logs of one file, the input `stuck` from the start."""
    files = program(bench.plan, bench.cell, maker, options).files
    robot = bench.robot(**faults)
    robot.health.stuck = stuck
    machine = Machine(robot)
    logs = {name: text for name, text in execute(maker, machine, files).items() if only in name}
    paths = []
    for name, text in logs.items():
        paths.append(folder / name)
        paths[-1].write_text(text, newline="")
    read = read_logs(paths, bench.plan, bench.cell, maker)
    rows = imported(read, bench.plan, bench.cell, maker, straight=MAKERS[maker].straight)
    return Made(files, robot, machine, logs, rows.touches, rows.missing)
