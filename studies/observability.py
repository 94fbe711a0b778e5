"""Does an observability index tell how accurate a calibration will be?

Setup: Borm and Menq (1991) claim that the tip error after calibration falls as their index O1 rises. For 500 random
sets of 40 touches each on the paper's arc-welder, half of them drawn from all that can be made and half from a
neighbourhood of random width, every index of the table is computed; 40 robots drawn from the priors then make each set,
are identified, and their tip is compared with the truth at 200 poses of the weld zone. Printed is Spearman's rank
correlation of each index with the RMS tip error, signed so that 1 means: the better the index, the smaller the error.

Answer: yes. Over 500 sets the rank correlation with the tip error is 0.93 for V, 0.92 for G, O1, D and O5, 0.91 for A
and 0.90 for O2, O3, O4 and E: Borm and Menq's claim holds. That is mostly the sets that see too little. Among the 250
sets drawn from all touches, where the error differs by a factor of three, it is 0.64 for V, 0.61 for O5, 0.58 for A,
0.57 for G, O1 and D and 0.51 to 0.52 for O2, O3, O4 and E: the tip variance in the zone itself tells the most, and
indices that look at the smallest singular value alone tell the least.
"""

from typing import Any

import numpy as np

from identify.report.svg import AFTER, Chart, axis, logarithmic, picture
from oed.criteria.criteria import CRITERIA
from oed.planning.candidate_set import plan_of
from oed.planning.plan import indices
from studies.common import arc_welder, offered, zone
from studies.engine import Table, column, where
from studies.many import calibrate_many, draw_faces, draw_many, errors_in_zone, touch_every

SETS, ROBOTS, TOUCHES = 500, 40, 40
MOST = 1e4  # mm² that a picture shows; sets that leave a direction unseen have more, or infinity
WORST = {name: -np.inf if c.larger_is_better else np.inf for name, c in CRITERIA.items()}  # of an index without a value


def tasks(small: bool) -> list[dict[str, Any]]:
    """Ten sets a task."""
    return [{"part": part, "sets": 10, "robots": 4 if small else ROBOTS} for part in range(2 if small else SETS // 10)]


def run(rng: np.random.Generator, part: int, sets: int, robots: int) -> list[dict[str, Any]]:
    """One row a set: its indices, and the tip error that it leaves."""
    cell, offer, poses = arc_welder(), offered(structured=False), zone(200)
    rows = []
    for k in range(sets):
        members = _spread(rng, offer.candidates.q, k % 2 == 0)
        touches = offer.candidates.take(members)
        plan = plan_of(touches)
        theta = draw_many(cell, robots, rng)
        touches_of_robots = touch_every(cell, theta, plan, rng, proud=draw_faces(cell, plan, robots, rng))
        error = errors_in_zone(cell, theta, calibrate_many(cell, touches_of_robots).theta, poses)
        rms = float(np.sqrt((error**2).mean()))
        rows.append(
            {
                "set": part * sets + k,
                "drawn": ["from all", "nearby"][k % 2],
                **WORST,
                **indices(offer, offer.rows_of(offer.candidates)[members]),
                "rms_mm": rms,
            }
        )
    return rows


def _spread(rng: np.random.Generator, q: np.ndarray, everywhere: bool) -> np.ndarray:
    """Touches from all that there are, or from a neighbourhood of one of them in joint space."""
    if everywhere:
        return rng.choice(len(q), TOUCHES, replace=False)
    distance = np.linalg.norm((q - q[rng.integers(len(q))]) / q.std(axis=0), axis=1)
    nearest = np.argsort(distance)[: int(TOUCHES * np.exp(rng.uniform(np.log(3), np.log(len(q) / TOUCHES))))]
    return rng.choice(nearest, TOUCHES, replace=False)


def correlations(table: Table) -> dict[str, float]:
    """Spearman's rank correlation of each index with the error, 1 where the better index always has the less error."""
    from scipy.stats import spearmanr

    error = column(table, "rms_mm")
    values = {}
    for name, criterion in CRITERIA.items():
        sign = -1 if criterion.larger_is_better else 1
        values[name] = sign * float(spearmanr(column(table, name), error).statistic)
    return values


def answer(table: Table) -> str:
    """The correlations over all sets, and over those of touches from everywhere, the best first."""
    lines = []
    for words, some in (("sets", table), ("sets drawn from all touches", where(table, drawn="from all"))):
        pairs = sorted(correlations(some).items(), key=lambda pair: -pair[1])
        listed = ", ".join(f"{name} {value:.2f}" for name, value in pairs)
        lines.append(f"Rank correlation with the tip error over {len(some['rms_mm'])} {words}: {listed}.")
    return "\n".join(lines)


def pictures(table: Table) -> dict[str, str]:
    """O1 and V against the tip error."""
    error = column(table, "rms_mm")
    charts = {}
    most = f"V, mean predicted tip variance, mm² ({MOST:.0f} and more on the right edge)"
    for name, title in (("O1", "O1 (Borm and Menq 1991)"), ("V", most)):
        value = np.minimum(column(table, name), MOST)
        r = correlations(table)[name]
        chart = Chart(
            f"{name} of {len(error)} random sets of {TOUCHES} touches: tip error left (rank correlation {r:.2f})",
            logarithmic(title, value) if name == "V" else axis(title, value),
            logarithmic("RMS tip error in the zone, mm", error),
        )
        chart.dots(chart.x.scaled(value), chart.y.scaled(error), AFTER, [f"set {int(s)}" for s in table["set"]], 2.5)
        charts[f"observability-{name}"] = picture(chart)
    return charts
