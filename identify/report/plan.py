"""The page of a plan: what it promises in words, and its touches in the 3-D view, before the robot moves."""

from collections.abc import Mapping
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np

from identify.model.cell import Cell
from identify.model.touch import Plan
from identify.report.page import page, table, view
from identify.report.scene import scene

SAMPLES = 9  # of a motion from posture to posture


def plan_page(cell: Cell, plan: Plan, summary: Mapping[str, Any]) -> str:
    """A self-contained HTML page of a plan; `summary` is what `touchcal plan --json` says of it."""
    view_data = scene(cell, None, plan.ids, plan.face, plan.q, ("",) * len(plan)) | {"paths": _paths(cell, plan)}
    promise = summary["promise"]
    several = summary.get("measurements")  # by kind, in a plan of several
    what = f"{len(plan)} touches" if several is None else _what(several)
    words = (
        f"After these {what} the tip should be off by {promise['rms_mm']:.3f} mm (RMS) in the weld zone, "
        f"and by less than {promise['p95_mm']:.3f} mm at 95 % of it. They take about {summary['minutes']:.0f} minutes."
    )
    unit = "minutes" if several else "touches"
    curve = [[f"{point[unit]:.3g}", f"{point['p95_mm']:.3f}"] for point in summary["curve"]]
    sentences = [
        *(f"Not seen: {text}" for text in summary.get("unseen", ())),
        *(f"Note: {text}" for text in summary["notes"]),
    ]
    listed = "".join(f"<li>{escape(text)}</li>" for text in sentences)
    sections = [
        f'<h1>Touches for {escape(cell.robot.name)}</h1><p class="verdict">{escape(words)}</p>',
        f"<ul>{listed}</ul>" if listed else "",
        "<h2>Robot, jig and touches</h2>",
        view(view_data),
        '<div class="row"><section><h2>More or fewer touches like these</h2>',
        table([unit, "95 % of the tip errors below, mm"], curve),
        "</section><section><h2>Touches on each face</h2>",
        table(["face", "touches"], _counted(plan)),
        "</section></div>",
    ]
    return page(f"Touches for {cell.robot.name}", "\n".join(sections), view_data)


def _what(several: Mapping[str, int]) -> str:
    return " and ".join(f"{count} measurements of kind {kind}" for kind, count in several.items())


def _paths(cell: Cell, plan: Plan) -> list[list[list[float]]]:
    """Where the tip goes from touch to touch [mm], a line each: straight in joint space from posture to posture."""
    share = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    before, lines = plan.approach[:1], []
    for i in range(len(plan)):
        postures = np.vstack([before, plan.way(i)])
        q = np.concatenate([a + share * (b - a) for a, b in pairwise(postures)])
        lines.append(cell.kinematics.tip(q, cell.theta)[0].round(1).tolist())
        before = plan.approach[i : i + 1]
    return lines


def _counted(plan: Plan) -> list[list[str]]:
    names = sorted(set(plan.face))
    return [[name or "no face", str(plan.face.count(name))] for name in names]
