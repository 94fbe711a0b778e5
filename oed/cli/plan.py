"""`touchcal plan`."""

from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from identify.model.files import InputError, digest, write_text
from identify.model.io.calibration_file import read_calibration
from identify.model.io.tables import plan_text
from oed.cli.options import CellFile, Json, Seed, load_cell, print_json, progress


def plan(
    *,
    n: Annotated[int | None, Parameter(name=["-n", "--touches"])] = None,
    target: Annotated[float | None, Parameter(name="--target")] = None,
    criterion: str = "V",
    strategy: Literal["optimal", "even", "random"] = "optimal",
    after: Path | None = None,
    workpiece: str | None = None,
    at: str | None = None,
    robust: int = 0,
    worst: Annotated[bool, Parameter(negative=())] = False,
    cell: CellFile = Path("cell.yaml"),
    output: Annotated[Path, Parameter(name=["-o", "--output"])] = Path("plan.csv"),
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Choose the touches that tell the most about the robot.

    Writes plan.csv, and beside it a .json file of the same name that says what the plan promises, and a .html page that
    shows robot, jig and touches in three dimensions. Example:

        touchcal plan -n 50 -o plan.csv

        touchcal plan --target 0.15

    Parameters
    ----------
    n
        How many touches to make; 50 if no target is given.
    target
        Tip error [mm] that 95 % of the poses of the weld zone should stay below: as few touches as do it.
    criterion
        What the plan makes best: V and G, the mean and the largest tip error in the weld zone; D, A, E, or O1 to O5.
    strategy
        optimal; even spreads points over the faces as the paper does; random draws them.
    after
        An earlier calibration.json: its parameters and what it knows are the start.
    workpiece
        Plan touches that locate this workpiece instead: its faces, in a file like that of a jig, or library:NAME.
    at
        About where it stands in the base frame, x,y,z,rz,ry,rx (mm, degrees); where the jig stands if not given.
    robust
        So many robots drawn from the tolerances, or from what the calibration leaves open, are planned for at once.
    worst
        Plan for the worst of these robots, not for their mean.
    output
        Where the plan is written.
    """
    import numpy as np

    from identify.report.plan import plan_page
    from oed.planning.plan import plan as make
    from oed.planning.plan import summary

    if robust < 0:
        raise InputError(f"--robust is {robust}, expected how many robots to draw, 10 for example")
    described = load_cell(cell)
    if workpiece is not None:
        from oed.cli.workpiece import touches_of

        touches_of(workpiece, described, cell, n, at, after, output, seed, json)
        return
    known = None if after is None else read_calibration(after)
    with progress(not json) as say:
        result = make(
            described, n, criterion, strategy, np.random.default_rng(seed), target=target, after=known, robust=robust,
            worst=worst, progress=say,
        )  # fmt: skip
    write_text(output, plan_text(result.plan, described.robot))
    told = summary(result) | {"seed": seed}
    write_summary(output.with_suffix(".json"), told, {cell.name: digest(cell)} | dict(described.sources))
    write_text(output.with_suffix(".html"), plan_page(described, result.plan, told))
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
    promise = told["promise"]
    chosen = f"criterion {told['criterion']}" if told["strategy"] == "optimal" else f"strategy {told['strategy']}"
    lines = [
        f"{told['touches']} touches, {chosen}, about {told['minutes']:.0f} minutes",
        f"promised tip error in the weld zone: RMS {promise['rms_mm']:.3f} mm, 95 % {promise['p95_mm']:.3f} mm",
        *_curve(told["curve"]),
        "indices: " + ", ".join(f"{name} {value:.4g}" for name, value in told["indices"].items()),
        *_certificate(told),
    ]
    lines += [f"not seen: {sentence}" for sentence in told["unseen"]]
    lines += [f"note: {sentence}" for sentence in told["notes"]]
    page = output.with_suffix(".html").name
    return "\n".join([*lines, f"wrote {output}, to look at in {page}; make the touches with touchcal run {output}"])


def _curve(points: list[dict[str, float]]) -> list[str]:
    """More or fewer touches like these, and what to expect of them."""
    return [
        "touches   " + "".join(f"{point['touches']:7.0f}" for point in points),
        "95 % [mm] " + "".join(f"{point['p95_mm']:7.3f}" for point in points),
    ]


def _certificate(told: dict[str, Any]) -> list[str]:
    """How near to the best, and to the best of what."""
    lines, share = [], told["efficiency"]
    if share is not None:
        among = "the {joined} of {offered} touches on offer that clear ways join".format(**told["candidates"])
        better = ", which these are moved from to where they tell more" if share > 1 else ""
        lines.append(f"at least {100 * share:.1f} % of the best possible over {among}{better}")
    if told["manifold"] is not None:
        lines.append(f"at least {100 * told['manifold']:.1f} % of the best possible over {told['manifold_covers']}")
    return lines
