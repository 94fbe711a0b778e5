"""`touchcal campaign`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from identify.model.files import digest
from oed.cli.options import CELL_PORT, CellFile, Flag, Json, Output, Port, Seed, load_cell, print_json
from oed.cli.screen.live import Screen
from oed.cli.screen.progress import progress

if TYPE_CHECKING:
    from oed.campaigns.stages import Campaign, Stage


def campaign(
    *,
    target: float = 0.15,
    max_touches: int = 250,
    cell: CellFile = Path("cell.yaml"),
    output: Output = Path(),
    port: Port = CELL_PORT,
    trust_position: Flag = False,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """Touch, identify and plan by turns, until the tip is as accurate in the zone as was asked.

    The first stages search far, so that a robot that is badly known meets the jig; every later one is planned with what
    is known. Files of every stage stand in the folder: the same command goes on where it was stopped. Exit code 1 where
    the target is not reached. Example:

        touchcal campaign --target 0.15 --max-touches 120

    Parameters
    ----------
    target
        Tip error [mm] that 95 of 100 robots should stay below at 95 % of the poses of the zone.
    max_touches
        How many touches may be tried.
    output
        The folder of the campaign.
    trust_position
        You have checked where the robot stands, after a restart of its controller or a move by hand.
    """
    import numpy as np

    from identify.estimation.verdict import with_promise
    from identify.model.io.calibration_file import read_calibration, write_calibration
    from oed.campaigns.campaign import campaign, check_limits
    from oed.campaigns.connection import SIM
    from oed.campaigns.folder import Folder, only_one, over_port
    from probe import Settings

    described = load_cell(cell)
    check_limits(described, target, max_touches)  # before the folder is touched
    connection = port.connection(described)
    settings = Settings(trust_position=trust_position or connection.port == SIM)
    with only_one(output), progress(not json) as on_progress:
        folder = Folder(output, described, {cell.name: digest(cell)} | dict(described.sources))
        result = campaign(
            described,
            target_mm=target,
            max_touches=max_touches,
            rng=np.random.default_rng(seed),
            touch=over_port(output, described, connection, settings, Screen(silent=True).tell),
            keep=folder,
            tell=(lambda stage: None) if json else _line,
            progress=on_progress,
        )
    last = read_calibration(output / f"calibration-{len(result.stages)}.json")
    write_calibration(output / "calibration.json", with_promise(last))
    print_json(summary(result)) if json else print(story(result, output))
    return 0 if result.reached else 1


def summary(result: "Campaign") -> dict[str, Any]:
    """What `--json` says."""
    return {
        "touches": result.touches,
        "hits": sum(stage.hits for stage in result.stages),
        "target_mm": result.target_mm,
        "promised_p95_mm": result.promised_mm,
        "reached": result.reached,
        "why": result.why,
        "stages": [
            {
                "touches": len(stage.touches),
                "hits": stage.hits,
                "approach_mm": stage.job.cell.touch.approach,
                "promised_p95_mm": stage.promised_mm,
                "scatter": stage.calibration.scatter,
                "outliers": list(stage.calibration.outliers),
            }
            for stage in result.stages
        ],
    }


def _line(stage: "Stage") -> None:
    print(line(stage), flush=True)


def line(stage: "Stage") -> str:
    """A stage in one line."""
    if stage.promised_mm is None:
        outcome = "too few to identify the robot"
    else:
        outcome = f"promised 95 % {stage.promised_mm:.3f} mm, scatter {stage.calibration.scatter:.2f} sigma"
    left_out = f", {len(stage.calibration.outliers)} left out" if stage.calibration.outliers else ""
    return (
        f"stage {stage.job.number}: tip within {2 * stage.job.deviation:.3g} mm before, {stage.hits} of "
        f"{len(stage.touches)} touches met the jig{left_out}; {outcome}"
    )


def story(result: "Campaign", folder: Path) -> str:
    """The end, as a person reads it."""
    verdict = "reached" if result.reached else "NOT reached"
    return (
        f"{verdict} after {result.touches} touches: {result.why}\n"
        f"wrote {folder / 'calibration.json'}; an accuracy comes from touches not used here: "
        f"touchcal plan --unseen --after {folder / 'calibration.json'} chooses them"
    )
