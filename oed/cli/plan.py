"""`touchcal plan`."""

from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from identify.model.calibration import read_calibration
from identify.model.files import digest, write_text
from identify.model.tables import plan_text
from oed.cli.options import CellFile, Json, Seed, load_cell, print_json, progress


def plan(
    *,
    n: Annotated[int, Parameter(name=["-n", "--touches"])] = 50,
    criterion: str = "D",
    strategy: Literal["optimal", "even", "random"] = "optimal",
    after: Path | None = None,
    cell: CellFile = Path("cell.yaml"),
    output: Annotated[Path, Parameter(name=["-o", "--output"])] = Path("plan.csv"),
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Choose the touches that tell the most about the robot.

    Writes plan.csv, and beside it a .json file of the same name that says what the plan promises. Example:

        touchcal plan -n 50 -o plan.csv

    Parameters
    ----------
    n
        How many touches to make.
    criterion
        What the plan makes best: D, A, E, V, G or O1 to O5.
    strategy
        optimal; even spreads points over the faces as the paper does; random draws them.
    after
        An earlier calibration.json: its parameters and what it knows are the start.
    output
        Where the plan is written.
    """
    import numpy as np

    from oed.planning import plan as make
    from oed.planning import summary

    described = load_cell(cell)
    known = None if after is None else read_calibration(after)
    with progress(not json) as say:
        result = make(described, n, criterion, strategy, np.random.default_rng(seed), after=known, progress=say)
    write_text(output, plan_text(result.plan, described.robot))
    told = summary(result) | {"seed": seed}
    write_summary(output.with_suffix(".json"), told, {cell.name: digest(cell)} | dict(described.sources))
    if json:
        print_json(told)
    else:
        print(story(told, output))


def write_summary(path: Path, told: dict[str, Any], inputs: dict[str, str]) -> None:
    """What made a plan, and what it promises, beside it."""
    from importlib.metadata import version
    from json import dumps

    write_text(path, dumps({"touchcal": version("touchcal"), "inputs": inputs} | told, indent=1) + "\n")


def story(told: dict[str, Any], output: Path) -> str:
    """The plan as a person reads it."""
    promise, efficiency = told["promise"], told["efficiency"]
    lines = [
        f"{told['touches']} touches, criterion {told['criterion']}, about {told['minutes']:.0f} minutes",
        f"promised tip error in the weld zone: RMS {promise['rms_mm']:.3f} mm, 95 % {promise['p95_mm']:.3f} mm",
        "indices: " + ", ".join(f"{name} {value:.4g}" for name, value in told["indices"].items()),
    ]
    if efficiency is not None:
        lines.append(f"at least {100 * efficiency:.1f} % of the best possible over all {told['efficiency_covers']}")
    lines += [f"not seen: {sentence}" for sentence in told["unseen"]]
    return "\n".join([*lines, f"wrote {output}; make the touches with touchcal run {output}"])
