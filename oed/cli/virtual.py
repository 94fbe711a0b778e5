"""`touchcal virtual`."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from identify.model.files import InputError
from oed.cli.options import CellFile, Seed, load_cell
from probe.virtual.command import choose_truth, run


def virtual(
    *,
    cell: CellFile = Path("cell.yaml"),
    truth: str | None = None,
    protocol: Literal["line", "grbl"] = "line",
    port: str = "pty",
    fault: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    speed: float = 1.0,
    seed: Seed = 0,
) -> None:
    """Serve a virtual robot cell on a pseudo-terminal or socket, and print its URL.

    Its true robot differs from the cell file in ways that only it knows. Plans made for the cell can be run on it:
    touchcal run plan.csv --port URL. It ends with Ctrl-C. Example:

        touchcal virtual --truth library:arc-welder --fault bit-flip:0.05 --speed 10

    Parameters
    ----------
    truth
        A truth file, or library:arc-welder; drawn from the cell's priors where not given.
    protocol
        What it speaks.
    port
        pty, socket, or socket:PORT.
    fault
        A fault to order, KIND:RATE or KIND@N; may be given several times. Kinds are listed where one is not known.
    speed
        1 is real time, 20 twenty times faster, inf as fast as possible.
    """
    described = load_cell(cell)
    if speed <= 0:
        raise InputError(f"--speed is {speed:g}, expected a number above 0")
    try:
        known = choose_truth(described, truth, seed)
        run(
            described, known, lambda url: print(url, flush=True),
            protocol=protocol, port=port, faults=fault, seed=seed, speed=speed,
            axis_unit_deg=described.controller.axis_unit_deg,
        )  # fmt: skip
    except ValueError as error:
        raise InputError(str(error)) from None
