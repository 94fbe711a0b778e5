"""The page of a plan: what it promises in words, and its touches in the 3-D view, before the robot moves."""

from collections.abc import Mapping, Sequence
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np

from identify.model.cell import Cell
from identify.model.touch import Plan
from identify.report.page import page, table, view
from identify.report.scene import scene

SAMPLES = 9  # of a motion from posture to posture
RED = 0.2  # share of the robots that miss a touch, from which it is drawn red
COLOURS = (
    "<p class='soft'>Touches: green where all robots that may be meet their face, red where a fifth or more miss it. "
    "Faces outlined in red: no touch of this plan.</p>"
)


def plan_page(cell: Cell, plan: Plan, summary: Mapping[str, Any]) -> str:
    """A self-contained HTML page of a plan; `summary` is what `touchcal plan --json` says of it."""
    missing = summary.get("missing")  # of touches alone
    view_data = scene(cell, None, plan.ids, plan.face, plan.q, _words(missing, len(plan)))
    view_data |= {"paths": _paths(cell, plan)}
    for touch, share in zip(view_data["touches"], missing or (), strict=False):
        touch["colour"] = f"hsl({120 * (1 - min(share / RED, 1)):.0f}, 65%, 42%)"
    for face in view_data["faces"]:
        face["bare"] = missing is not None and face["name"] not in plan.face
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
        COLOURS if missing is not None else "",
        '<div class="row"><section><h2>More or fewer touches like these</h2>',
        table([unit, "95 % of the tip errors below, mm"], curve),
        "</section><section><h2>Touches on each face</h2>",
        _faces(cell, plan, summary),
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


def _words(missing: Sequence[float] | None, count: int) -> tuple[str, ...]:
    """How many robots meet each touch."""
    if missing is None:
        return ("",) * count
    return tuple(f"{100 * (1 - share):.0f} of 100 robots meet it" for share in missing)


def _faces(cell: Cell, plan: Plan, summary: Mapping[str, Any]) -> str:
    """How many touches each face has, how surely they meet it, and why a face has none."""
    missing = summary.get("missing")
    if missing is None or cell.jig is None:
        names = sorted(set(plan.face))
        return table(["face", "touches"], [[name or "no face", str(plan.face.count(name))] for name in names])
    rows = []
    for name in [face.name for face in cell.jig.faces]:
        shares = [share for face, share in zip(plan.face, missing, strict=True) if face == name]
        why = next((note for note in summary["notes"] if f"'{name}'" in note), "can be touched; others tell more")
        meets = f"{100 * (1 - sum(shares) / len(shares)):.0f}" if shares else ""
        rows.append([name, str(len(shares)), meets, "" if shares else why])
    return table(["face", "touches", "of 100 robots meet them", "why none"], rows, words=(3,))
