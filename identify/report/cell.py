"""The page of a cell before any touch: robot, torch, jig and zone in the 3-D view, at postures over the zone."""

from html import escape

import numpy as np

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.frames import transform
from identify.model.zone import zone_poses
from identify.report.page import page, view
from identify.report.scene import scene

POSTURES = 12  # to step through


def cell_page(cell: Cell, words: str) -> str:
    """A self-contained HTML page of a cell; `words` are what `touchcal check` says of it."""
    try:
        q = zone_poses(cell, poses=POSTURES)
        note = f"The arm at {len(q)} postures of the zone: does the torch point as the real one does?"
    except InputError as error:
        q, note = np.clip(np.zeros((1, len(cell.robot.joints))), cell.robot.lower, cell.robot.upper), str(error)
    tip, R = cell.kinematics.tip(q, cell.theta)
    lean = np.degrees(np.arccos(np.clip(-R[:, 2, 2], -1, 1)))
    remarks = [
        f"tip at ({p[0]:.0f}, {p[1]:.0f}, {p[2]:.0f}) mm, torch {a:.0f} deg from straight down"
        for p, a in zip(tip, lean, strict=True)
    ]
    view_data = scene(cell, None, tuple(f"posture {i + 1}" for i in range(len(q))), (None,) * len(q), q, tuple(remarks))
    tool = "" if cell.tool is None else _torch(cell)
    sections = [
        f'<h1>Cell of {escape(cell.robot.name)}</h1><p class="verdict">{escape(note)} {escape(tool)}</p>',
        view(view_data, "postures"),
        f"<pre>{escape(words)}</pre>",
    ]
    return page(f"Cell of {cell.robot.name}", "\n".join(sections), view_data)


def _torch(cell: Cell) -> str:
    """How the torch leaves the flange."""
    assert cell.tool is not None
    length = float(np.linalg.norm(cell.tool[:3]))
    angle = np.degrees(np.arccos(np.clip(cell.tool[2] / max(length, 1e-9), -1, 1)))
    aside = " This is sideways: is the flange link the one whose z axis points out of the wrist?" if angle > 45 else ""
    lean = np.degrees(np.arccos(np.clip(transform(cell.tool)[2, 2], -1, 1)))
    return (
        f"The tip lies {length:.0f} mm from the flange, {angle:.0f} degrees from its z axis; the wire leans {lean:.0f} "
        f"degrees from that axis.{aside}"
    )
