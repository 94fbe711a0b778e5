"""Devices in files: what makes measurements of a kind (`measure:` of the cell)."""

from typing import Any

from identify.model.cell import DEVICES, Device
from identify.model.files import Mistake
from identify.model.io.document import Document
from identify.model.io.schema import DeviceEntry
from identify.model.io.units import described, entry_of

OF_TRACKERS = ("stand_mm", "azimuth_deg", "elevation_deg", "target_axis", "acceptance_deg")


def device_of(kind: str, entry: DeviceEntry) -> Device:
    """What makes measurements of a kind, from its entry and what is usual for the kind."""
    return described(Device, entry, DEVICES[kind])


def device_entry(device: Device) -> dict[str, Any]:
    """The inverse of `device_of`."""
    return entry_of(device, DeviceEntry)


def device_mistakes(document: Document) -> list[Mistake]:
    """Ends the wrong way round, what no device of the kind has, and lines of sight from nowhere."""
    measure, wrong = document.get("measure"), []
    for kind, entry in measure.items() if isinstance(measure, dict) else ():
        if not isinstance(entry, dict):
            continue
        box = entry.get("box_mm")
        ranges = (entry.get(key) for key in ("range_mm", "azimuth_deg", "elevation_deg"))
        for pair in (*ranges, *(box if isinstance(box, list) else ())):
            if isinstance(pair, list) and len(pair) == 2 and all(isinstance(x, int | float) for x in pair):
                low, high = pair
                if low > high:
                    text = f"[{low:g}, {high:g}]: write the smaller number first"
                    wrong.append(document.wrong(text, "measure", kind))
        if kind == "touch" and entry.get("sigma_mm") is not None:
            wrong.append(document.wrong("the scatter of touches is sigma_mm under touch:", "measure", kind, "sigma_mm"))
        wrong += _sight_mistakes(document, kind, entry)
    return wrong


def _sight_mistakes(document: Document, kind: str, entry: dict[str, Any]) -> list[Mistake]:
    """Keys of a tracker where there is none, or where it is not said where the tracker stands."""
    keys = [key for key in OF_TRACKERS if entry.get(key) is not None]
    if keys and kind not in ("position", "pose"):
        text = f"{keys[0]} is of a tracker, which measures a position or a pose; leave it out"
    elif keys and "stand_mm" not in keys:
        text = f"{keys[0]} asks where the tracker stands; add stand_mm: [x, y, z], in the frame in which it measures"
    elif entry.get("target_axis") in ([0, 0, 0], [0.0, 0.0, 0.0]):
        text = "target_axis has length 0; write where the target looks to in the tip frame, [0, 0, 1] for example"
    else:
        return []
    return [document.wrong(text, "measure", kind, keys[0])]
