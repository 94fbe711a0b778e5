"""The accuracy ladder in the report: what each way of applying the calibration gives on this robot."""

from collections.abc import Sequence

import numpy as np

from identify.compensation.ladder import FRAMES, MODEL, Rung
from identify.report.page import table
from identify.report.svg import AFTER, BEFORE, Chart, axis, named

SHORT = {FRAMES: "and base frame", MODEL: "full model"}  # under a bar, where there is little room
SAID = """<p class="soft">Predicted tip errors in the weld zone. Zeros, tool and base frame are the best that there are
for each row; entering the true ones of some gives less. Verify what you have applied with touches.</p>"""


def ways(rungs: Sequence[Rung]) -> str:
    """A table and bars; nothing where there is nothing to predict."""
    if not rungs:
        return ""
    rows = [[r.way, *(f"{v:.3f}" for v in (r.errors.mean_mm, r.errors.p95_mm, r.errors.max_mm))] for r in rungs]
    header = ["entered into the controller", "mean, mm", "95 %, mm", "max, mm"]
    return f'<div class="row">{table(header, rows)}{_bars(rungs)}</div>{SAID}'


def _bars(rungs: Sequence[Rung]) -> str:
    mean, p95 = (np.array([getattr(r.errors, key) for r in rungs]) for key in ("mean_mm", "p95_mm"))
    chart = Chart(
        "Tip error in the weld zone, by what is applied",
        named("", [SHORT.get(r.way, r.way) for r in rungs]),
        axis("tip error, mm", p95, zero=True),
        520,
        260,
        slanted=True,
    )
    place = np.arange(float(len(rungs)))
    chart.bars(place, p95, BEFORE, [f"{r.way}: 95 % below {r.errors.p95_mm:.3f} mm" for r in rungs])
    chart.dots(place, mean, AFTER, [f"{r.way}: {r.errors.mean_mm:.3f} mm on average" for r in rungs], 5)
    chart.legend([(BEFORE, "95 %"), (AFTER, "mean")])
    return str(chart)
