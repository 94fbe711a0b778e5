"""`touchcal import`."""

import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from identify.model.files import InputError, write_text
from oed.cli.options import CellFile, Json, Output, load_cell, next_command, print_json

if TYPE_CHECKING:
    from identify.model.touch import Touches

HERE = "127.0.0.1"


def import_log(
    *logs: Path,
    plan: Path,
    maker: str,
    cell: CellFile = Path("cell.yaml"),
    output: Output = Path("touches.csv"),
    listen: str | None = None,
    temperature: float | None = None,
    note: str = "",
    json: Json = False,
) -> int:
    """Read what a program of touchcal program logged, and write the touches that count.

    A touch counts by the rules of a live run, as far as the log shows what they ask for: the input open before, closed
    at rest and open after; the latched joints on the search; an overtravel that fits the speed; no contradiction to the
    touches before it. Exit code 1 if none counts. Examples:

        touchcal import posreg1.va numreg1.va --plan plan.csv --maker fanuc -o touches.csv

        touchcal import --listen 192.168.0.100:30100 --plan plan.csv --maker ur -o touches.csv

    Parameters
    ----------
    logs
        The files that came back from the controller; where two tell of the same touch, the later one counts.
    plan
        The plan that the program was written from.
    maker
        fanuc, kuka, abb, yaskawa or ur.
    output
        The touches, as touchcal run would have written them.
    listen
        UR: wait for the robot on HOST:PORT; PORT alone listens on this computer only. What comes is kept beside the
        touches, too, with the ending .log.
    temperature
        Degrees Celsius of robot or hall, noted with every touch.
    note
        A remark, noted with every touch.
    """
    from identify.model.io.tables import read_plan, touches_text
    from probe.programs.evidence import imported
    from probe.programs.makers import maker_of, read_logs

    described = load_cell(cell)
    touch_plan = read_plan(plan, described)
    robot_maker = maker_of(maker)
    if output.exists():
        raise InputError(
            f"{output}: it is there already; write elsewhere with -o, measured touches are not overwritten"
        )
    paths = [_received(listen, maker, logs, output)] if listen else list(logs)
    if not paths:
        raise InputError("no log is named; give the files that came back from the controller")
    read = read_logs(paths, touch_plan, described, maker)
    rows = imported(
        read, touch_plan, described, maker, straight=robot_maker.straight, temperature=temperature, note=note
    )
    write_text(output, touches_text(rows.touches, described.robot))
    return _tell(rows.touches, rows.missing, next_command(plan, output), json)


def _received(listen: str, maker: str, logs: tuple[Path, ...], output: Path) -> Path:
    """What a robot sends, kept in a file beside the touches."""
    from probe.programs import ur

    host, _, port = listen.rpartition(":")
    if maker != "ur" or logs:
        raise InputError("--listen is for --maker ur, without files; the other controllers write files")
    if not port.isdecimal() or not 0 <= int(port) <= 65535:
        raise InputError(f"--listen is '{listen}', expected HOST:PORT or PORT")
    text = ur.listen(host or HERE, int(port), lambda line: print(f"touchcal: {line}", file=sys.stderr, flush=True))
    path = output.with_suffix(".log")
    write_text(path, text)
    return path


def _tell(touches: "Touches", missing: tuple[str, ...], after: str, json: bool) -> int:
    count = Counter(touches.status)
    total = len(touches) + len(missing)
    if json:
        print_json({"touches": total, **dict(count), "not_made": list(missing)})
        return 0 if count["hit"] else 1
    for name, status, note in zip(touches.ids, touches.status, touches.note, strict=True):
        if status != "hit":
            print(f"touch {name}: {status}, {note}")
    if missing:
        print(
            f"{len(missing)} touches are in no log, from {missing[0]} on; run the files of the program that make them"
        )
    print(f"{count['hit']} of {total} touches count; go on with {after}")
    return 0 if count["hit"] else 1
