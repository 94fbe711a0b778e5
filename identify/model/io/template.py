"""The commented cell.yaml that a user starts from: the values of a cell, and what each of them means."""

from typing import Any

import numpy as np

from identify.model.cell import Cell
from identify.model.io import schema
from identify.model.io.document import line_text
from identify.model.io.entries import pose_entry, priors_entry
from identify.model.io.units import entry_of

VIEW = 300.0  # [mm] around the zone, where a tracker sees the tip
AWAY, ABOVE = 2500.0, 500.0  # [mm] from the middle of the zone, where a tracker stands

CELL = """\
# yaml-language-server: $schema={schema}
# The cell: the one file to write. Lengths are millimetres, angles degrees; touchcal check says what is wrong with it.

robot: {robot}
jig: {jig}

# Where the robot stands: its base frame seen from the jig frame, Trans(x, y, z) Rz Ry Rx; as near as priors says.
{base_note}{base}

# What it carries: the tip of the wire seen from the flange. The tool frame on the pendant will do. Plans keep a torch
# clear whose nozzle is 20 mm across and 110 mm long and whose body is 40 mm across; for another, write capsules: of the
# last link into a robot file.
{tool_note}{tool}

# The end of the wire: a cut wire is flat, a melted one a ball. Cut it before the touches and lock the wire brake.
{wire}

# How touches are made: scatter of one touch, way from approach to face, longest search, search speed, largest tilt.
{touch}

# Where accuracy counts: a box in the jig frame, and how far the torch leans there from straight down.
{zone}

# How wrong the numbers above and the robot's drawing may be, 1 sigma.
{priors_note}{priors}

# How the controller counts its joints, if pendant and model differ; touchcal check --pendant proposes this line. Files
# that controller or pendant read or write (plan.csv, touches.csv, pendant.csv, programs, the line) hold its numbers.
# {{coupled: {{}}}} says that no joint is counted together with another.
# joints: {{sign: {{{joints[0]}: -1}}, zero_deg: {{{joints[1]}: 90}}, coupled: {{{joints[2]}: {joints[1]}}}}}

# Joint errors beyond geometry, once touches have chosen them (touchcal identify --errors auto).
# errors: [harmonics, compliance, backlash]

# What the flange carries, tool and torch included; measurements with another mass say so in a column payload_kg.
# payload: {{mass_kg: 4, centre_mm: [0, 0, 80]}}

# The serial line: /dev/ttyUSB0, COM5, socket://192.168.0.5:5007; sim is the embedded virtual robot.
{controller}
"""


MEASURES = {
    "tracker": """
# What measures: a tracker reads where a target at the tip is, in the frame in which the base stands. Minutes that one
# measurement takes, its scatter, the box to measure in, where the tracker stands, and the shortest and longest distance
# that it measures. It looks to azimuth_deg: [-180, 180] about z of that frame, from x, and to elevation_deg: [-50, 75]
# above the plane. A target that nobody turns to the tracker looks along target_axis: [0, 0, 1] of the tip frame, and is
# seen within acceptance_deg: 30 of it. Plans leave out what the tracker cannot see; arm, tool and obstacles hide it.
measure:
  position: {{minutes: 0.15, sigma_mm: 0.05, box_mm: {view}, stand_mm: {stand}, range_mm: [500, 20000]}}

# Further targets on the tool and further stands of the tracker, each about where it is, or fit; a row of positions.csv
# names them in the columns tool and placement.
# tools: {{smr2: {{x_mm: 60, y_mm: 0, z_mm: 350}}}}
# placements: {{second: fit}}
""",
    "ballbar": """
# Where the ball bar or draw wire is anchored, and how well that is known. Three anchors fix the frame in which the base
# and the zone stand; with two of them, it may turn about the line that joins them.
points:
  anchor_a: {first}
  anchor_b: {second}
  anchor_c: {third}

# What measures: minutes that one distance takes, its scatter, the shortest and longest distance (the same for a bar of
# fixed length), and how far the bar may lean from upright.
measure:
  distance: {{minutes: 0.25, sigma_mm: 0.02, range_mm: [300, 800], max_tilt_deg: 70}}
""",
    "sockets": """
# Sockets in which the ball at the tip sits, and how well their places are known; fit, where nobody has measured one.
# One known distance is the scale of everything: without it the robot could be smaller, and nothing would show it.
points:
  socket_a: {first}
  socket_b: {second}
  socket_c: {third}
spacings:
  - {{from: socket_a, to: socket_b, mm: {spacing}, sigma_mm: 0.02}}

# What measures: minutes until the ball sits in a socket, the scatter, and how far the tool may lean from upright.
measure:
  contact: {{minutes: 1, sigma_mm: 0.05, max_tilt_deg: 60}}
""",
}
"""What stands in the cell for devices other than a wire and a jig."""


