"""`touchcal plan`."""

from dataclasses import dataclass, replace
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

from identify.model.files import digest, write_json, write_text
from oed.cli.options import IDENTIFY, CellFile, Flag, Json, Output, Seed, load_cell, print_json
from oed.cli.plans.kinds import KindsChoice, plan_of_kinds
from oed.cli.plans.workpiece import plan_of_workpiece
from oed.cli.screen.progress import progress

if TYPE_CHECKING:
    from identify.model.cell import Cell
    from oed.planning.plan import PlanResult


@Parameter(name="*")
@dataclass(frozen=True)
class Choice:
    """How many touches, and what they make best."""

    n: Annotated[int | None, Parameter(name=["-n", "--touches"])] = None
    """How many touches to make; 50 if no target is given."""
    target: float | None = None
    """Tip error [mm] that 95 % of the poses of the weld zone should stay below: as few touches as do it."""
    criterion: str = "V"
    """What the plan makes best: V and G, the mean and the largest tip error in the weld zone; D, A, E, or O1 to
    O5; FILE.py:NAME, a criterion of your own that a Python file defines (studies/examples/own_criterion.py)."""
    strategy: Literal["optimal", "even", "random"] = "optimal"
    """optimal; even spreads points over the faces as the paper does; random draws them."""
    kinds: str | None = None
    """Kinds of measurements to choose from, with commas between them: touch, position, pose, distance, contact. One
    design weighs all of them, with the minutes that each takes (measure: in cell.yaml) as its cost."""
    budget: str | None = None
    """How long measuring may take: 15min, 1h, 90s; a number alone means minutes. It goes with --kinds."""
    seconds: float | None = None
    """So long the plan searches for better touches, and for a better bound on all touches, but no less than without it:
    a few seconds. What it finds then depends on the machine."""
    unseen: Flag = False
    """Plan touches to verify with instead, 20 if not said otherwise: well spread, and different from those of plan.csv
    and of the fit (--after). Written to unseen-plan.csv if not said otherwise."""


@Parameter(name="*")
@dataclass(frozen=True)
class Body:
    """A workpiece to locate, in place of a robot to identify."""

    workpiece: str | None = None
    """Plan touches that locate this workpiece instead: its faces, in a file like that of a jig, or library:NAME."""
    at: str | None = None
    """About where it stands in the base frame, x,y,z,rz,ry,rx (mm, degrees); where the jig stands if not given."""


USUAL, ROBOT = Choice(), Body()


