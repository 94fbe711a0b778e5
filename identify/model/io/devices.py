"""Devices in files: what makes measurements of a kind (`measure:` of the cell)."""

from typing import Any

import numpy as np

from identify.model.cell import DEG, DEVICES, Device
from identify.model.files import Mistake
from identify.model.io.document import Document
from identify.model.io.schema import DeviceEntry
from identify.model.io.units import outside


def device_of(kind: str, entry: DeviceEntry) -> Device:
    """What makes measurements of a kind, from its entry and what is usual for the kind."""
    usual = DEVICES[kind]
    return Device(
        minutes=usual.minutes if entry.minutes is None else entry.minutes,
        sigma=entry.sigma_mm,
        turn_sigma=usual.turn_sigma if entry.sigma_deg is None else entry.sigma_deg * DEG,
        range=usual.range if entry.range_mm is None else entry.range_mm,
        max_tilt=usual.max_tilt if entry.max_tilt_deg is None else entry.max_tilt_deg * DEG,
        box=None if entry.box_mm is None else np.array(entry.box_mm),
    )


def device_entry(device: Device) -> dict[str, Any]:
    """The inverse of `device_of`."""
    return {
        "minutes": device.minutes,
        "sigma_mm": device.sigma,
        "sigma_deg": outside(device.turn_sigma, DEG),
        "range_mm": device.range,
        "max_tilt_deg": outside(device.max_tilt, DEG),
        "box_mm": None if device.box is None else device.box.tolist(),
    }


def device_mistakes(document: Document) -> list[Mistake]:
    """Ranges and boxes whose ends are the wrong way round, and a scatter of touches beside that under touch:."""
    measure, wrong = document.get("measure"), []
    for kind, entry in measure.items() if isinstance(measure, dict) else ():
        if not isinstance(entry, dict):
            continue
        box = entry.get("box_mm")
        for pair in (entry.get("range_mm"), *(box if isinstance(box, list) else ())):
            if isinstance(pair, list) and len(pair) == 2 and all(isinstance(x, int | float) for x in pair):
                low, high = pair
                if low > high:
                    text = f"[{low:g}, {high:g}]: write the smaller number first"
                    wrong.append(document.wrong(text, "measure", kind))
        if kind == "touch" and entry.get("sigma_mm") is not None:
            wrong.append(document.wrong("the scatter of touches is sigma_mm under touch:", "measure", kind, "sigma_mm"))
    return wrong
