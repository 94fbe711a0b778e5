"""`touchcal demo`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from oed.cli.options import Json, Output, Seed, errors_table, print_json
from oed.cli.screen.progress import progress

if TYPE_CHECKING:
    from oed.campaigns.demonstration import Demonstration


def demo(
    *,
    output: Output = Path("demo"),
    touches: Annotated[int, Parameter(name=["-n", "--touches"])] = 160,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """The whole loop on the embedded virtual robot: plan, touch, identify, verify.

    The virtual robot is the paper's, off by 27 mm in ways that only it knows; touches are made over a pseudo-terminal,
    as on a real robot. The folder that is written can be copied as the start of a real project. Exit code 0 and PASS if
    the tip is as accurate as it should be. Example:

        touchcal demo -o demo

    Parameters
    ----------
    output
        The folder to write; made where it does not exist. The same command goes on where it was stopped.
    touches
        How many touches to plan.
    """
    from oed.campaigns.demonstration import demonstrate

    with progress(not json) as on_progress:
        result = demonstrate(output, touches, seed, on_progress)
    if json:
        compared = {name: result.compared[name] for name in ("initial_rms_mm", "zone_rms_mm", "promise")}
        effort = {name: result.effort[name] for name in ("touches", "hits", "minutes")}
        print_json({**effort, **compared, "passed": result.passed})
    else:
        print(_story(output, result))
    return 0 if result.passed else 1


def _story(folder: Path, result: "Demonstration") -> str:
    """The end, as a person reads it."""
    from oed.campaigns.demonstration import GOAL_MM, POSES

    effort, compared = result.effort, result.compared
    true_errors = {"before": compared["before"], "delivered": compared["after"]}
    unseen = {"unseen tip positions": result.positions.identified, "unseen touches": result.touches.identified}
    return (
        f"{effort['hits']} of {effort['touches']} touches met the jig, in {effort['stages']} stages, "
        f"{effort['minutes']:.0f} minutes on a real robot\n\n"
        f"tip error at {POSES} poses of the zone, by the hidden truth\n{errors_table(true_errors)}\n"
        f"promised by the touches: 95 % within {compared['promise']['p95_mm']:.3f} mm\n\n"
        f"what a user can see, without the truth\n{errors_table(unseen)}\n\n"
        f"{'PASS' if result.passed else 'FAIL'}: tip RMS {compared['zone_rms_mm']:.3f} mm, to be at most {GOAL_MM} mm; "
        f"{folder} holds report.html, corrected.csv and all that led there"
    )
