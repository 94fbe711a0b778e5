"""`touchcal health`."""

from collections.abc import Mapping
from functools import reduce
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter

from identify.model.files import InputError, digest, write_json, write_text
from oed.cli.options import (
    CELL_PORT,
    TOUCHES,
    CellFile,
    Flag,
    Json,
    Output,
    Port,
    Seed,
    TrustUnits,
    load_cell,
    only_touches,
    print_json,
    read_tables,
)
from oed.cli.screen.progress import progress

if TYPE_CHECKING:
    from identify.health.judge import Finding, Health
    from identify.model.io.calibration_file import Calibration
    from identify.model.touch import Plan, Touches

PROBABLE = 0.05  # probability of a cause that is named beside the first


def health(
    calibration: Path,
    *touches: Path,
    run: Flag = False,
    n: Annotated[int, Parameter(name=["-n", "--touches"])] = 12,
    alarm: float = 0.01,
    cell: CellFile = Path("cell.yaml"),
    output: Output = Path("health.csv"),
    port: Port = CELL_PORT,
    seed: Seed = 0,
    trust_units: TrustUnits = False,
    json: Json = False,
) -> int:
    """Whether the robot is still the one that was identified: unchanged, drifted, or broken.

    Without touches it writes a plan of a dozen that notice change best, and says what they would notice; with --run it
    makes them, and with touches it judges. Exit code 1 where the robot is not unchanged. Example:

        touchcal health calibration.json --run

        touchcal health calibration.json health-touches.csv

    Parameters
    ----------
    calibration
        What touchcal identify wrote, when the robot was well.
    touches
        touches.csv files made since.
    run
        Make the touches of the plan over the serial line, into health-touches.csv, or -touches-2.csv.
    n
        How many touches to plan.
    alarm
        The chance that a robot which has not changed is said to have.
    output
        Where the plan is written; with --run, a plan that stands there is used again.
    """
    from identify.health.judge import judge
    from identify.model.io.calibration_file import read_calibration
    from identify.model.touch import joined

    identified = read_calibration(calibration)
    if not 0 < alarm < 1:
        raise InputError(f"--alarm is {alarm:g}, expected a probability such as 0.01")
    if touches and run:
        raise InputError("touches are given and --run asks for new ones; give one of the two")
    if not touches:
        plan = _planned(identified, calibration, n, output, seed, again=run)
        if not run:
            _tell_plan(identified, plan, (calibration, output), alarm, json)
            return 0
        touches = (_touches(identified, plan, cell, output, port, json),)
    tables, _ = read_tables(touches, identified.cell, trust_units)
    health = judge(identified, reduce(joined, map(only_touches, tables)), alarm)
    if json:
        print_json(summary(health))
    else:
        print(story(identified, health))
    return 0 if health.verdict == "unchanged" else 1


def _planned(identified: "Calibration", file: Path, n: int, output: Path, seed: int, again: bool) -> "Plan":
    """The plan of a check: the one that stands there, or a new one."""
    from identify.health.causes import looked_for
    from identify.health.judge import LEAST
    from identify.model.io.tables import plan_text, read_plan
    from oed.planning.health_check import plan_check

    if n < LEAST:
        raise InputError(f"{n} touches are too few to judge a robot by; plan {LEAST} at least, better 12")
    if again and output.exists():
        return read_plan(output, identified.cell)
    with progress(True, "choosing touches"):
        plan, order = plan_check(identified.cell, identified, looked_for(identified), n, np.random.default_rng(seed))
    write_text(output, plan_text(plan, identified.cell.robot))
    summary_of_plan = {"touches": len(plan), "minutes": order.minutes, "seed": seed} | {
        "next": f"touchcal health {file} {TOUCHES}"
    }
    write_json(output.with_suffix(".json"), summary_of_plan, {file.name: digest(file)})
    return plan


def _touches(identified: "Calibration", plan: "Plan", cell: Path, output: Path, port: Port, silent: bool) -> Path:
    """Make the touches of a plan, or go on with them; the file that they are in."""
    from identify.estimation.face_association import as_identified
    from oed.campaigns.connection import SIM
    from oed.campaigns.folder import touches_of
    from oed.cli.run import make_touches
    from oed.cli.screen.live import Screen
    from probe import Settings

    described = load_cell(cell)
    connection = port.connection(described)
    files = (output.with_name(f"{output.stem}-touches{f'-{k}' if k > 1 else ''}.csv") for k in count(1))
    file = next(path for path in files if touches_of(path, described, plan) is None)
    robot, settings = as_identified(described, identified), Settings(trust_position=connection.port == SIM)
    screen, resume = Screen(silent), file.exists()
    try:
        make_touches(connection, described, robot, plan, file, settings, screen, resume=resume)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"the same command goes on; every touch made so far is in {file}") from None
    return file


