"""Touches that locate a workpiece: the plan, and the cell with the workpiece in the place of the jig."""

from os.path import relpath
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identify.model.files import digest, write_json, write_text
from oed.cli.options import TOUCHES, numbers, print_json
from oed.cli.screen.progress import progress

if TYPE_CHECKING:
    from identify.model.cell import Cell
    from oed.planning.workpiece import WorkpiecePlan


def plan_of_workpiece(
    workpiece: str,
    at: str | None,
    cell: "Cell",
    cell_file: Path,
    n: int | None,
    after: Path | None,
    output: Path,
    seed: int,
    json: bool,
) -> None:
    """Write plan.csv, plan.json, and plan-cell.yaml: the cell with the workpiece in the place of the jig."""
    from identify.model.io.calibration_file import read_calibration
    from identify.model.io.description import named_jig, read_jig
    from identify.model.io.entries import POSE_UNIT
    from identify.model.io.tables import plan_text
    from oed.planning.workpiece import plan_workpiece

    pose = None if at is None else numbers(at, 6, "--at") * POSE_UNIT
    file = named_jig(workpiece)
    calibration = None if after is None else read_calibration(after)
    with progress(not json, "choosing touches"):
        result = plan_workpiece(cell, read_jig(file), n, np.random.default_rng(seed), at=pose, after=calibration)
    beside = output.with_name(f"{output.stem}-cell.yaml")
    write_text(output, plan_text(result.plan, cell.robot))
    write_text(beside, cell_text(cell_file, beside, workpiece, result.cell))
    name = "calibration.json" if after is None else after
    answer = workpiece_summary(result) | {"seed": seed}
    answer |= {"next": f"touchcal locate {name} {TOUCHES} --workpiece {workpiece}"}
    write_json(output.with_suffix(".json"), answer, {cell_file.name: digest(cell_file), workpiece: digest(file)})
    if json:
        print_json(answer)
    else:
        print(workpiece_story(answer, output, beside, after))


def cell_text(original: Path, beside: Path, workpiece: str, placed: "Cell") -> str:
    """A cell file like the original, with the workpiece as its jig; paths lead from where it will lie."""
    from io import StringIO

    from ruamel.yaml import YAML

    from identify.model.io.description import LIBRARY
    from identify.model.io.entries import pose_entry

    yaml = YAML()
    document = yaml.load(original.read_text(encoding="utf-8-sig"))
    robot = document["robot"]
    if isinstance(robot, str):
        document["robot"] = robot if robot.startswith(LIBRARY) else relpath(original.parent / robot, beside.parent)
    else:
        robot["urdf"] = relpath(original.parent / robot["urdf"], beside.parent)
    document["jig"] = workpiece if workpiece.startswith(LIBRARY) else relpath(workpiece, beside.parent)
    document["base"] = {key: round(value, 6) for key, value in dict(pose_entry(placed.base)).items()}  # type: ignore[arg-type]
    document.pop("zone", None)
    out = StringIO()
    yaml.dump(document, out)
    return out.getvalue()


def workpiece_summary(result: "WorkpiecePlan") -> dict[str, Any]:
    """What `--json` says."""
    return {
        "touches": len(result.plan),
        "faces": result.faces,
        "promise": {"rms_mm": result.promise.rms_mm, "p95_mm": result.promise.p95_mm},
        "curve": [{"touches": n, "faces": faces, "p95_mm": error} for n, faces, error in result.curve],
        "minutes": result.minutes,
        "notes": list(result.notes),
    }


def workpiece_story(answer: dict[str, Any], output: Path, beside: Path, after: Path | None) -> str:
    """The plan as a person reads it."""
    from oed.planning.workpiece import FEWEST

    promise, lines = answer["promise"], []
    lines.append(f"{answer['touches']} touches: {_on(answer['faces'])}; about {answer['minutes']:.0f} minutes")
    error = f"RMS {promise['rms_mm']:.3f} mm, 95 % {promise['p95_mm']:.3f} mm"
    lines.append(f"promised error of the corners in the base frame: {error}")
    lines += [
        f"{'minimal: ' if point['touches'] == FEWEST else '':>10}{point['touches']:3} touches  95 % "
        f"{point['p95_mm']:.3f} mm  {_on(point['faces'])}"
        for point in answer["curve"]
    ]
    if after is None:
        lines.append(
            "note: this is for a robot as drawn, with its tolerances; --after calibration.json knows it better"
        )
    lines += [f"note: {sentence}" for sentence in answer["notes"]]
    option = "" if after is None else f" --after {after}"
    return "\n".join(
        [*lines, f"wrote {output} and {beside}; make the touches with touchcal run {output} --cell {beside}{option}"]
    )


def _on(faces: dict[str, int]) -> str:
    return ", ".join(f"{count} on {name}" for name, count in faces.items())
