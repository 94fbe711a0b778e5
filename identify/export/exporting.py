"""Write a calibration in another format, read it again, and say how far apart the two are."""

import re
from collections.abc import Mapping

from identify.compensation.fitting import geometric
from identify.export import dh, mastering, plain_json, ur_yaml, urdf
from identify.export.formats import Deviation, Exported, Format, Original, deviation
from identify.model.files import InputError
from identify.model.io.calibration_file import Calibration

FORMATS: Mapping[str, Format] = {
    "urdf": urdf.FORMAT,
    "ur-yaml": ur_yaml.FORMAT,
    "dh-csv": dh.FORMAT,
    "json": plain_json.FORMAT,
    "mastering-text": mastering.FORMAT,
}


def export(calibration: Calibration, name: str, original: Original | None = None) -> Exported:
    """The texts of a format, and what the format costs; `original` is the URDF whose frames are kept."""
    if name not in FORMATS:
        raise InputError(f"format '{name}' is not known; choose one of {', '.join(FORMATS)}")
    entry = FORMATS[name]
    exportable = calibration if entry.beyond else geometric(calibration)
    files, notes = entry.write(exportable, original)
    distance = deviation(calibration, entry.read(files, exportable))
    return Exported(
        files, distance, (*_lost(calibration, exportable, name, distance), *_counted(calibration, name), *notes)
    )


def _counted(calibration: Calibration, name: str) -> tuple[str, ...]:
    """A word where the controller counts its joints otherwise than what is exported."""
    if name == "mastering-text" or not calibration.cell.robot.counting.differs:
        return ()
    return (f"{name} counts the joints as the model does, not as the controller (joints: of the cell)",)


def _lost(calibration: Calibration, exportable: Calibration, name: str, distance: Deviation) -> tuple[str, ...]:
    """A word about what a format cannot hold, and what that costs."""
    if exportable is calibration:
        return ()
    lost = ", ".join(calibration.cell.robot.errors)
    return (
        f"{name} holds geometry only: without {lost}, the tip is off by {distance.mean_mm:.3f} mm on the average, "
        f"{distance.max_mm:.3f} mm at most; take json, or correct programs with touchcal fix",
    )


def ends_of(calibration: Calibration) -> tuple[str, str] | None:
    """The links of the URDF that the cell's robot came from, where it came from one."""
    ends = re.search(r"from '([^']*)' to '([^']*)'$", calibration.cell.robot.source)
    return (ends[1], ends[2]) if ends else None