def _tell_plan(identified: "Calibration", plan: "Plan", files: tuple[Path, Path], alarm: float, json: bool) -> None:
    from identify.health.judge import noticed

    smallest = noticed(identified, _expected(identified, plan), alarm)
    sizes = {name: change * _factor(identified, name) for name, change in smallest.items()}
    if json:
        print_json({"touches": len(plan), "notices": {k: v if np.isfinite(v) else None for k, v in sizes.items()}})
        return
    print(f"{len(plan)} touches that notice change best; 95 of 100 such checks would notice")
    for name, change in sizes.items():
        unit = _unit(identified, name)
        print(f"  {_part(name):32}{change:8.3f} {unit}" if np.isfinite(change) else f"  {_part(name):32} not at all")
    print(f"wrote {files[1]}; touchcal health {files[0]} --run -o {files[1]} makes them and judges")


def _expected(identified: "Calibration", plan: "Plan") -> "Touches":
    """Touches as they would be read, were every contact where it is planned."""
    from identify.model.touch import Touches

    cell, none = identified.cell, np.full(len(plan), np.nan)
    faces = [cell.the_jig.by_name[name] for name in plan.face]
    offset, sigma = np.array([face.offset for face in faces]), np.full(len(plan), cell.touch.sigma)
    blank = ("",) * len(plan)
    return Touches(plan.ids, plan.face, plan.q, plan.normal, offset, sigma, blank, none, blank, blank)


def _unit(identified: "Calibration", name: str) -> str:
    if name in {"tool", "wire"}:
        return "mm"
    return "deg" if identified.cell.robot.angular[identified.cell.robot.parameters.index(name)] else "mm"


def _factor(identified: "Calibration", name: str) -> float:
    return 180 / np.pi if _unit(identified, name) == "deg" else 1.0


def _part(name: str) -> str:
    """What a cause is called by people."""
    words = {"tool": "the tool, knocked", "wire": "the wire, longer or shorter", "base": "base or jig, moved"}
    if name in words:
        return words[name]
    joint, what = name.split(".", 1) if "." in name else (name, "")
    return f"zero of joint {joint}" if what in {"theta", "d"} else name


def summary(health: "Health") -> dict[str, Any]:
    """What `--json` says."""
    first = health.findings[0]
    return {
        "verdict": health.verdict,
        "chance": health.chance,
        "cause": None if health.verdict == "unchanged" else first.cause.name,
        "sure": first.sure,
        "whole": health.whole,
        "change": first.change.tolist(),
        "sigma": first.sigma.tolist(),
        "others": {f.cause.name: f.sure for f in health.findings[1:] if f.sure > PROBABLE},
        "residuals_mm": dict(health.residuals),
    }


def story(identified: "Calibration", health: "Health") -> str:
    """The verdict as a person reads it."""
    r = np.array(list(health.residuals.values()))
    rms = np.sqrt(np.mean(r * r))
    sizes = f"residuals of {len(r)} touches: RMS {rms:.3f} mm, expected {health.rms_expected_mm:.3f} mm"
    often = f"residuals like these: {_chance(health.chance)}"
    if health.verdict == "unchanged":
        return f"{sizes}\nunchanged: the robot is the one that was identified ({often})"
    first = health.findings[0]
    lines = [sizes, f"{health.verdict}: {_said(identified, first)}; {_sure(first)} sure ({often} without a change)"]
    lines += [f"  or: {_said(identified, f)} ({_sure(f)})" for f in health.findings[1:] if f.sure > PROBABLE]
    if not health.whole:
        lines.append("this does not explain all of it: more than one thing has changed; identify the robot anew")
    return "\n".join([*lines, CURES.get(first.cause.kind, CURES["parameter"])])


CURES: Mapping[str, str] = {
    "tool": "straighten or measure the tool; touches do not show its orientation: look at that too",
    "wire": "cut or feed the wire to its length, or enter the new one",
    "base": "check the bolts of base and jig, and identify again",
    "zero": "set the joint's zero again, and check once more",
    "parameter": "check once more, and identify again if it stays so",
}


def _said(identified: "Calibration", finding: "Finding") -> str:
    """A cause with its size."""
    from identify.health.judge import TOUCH
    from identify.uncertainty.promise import INTERVAL

    name, change, sigma = finding.cause.name, finding.change, finding.sigma
    if name.startswith(TOUCH):
        return f"{name} alone disagrees; make it again"
    if finding.cause.kind == "tool":
        axes = ", ".join(
            f"{axis} {v:+.2f} +- {INTERVAL * s:.2f}" for axis, v, s in zip("xyz", change, sigma, strict=True)
        )
        return f"the tool is {np.linalg.norm(change):.2f} mm off ({axes} mm in the flange frame)"
    if finding.cause.kind == "base":
        return f"base or jig have moved by {np.linalg.norm(change[:3]):.2f} mm, {_turned(change):.3f} degrees"
    unit, factor = _unit(identified, name), _factor(identified, name)
    return f"{_part(name)} by {change[0] * factor:+.3f} +- {INTERVAL * sigma[0] * factor:.3f} {unit}"


def _turned(change: np.ndarray) -> float:
    return float(np.degrees(np.linalg.norm(change[3:])))


def _sure(finding: "Finding") -> str:
    return "more than 99 %" if finding.sure > 0.99 else f"{100 * finding.sure:.0f} %"


def _chance(p: float) -> str:
    return "once in 1000 or less" if p < 1e-3 else f"{100 * p:.2g} times in 100"
