"""`touchcal compensate`."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from cyclopts import Parameter

from identify.model.files import sheet_text, write_text
from oed.cli.options import Flag, Json, Output, TrustUnits, numbers, print_json
from oed.cli.screen.progress import progress

if TYPE_CHECKING:
    from identify.compensation.compensate import Compensation, Place
    from identify.model.io.poses import Poses
    from identify.model.robot import Robot

LONGEST = 10  # targets left alone that are named on the screen


@Parameter(name="*")
@dataclass(frozen=True)
class Solving:
    """How joints are solved for."""

    near: str | None = None
    """A posture to look for solutions from, as the pendant shows it: joint values parted by commas (degrees, or mm).
    Not given, the branch is taken that stays farthest from singular. A correction is of the branch it was made for."""
    free_roll: Flag = False
    """Leave the turn about the wire open."""
    max_change_deg: float | None = None
    """Leave a pose alone where a joint would change by more; 3 degrees, or three times what is usual for this robot."""

    def options(self, robot: "Robot") -> dict[str, Any]:
        """The keywords of `identify.compensate`."""
        near, change = self.near, self.max_change_deg
        start = None if near is None else robot.from_controller(numbers(near, len(robot.joints), "--near"))
        limit = None if change is None else float(np.radians(change))
        return {"near": start, "free_roll": self.free_roll, "max_change": limit}


USUAL = Solving()


def compensate(
    calibration: Path,
    poses: Path,
    *,
    output: Output = Path("corrected.csv"),
    frame: str = "jig",
    fixed_to: Literal["jig", "robot"] = "jig",
    solving: Solving = USUAL,
    trust_units: TrustUnits = False,
    json: Json = False,
) -> None:
    """Corrected joint angles and corrected command poses for wanted tip poses.

    corrected.csv holds, for every pose, the joints that bring the true tip there, and the pose to tell a controller
    that believes in the nominal robot. Poses next to a singularity or a joint limit are left as they are and named.
    Example:

        touchcal compensate calibration.json poses.csv -o corrected.csv

    Parameters
    ----------
    calibration
        What touchcal identify wrote.
    poses
        Columns id, x_mm, y_mm, z_mm, rz_deg, ry_deg, rx_deg.
    output
        Where the corrected joints and poses are written.
    frame
        What the poses count from: jig, base, or a user frame in the base as x,y,z,rz,ry,rx (mm, degrees).
    fixed_to
        Poses fixed to the jig stay where they are when the base was found elsewhere; those fixed to the robot move with
        its base.
    """
    from identify.compensation.compensate import compensate as corrected
    from identify.compensation.compensate import remarks
    from identify.model.io.calibration_file import read_calibration
    from identify.model.io.poses import read_poses

    identified = read_calibration(calibration)
    robot = identified.cell.robot
    targets = read_poses(poses, trust_units=trust_units)
    options = solving.options(robot)
    with progress(not json, "solving for joints"):
        result = corrected(identified, targets.pose, frame=_frame(frame), fixed_to=fixed_to, **options)
    write_text(output, table(targets, result, robot))
    if json:
        print_json(summary(targets, result))
    else:
        print(story(targets, result, remarks(identified, "robot" if frame == "jig" else fixed_to), output))


def _frame(text: str) -> "Place":
    from identify.model.io.entries import POSE_UNIT

    if text in {"jig", "base"}:
        return text  # type: ignore[return-value]
    return numbers(text, 6, "--frame, other than jig or base,") * POSE_UNIT


def table(targets: "Poses", result: "Compensation", robot: "Robot") -> str:
    """The text of corrected.csv."""
    from identify.model.io.entries import POSE_KEYS, POSE_UNIT
    from identify.model.io.tables import joint_columns

    command = result.command / POSE_UNIT
    columns: dict[str, Any] = {
        "id": targets.ids,
        "status": ["left" if reason else "corrected" for reason in result.why],
    }
    columns |= dict(zip(joint_columns(robot), robot.to_controller(result.q).T.round(9), strict=True))
    columns |= dict(zip(POSE_KEYS, command.T.round(9), strict=True))
    return sheet_text(columns | {"note": result.why})


def _shift(targets: "Poses", result: "Compensation") -> np.ndarray:
    """How far the commands moved [mm]."""
    corrected = result.corrected
    return np.linalg.norm(result.command[corrected, :3] - targets.pose[corrected, :3], axis=1)


def summary(targets: "Poses", result: "Compensation") -> dict[str, Any]:
    """What `--json` says."""
    shift = _shift(targets, result)
    uncorrected = {name: reason for name, reason in zip(targets.ids, result.why, strict=True) if reason}
    return {
        "poses": len(targets),
        "corrected": len(shift),
        "left": uncorrected,
        "shift_mm": {"median": float(np.median(shift)), "max": float(shift.max())} if len(shift) else None,
        "max_residual_mm": float(result.residual[result.corrected].max(initial=0.0)),
    }


def story(targets: "Poses", result: "Compensation", notes: list[str], output: Path) -> str:
    """The result as a person reads it."""
    shift, lines = _shift(targets, result), [f"{int(result.corrected.sum())} of {len(targets)} poses corrected"]
    if len(shift):
        lines[0] += f"; commands moved by {np.median(shift):.3f} mm (median), {shift.max():.3f} mm at most"
    uncorrected = [(name, reason) for name, reason in zip(targets.ids, result.why, strict=True) if reason]
    lines += [f"left as they are: {count} {why}" for why, count in result.left().items()]
    lines += [f"  {name}: {reason}" for name, reason in uncorrected[:LONGEST]]
    lines += [f"  ... and {len(uncorrected) - LONGEST} more, in {output}"] if len(uncorrected) > LONGEST else []
    lines += notes
    return "\n".join([*lines, f"wrote {output}"])