def plan(
    *,
    choice: Choice = USUAL,
    after: Path | None = None,
    body: Body = ROBOT,
    cell: CellFile = Path("cell.yaml"),
    output: Output = Path("plan.csv"),
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Choose the touches that tell the most about the robot.

    Writes plan.csv, and beside it a .json file of the same name that says what the plan promises, and a .html page that
    shows robot, jig and touches in three dimensions. Example:

        touchcal plan -n 50 -o plan.csv

        touchcal plan --target 0.15

        touchcal plan --unseen -n 20 --after calibration.json

        touchcal plan --kinds touch,distance --budget 15min

        touchcal plan --criterion own.py:K2

    Parameters
    ----------
    after
        An earlier calibration.json: its parameters and what it knows are the start.
    output
        Where the plan is written.
    """
    from identify.model.io.calibration_file import read_calibration
    from oed.criteria.own import OwnCriterion
    from oed.planning.plan import plan

    described = load_cell(cell)
    own = OwnCriterion.named(choice.criterion)
    choice = choice if own is None else replace(choice, criterion=own.define().name)
    if _planned_otherwise(choice, body, described, cell, after, output, seed, json):
        return
    calibration = None if after is None else read_calibration(after)
    with progress(not json) as on_progress:
        result = plan(
            described,
            choice.n,
            choice.criterion,
            choice.strategy,
            np.random.default_rng(seed),
            target=choice.target,
            after=calibration,
            seconds=choice.seconds,
            progress=on_progress,
        )
    _write(result, described, cell, output, seed, json)


def _planned_otherwise(
    choice: Choice, body: Body, cell: "Cell", cell_file: Path, after: Path | None, output: Path, seed: int, json: bool
) -> bool:
    """Write the plan that locates a workpiece, verifies, or holds several kinds, if that is what is asked for."""
    from identify.model.io.calibration_file import read_calibration

    if body.workpiece is not None:
        plan_of_workpiece(body.workpiece, body.at, cell, cell_file, choice.n, after, output, seed, json)
    elif choice.unseen:
        from oed.cli.verify import plan_touches

        plan_touches(cell, cell_file, choice.n, after, output, seed, json)
    elif choice.kinds is not None or choice.budget is not None:
        calibration = None if after is None else read_calibration(after)
        plan_of_kinds(_asked(choice), cell, cell_file, calibration, output, seed, json)
    else:
        return False
    return True


def _write(result: "PlanResult", cell: "Cell", cell_file: Path, output: Path, seed: int, json: bool) -> None:
    """Write plan.csv, plan.json and plan.html, and say what the plan promises."""
    from identify.model.io.tables import plan_text
    from identify.report.plan import plan_page
    from oed.planning.plan import summary

    write_text(output, plan_text(result.plan, cell.robot))
    answer = summary(result) | {"seed": seed, "next": IDENTIFY}
    write_json(output.with_suffix(".json"), answer, {cell_file.name: digest(cell_file)} | dict(cell.sources))
    write_text(output.with_suffix(".html"), plan_page(cell, result.plan, answer))
    if json:
        print_json(answer)
    else:
        print(story(answer, output))


def _asked(choice: Choice) -> KindsChoice:
    """The part of the options that a plan of several kinds heeds."""
    usual = choice == replace(choice, n=None, target=None, seconds=None, strategy="optimal")
    options = {"-n": choice.n, "--target": choice.target, "--seconds": choice.seconds}
    names = tuple(name for name, value in options.items() if value is not None)
    return KindsChoice(
        choice.kinds or "touch", choice.budget, choice.criterion, names or (() if usual else ("--strategy",))
    )


def story(answer: dict[str, Any], output: Path) -> str:
    """The plan as a person reads it."""
    from oed.planning.searches import CAMPAIGN

    promise = answer["promise"]
    choice = f"criterion {answer['criterion']}" if answer["strategy"] == "optimal" else f"strategy {answer['strategy']}"
    lines = [
        *(note for note in answer["notes"] if note.startswith(CAMPAIGN)),
        f"{answer['touches']} touches, {choice}, about {answer['minutes']:.0f} minutes",
        f"promised tip error in the weld zone: RMS {promise['rms_mm']:.3f} mm, 95 % {promise['p95_mm']:.3f} mm",
        *_curve(answer["curve"]),
        "indices: " + ", ".join(f"{name} {value:.4g}" for name, value in answer["indices"].items()),
        *_certificate(answer),
    ]
    lines += [f"not seen: {sentence}" for sentence in answer["unseen"]]
    lines += [f"note: {sentence}" for sentence in answer["notes"] if not sentence.startswith(CAMPAIGN)]
    page = output.with_suffix(".html").name
    return "\n".join([*lines, f"wrote {output}, to look at in {page}; make the touches with touchcal run {output}"])


def _curve(points: list[dict[str, float]]) -> list[str]:
    """More or fewer touches like these, and what to expect of them, as many beside each other as the screen is wide."""
    wide = max(1, (get_terminal_size().columns - 10) // 7)
    return [
        line
        for some in (points[k : k + wide] for k in range(0, len(points), wide))
        for line in (
            "touches   " + "".join(f"{point['touches']:7.0f}" for point in some),
            "95 % [mm] " + "".join(f"{point['p95_mm']:7.3f}" for point in some),
        )
    ]


def _certificate(answer: dict[str, Any]) -> list[str]:
    """How near to the best, and to the best of what."""
    lines, share = [], answer["efficiency"]
    if share is not None:
        among = "the {joined} of {offered} touches on offer that clear ways join".format(**answer["candidates"])
        best = f"at least {100 * share:.1f} % of the best possible over {among}"
        better = f"better than any choice of {among}: these were moved from there to where they tell more"
        lines.append(better if share > 1 else best)
    if answer["manifold"] is not None:
        lines.append(f"at least {100 * answer['manifold']:.1f} % of the best possible over {answer['manifold_covers']}")
    return lines