def measure_text(measure: str, cell: Cell) -> str:
    """The part of cell.yaml for a device, with anchors and sockets at the foot of the zone."""
    assert cell.zone is not None
    low, high = cell.zone.box.T
    view = np.stack([low - VIEW, high + VIEW], axis=1)
    view[2, 0] = low[2]
    third = np.array([low[0], high[1], low[2]])
    corners = [np.append(corner[:2], low[2]) for corner in (low, high, third)]
    places = [
        dict(zip(("x_mm", "y_mm", "z_mm"), c.round().tolist(), strict=True)) | {"sigma_mm": 0.05} for c in corners
    ]
    first, second, third_place = (_line("point", place).partition(": ")[2] for place in places)
    return MEASURES[measure].format(
        view=_short(view.round().tolist()),
        stand=_short(_stand(cell).round(-1).tolist()),
        first=first,
        second=second,
        third=third_place,
        spacing=f"{np.linalg.norm(corners[0] - corners[1]):.1f}",
    )


def _stand(cell: Cell) -> np.ndarray:
    """Where a tracker looks across the zone towards the robot."""
    assert cell.zone is not None
    assert cell.base is not None
    middle = cell.zone.box.mean(axis=1)
    away = (middle - cell.base[:3]) * np.array([1.0, 1.0, 0.0])
    return np.asarray(middle + AWAY * away / max(np.linalg.norm(away), 1e-9) + np.array([0.0, 0.0, ABOVE]))


def cell_text(cell: Cell, robot: str, jig: str, notes: dict[str, str], schema_file: str) -> str:
    """The text of cell.yaml; `robot`, `jig` and `schema_file` name files, `notes` say where values come from."""
    names = [joint.name for joint in cell.robot.joints]
    controller = {key: entry_of(cell.controller, schema.ControllerEntry)[key] for key in ("port", "protocol")}
    return CELL.format(
        schema=schema_file,
        robot=robot,
        jig=jig,
        joints=(names * 3)[:3],
        base=_line("base", pose_entry(cell.base)),
        tool=_line("tool", pose_entry(cell.tool)),
        wire=_line("wire", entry_of(cell.wire, schema.WireEntry)),
        touch=_line("touch", entry_of(cell.touch, schema.TouchEntry)),
        zone=_line("zone", entry_of(cell.zone, schema.ZoneEntry)),
        priors=_line("priors", priors_entry(cell.priors)),
        controller=_line("controller", controller),
        **{f"{key}_note": f"# {notes[key]}\n" if key in notes else "" for key in ("base", "tool", "priors")},
    )


def _line(key: str, entry: Any) -> str:
    return line_text(key, _short(entry))


def _short(value: Any) -> Any:
    """Numbers as a person writes them: six digits, and no point behind whole ones."""
    if isinstance(value, dict):
        return {key: _short(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_short(item) for item in value]
    if isinstance(value, float):
        rounded = round(value, 6) + 0.0
        return int(rounded) if rounded.is_integer() else rounded
    return value
