"""`touchcal plan --kinds`: measurements of several kinds for a budget of minutes."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identify.model.files import InputError, digest, write_json, write_text
from oed.cli.options import print_json
from oed.cli.screen.progress import progress

if TYPE_CHECKING:
    from identify.model.cell import Cell
    from identify.model.io.calibration_file import Calibration

UNITS = {"": 1.0, "min": 1.0, "m": 1.0, "h": 60.0, "s": 1 / 60}  # minutes


@dataclass(frozen=True)
class KindsChoice:
    """What a plan of several kinds is to choose, and the options given that it does not heed."""

    kinds: str
    budget: str | None
    criterion: str
    unheeded: tuple[str, ...]


def plan_of_kinds(
    choice: KindsChoice, cell: "Cell", cell_file: Path, after: "Calibration | None", output: Path, seed: int, json: bool
) -> None:
    """Write plan.csv, plan.json, plan.html, and a table for the readings of all kinds but touches."""
    from identify.model.io.kinds_plan import kinds_plan_text, readings_text, whole_plan
    from identify.report.plan import plan_page
    from oed.planning.kinds import plan_kinds, summary

    if choice.budget is None:
        raise InputError("--kinds asks for a budget of minutes: write --budget 15min")
    if choice.unheeded:
        raise InputError(f"{choice.unheeded[0]} does not go with --kinds and --budget; leave it out")
    kinds = [name.strip() for name in choice.kinds.split(",") if name.strip()]
    with progress(not json) as on_progress:
        result = plan_kinds(
            cell,
            kinds,
            minutes_of(choice.budget),
            choice.criterion,
            np.random.default_rng(seed),
            after=after,
            progress=on_progress,
        )
    some = set(result.counts) != {"touch"}
    readings = output.with_name(f"{output.stem}-readings.csv") if some else None
    described = summary(result) | {"seed": seed}
    write_text(output, kinds_plan_text(result.parts, cell.robot))
    if readings is not None:
        write_text(readings, readings_text(result.parts, cell.robot))
    write_json(output.with_suffix(".json"), described, {cell_file.name: digest(cell_file)} | dict(cell.sources))
    write_text(output.with_suffix(".html"), plan_page(cell, whole_plan(result.parts), described))
    if json:
        print_json(described)
    else:
        print(kinds_story(described, output, readings))


def minutes_of(text: str) -> float:
    """Minutes of a budget such as 15min, 1h or 90s; raises InputError if it is none."""
    words = text.strip().lower()
    number = words.rstrip("abcdefghijklmnopqrstuvwxyz ")
    try:
        return float(number) * UNITS[words[len(number) :].strip()]
    except (ValueError, KeyError):
        raise InputError(f"--budget is '{text}'; write how long measuring may take, 15min for example") from None


def kinds_story(described: dict[str, Any], output: Path, readings: Path | None) -> str:
    """The plan as a person reads it."""
    promise, share = described["promise"], described["efficiency"]
    counts = ", ".join(f"{count} of kind {kind}" for kind, count in described["measurements"].items())
    minutes = f"{described['minutes']:.1f} of {described['budget_min']:.1f} minutes"
    lines = [
        f"{counts}; criterion {described['criterion']}, {minutes}",
        f"promised tip error in the weld zone: RMS {promise['rms_mm']:.3f} mm, 95 % {promise['p95_mm']:.3f} mm",
        *(
            f"{kind} alone, the same minutes: RMS {p['rms_mm']:.3f} mm, 95 % {p['p95_mm']:.3f} mm"
            for kind, p in described["alone"].items()
        ),
        "minutes   " + "".join(f"{point['minutes']:7.1f}" for point in described["curve"]),
        "95 % [mm] " + "".join(f"{point['p95_mm']:7.3f}" for point in described["curve"]),
    ]
    if share is not None:
        number = ", ".join(f"{count} of kind {kind}" for kind, count in described["candidates"].items())
        lines.append(f"at least {100 * share:.1f} % of the best possible for this budget over {number}")
    lines += [f"note: {sentence}" for sentence in described["notes"]]
    end = f"wrote {output}, to look at in {output.with_suffix('.html').name}"
    if "touch" in described["measurements"]:
        end += f"; make the touches with touchcal run {output}"
    if readings is not None:
        end += f"; write what is read at the other postures into {readings}, which touchcal identify takes"
    return "\n".join([*lines, end])
