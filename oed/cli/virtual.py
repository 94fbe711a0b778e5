"""`touchcal virtual`."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from identify.model.files import InputError
from oed.cli.options import CellFile, Seed, load_cell


def virtual(
    *,
    cell: CellFile = Path("cell.yaml"),
    truth: str | None = None,
    protocol: Literal["line", "grbl"] = "line",
    port: str = "pty",
    fault: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    speed: float = 1.0,
    log: Path | None = None,
    seed: Seed = 0,
) -> None:
    """Serve a virtual robot cell on a pseudo-terminal or socket, and print its URL.

    Its true robot differs from the cell file in ways that only it knows. Plans made for the cell can be run on it:
    touchcal run plan.csv --port URL. It ends with Ctrl-C. Faults are spoiled lines, both ways: bit-flip, lost-byte,
    garbage, duplicate, lost-line, spoil (any of these), unsolicited; mishaps in a search: unplug, reboot, reboot-lost
    (its position, too), hang, stuck, open, bounce, stall, estop; and early, something in the way of a move. Written
    KIND:RATE at random or KIND@N at the N-th, then options: unplug@3,seconds=2,fraction=0.5. Examples:

        touchcal virtual --truth library:arc-welder --fault spoil:0.05 --fault unplug@3,seconds=2 --speed inf

        touchcal virtual --protocol grbl --port socket:5007 --log executed.jsonl

    Parameters
    ----------
    truth
        library:arc-welder, or a YAML file: parameters: {base.x: 339.1, j2.alpha: 1.2} by the names that identify
        prints, mm or degrees, others as in the cell; drawn from the cell's priors where not given.
    protocol
        What it speaks.
    port
        pty, socket, or socket:PORT.
    fault
        A fault to order; may be given several times.
    speed
        1 is real time, 20 twenty times faster (touchcal run --time-scale 20), inf as fast as possible.
    log
        Write what was executed and truly touched, as JSON lines.
    """
    from probe.virtual.command import choose_truth, run

    described = load_cell(cell)
    if speed <= 0:
        raise InputError(f"--speed is {speed:g}, expected a number above 0")
    try:
        chosen_truth = choose_truth(described, truth, seed)
        run(
            described,
            chosen_truth,
            lambda url: print(url, flush=True),
            protocol=protocol,
            port=port,
            faults=fault,
            seed=seed,
            speed=speed,
            axis_unit_deg=described.controller.axis_unit_deg,
            log=log,
        )
    except ValueError as error:
        raise InputError(str(error)) from None
