"""`touchcal campaign`."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from identify.model.cell import Cell
from identify.model.files import InputError, digest
from identify.model.io.calibration_file import write_calibration
from oed.campaigns.campaign import Campaign, Job, Stage
from oed.campaigns.campaign import campaign as make
from oed.campaigns.folder import Folder, over_port, standing
from oed.cli.live import Screen
from oed.cli.options import CellFile, Json, Seed, load_cell, print_json, progress
from oed.cli.sim import SIM, line_options, simulated
from probe import Settings
from probe.line.clock import Clock
from probe.runs.lock import Lock


def campaign(
    *,
    target: Annotated[float, Parameter(name="--target")] = 0.15,
    max_touches: int = 150,
    cell: CellFile = Path("cell.yaml"),
    output: Annotated[Path, Parameter(name=["-o", "--output"])] = Path(),
    port: str | None = None,
    protocol: str | None = None,
    trust_position: Annotated[bool, Parameter(negative=())] = False,
    truth: str | None = None,
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
    port
        /dev/ttyUSB0, COM5, socket://host:port or sim, in place of the cell's.
    protocol
        line (TOUCH/1), grbl or linuxcnc, in place of the cell's.
    trust_position
        You have checked where the robot stands, after a restart of its controller or a move by hand.
    truth
        With port sim: what the virtual robot truly is, a file or library:arc-welder.
    """
    described = load_cell(cell)
    where, spoken = port or described.controller.port, protocol or described.controller.protocol
    settings = Settings(trust_position=trust_position or where == SIM)
    screen = Screen(silent=True)
    with only_one(output):
        folder = Folder(output, described, {cell.name: digest(cell)} | dict(described.sources))
        touch = over_port(
            output,
            described,
            lambda job: _port(where, spoken, described, truth, output, job),
            spoken,
            settings,
            Clock(),
            screen.tell,
            **line_options(described.controller, spoken),
        )
        with progress(not json) as say:
            done = make(
                described, target_mm=target, max_touches=max_touches, rng=np.random.default_rng(seed), touch=touch,
                keep=folder, tell=(lambda stage: None) if json else _line, progress=say,
            )  # fmt: skip
    write_calibration(output / "calibration.json", _last(output, len(done.stages)))
    if json:
        print_json(summary(done))
    else:
        print(story(done, output))
    return 0 if done.reached else 1


@contextmanager
def _port(where: str, protocol: str, cell: Cell, truth: str | None, folder: Path, job: Job) -> Iterator[str]:
    """The port to open; for `sim`, that of a virtual cell that was jogged to the first approach."""
    if where != SIM:
        yield where
        return
    at = standing(folder, cell, job)
    with simulated(cell, protocol, truth, np.inf, at) as (url, _):
        yield url


def _last(folder: Path, number: int) -> Any:
    from identify.model.io.calibration_file import read_calibration

    return read_calibration(folder / f"calibration-{number}.json")


@contextmanager
def only_one(folder: Path) -> Iterator[None]:
    """The folder, for one campaign at a time; a disk that is full or read-only is said in one sentence."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}; choose another folder with -o") from None
    lock = Lock(folder / "campaign.lock")
    try:
        yield
    except OSError as error:
        if error.filename is None and error.strerror is None:
            raise
        raise InputError(
            f"{error.filename or folder}: cannot be written: {error.strerror}; make room, then give the same command "
            "again: it goes on where it stopped"
        ) from None
    finally:
        lock.release()


def summary(done: Campaign) -> dict[str, Any]:
    """What `--json` says."""
    return {
        "touches": done.touches,
        "hits": sum(stage.hits for stage in done.stages),
        "target_mm": done.target_mm,
        "promised_p95_mm": done.promised_mm,
        "reached": done.reached,
        "why": done.why,
        "stages": [
            {
                "touches": len(stage.touches), "hits": stage.hits, "approach_mm": stage.job.cell.touch.approach,
                "promised_p95_mm": stage.promised_mm, "scatter": stage.calibration.scatter,
                "outliers": list(stage.calibration.outliers),
            }
            for stage in done.stages
        ],
    }  # fmt: skip


def _line(stage: Stage) -> None:
    print(line(stage), flush=True)


def line(stage: Stage) -> str:
    """A stage in one line."""
    if stage.promised_mm is None:
        told = "too few to identify the robot"
    else:
        told = f"promised 95 % {stage.promised_mm:.3f} mm, scatter {stage.calibration.scatter:.2f} sigma"
    left_out = f", {len(stage.calibration.outliers)} left out" if stage.calibration.outliers else ""
    return (
        f"stage {stage.job.number}: tip within {2 * stage.job.deviation:.3g} mm before, {stage.hits} of "
        f"{len(stage.touches)} touches met the jig{left_out}; {told}"
    )


def story(done: Campaign, folder: Path) -> str:
    """The end, as a person reads it."""
    verdict = "reached" if done.reached else "NOT reached"
    return (
        f"{verdict} after {done.touches} touches: {done.why}\n"
        f"wrote {folder / 'calibration.json'}; an accuracy comes from touches not used here: touchcal verify"
    )
