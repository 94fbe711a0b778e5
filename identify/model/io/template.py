"""The commented cell.yaml that a user starts from: the values of a cell, and what each of them means."""

from typing import Any

from identify.model.cell import Cell
from identify.model.io import schema
from identify.model.io.document import line_text
from identify.model.io.entries import pose_entry, priors_entry
from identify.model.io.units import entry_of

CELL = """\
# yaml-language-server: $schema={schema}
# The cell: the one file to write. Lengths are millimetres, angles degrees; touchcal check says what is wrong with it.

robot: {robot}
jig: {jig}

# Where the robot stands: its base frame seen from the jig frame, Trans(x, y, z) Rz Ry Rx; as near as priors says.
{base_note}{base}

# What it carries: the tip of the wire seen from the flange. The tool frame on the pendant will do.
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
# joints: {{sign: {{{joints[0]}: -1}}, zero_deg: {{{joints[1]}: 90}}, coupled: {{{joints[2]}: {joints[1]}}}}}

# Joint errors beyond geometry, once touches have chosen them (touchcal identify --errors auto).
# errors: [harmonics, compliance, backlash]

# The serial line: /dev/ttyUSB0, COM5, socket://192.168.0.5:5007; sim is the embedded virtual robot.
{controller}
"""


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
