"""`touchcal locate`."""

from dataclasses import replace
from functools import reduce
from importlib.metadata import version
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter

from identify.model.files import InputError, digest, write_text
from oed.cli.options import Json, TrustUnits, numbers, only_touches, print_json, read_tables

if TYPE_CHECKING:
    from identify.model.io.calibration_file import Calibration
    from identify.workpiece.localization import Location

ABOUT = ("", "", "", *(f"   about the workpiece's {axis}" for axis in "zyx"))
TURNS = ("about_x_deg", "about_y_deg", "about_z_deg")


def locate(
    calibration: Path,
    *touches: Path,
    workpiece: str,
    near: str | None = None,
    output: Annotated[Path, Parameter(name=["-o", "--output"])] = Path("workpiece.json"),
    trust_units: TrustUnits = False,
    json: Json = False,
) -> None:
    """The pose of a workpiece in the frame of the robot's base, from touches on its faces.

    The touches name faces of the workpiece; six at least, better nine: touchcal plan --workpiece chooses them. The
    pose comes with its uncertainty, in which that of the robot is included. Example:

        touchcal locate calibration.json workpiece.csv --workpiece box.yaml -o box.json

    Parameters
    ----------
    calibration
        What touchcal identify wrote.
    touches
        touches.csv files.
    workpiece
        Its faces, in a file like that of a jig, or library:NAME.
    near
        About where it stands in the base frame, x,y,z,rz,ry,rx (mm, degrees), where its faces leave that open.
    output
        Where the pose is written.
    """
    from identify.model.io.calibration_file import read_calibration
    from identify.model.io.description import named_jig, read_jig
    from identify.model.io.entries import POSE_UNIT
    from identify.model.touch import joined
    from identify.workpiece.localization import locate as located

    if not touches:
        raise InputError("nothing to locate the workpiece by: name a touches.csv with touches on its faces")
    identified, body = read_calibration(calibration), read_jig(named_jig(workpiece))
    tables, inputs = read_tables(touches, replace(identified.cell, jig=body), trust_units)
    start = None if near is None else numbers(near, 6, "--near") * POSE_UNIT
    location = located(identified, body, reduce(joined, map(only_touches, tables)), start)
    inputs |= {calibration.name: digest(calibration), workpiece: digest(named_jig(workpiece))}
    facts = summary(identified, location)
    write_text(output, dumps({"touchcal": version("touchcal"), "inputs": inputs} | facts, indent=1) + "\n")
    if json:
        print_json(facts)
    else:
        print(story(location, output))


def summary(calibration: "Calibration", location: "Location") -> dict[str, Any]:
    """What `--json` says, and the file holds."""
    from identify.model.frames import pose, transform
    from identify.model.io.entries import POSE_KEYS, pose_entry

    jig_T_workpiece = transform(calibration.theta[:6]) @ location.base_T_workpiece
    unit = np.array([1, 1, 1, *[np.pi / 180] * 3])
    return {
        "workpiece": location.workpiece.name,
        "base_T_workpiece": pose_entry(location.pose),
        "jig_T_workpiece": pose_entry(pose(jig_T_workpiece)),
        "sigma": dict(zip((*POSE_KEYS[:3], *TURNS), (location.sigma / unit).tolist(), strict=True)),
        "covariance": (location.covariance / np.outer(unit, unit)).tolist(),
        "point_rms_mm": float(location.point_sigma(location.workpiece.corners).max()),
        "touches": len(location.residuals),
        "residuals_mm": dict(location.residuals),
        "chi2": location.chi2,
        "degrees_of_freedom": location.degrees,
        "chance": location.chance,
        "notes": list(location.notes),
    }


def story(location: "Location", output: Path) -> str:
    """The result as a person reads it."""
    from identify.model.io.entries import POSE_KEYS, POSE_UNIT
    from identify.uncertainty.promise import INTERVAL
    from identify.workpiece.localization import ALARM, said

    spread = INTERVAL * location.sigma[[0, 1, 2, 5, 4, 3]] / POSE_UNIT
    lines = [
        f"workpiece '{location.workpiece.name}' in the frame of the base, from {len(location.residuals)} touches",
        "",
    ]
    lines += [f"{'':4}{'pose':>12}{'+- (95 %)':>12}"]
    for key, value, about, give in zip(POSE_KEYS, location.pose / POSE_UNIT, ABOUT, spread, strict=True):
        name, unit = key.split("_")
        lines.append(f"{name:4}{value:12.3f}{give:12.3f} {unit}{about}")
    rms = location.point_sigma(location.workpiece.corners).max()
    lines += ["", f"its corners are known to {rms:.3f} mm (RMS, the worst one)"]
    if location.degrees and location.chance >= ALARM:
        lines.append(f"residuals are as stated (chi-square {location.chi2:.1f} of {location.degrees})")
    lines += [f"note: {note}" for note in location.notes]
    return "\n".join([*lines, f"wrote {output}; programs on it: --frame {said(location.base_T_workpiece)}"])
