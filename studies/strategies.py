"""Which strategy of choosing touches leaves the smallest tip error, and by which index should touches be planned?

Setup: on the paper's arc-welder and the stepped jig, 33, 50 and 100 touches are chosen by every strategy: evenly
over the faces as the paper does, at random, optimal by each index of the table, and sequential (30 touches, identify,
plan the rest with what is known). 200 robots drawn from the priors (20 for sequential), with faces off by their
tolerances and touches scattering by 0.05 mm, make each set and are identified; the tip is compared with the truth at
200 poses of the weld zone. A touch that would miss its face is aimed again.

Answer: plan by V, the mean tip variance in the zone: it is the default. 50 touches planned by V leave 0.096 mm RMS in
the zone (median over the robots), less than 100 even ones (0.115) or 100 random ones (0.107); 33 leave 0.131 and 100
leave 0.071. Sequential planning gains 10 to 24 % more (0.115, 0.086, 0.054): a plan for robots that may be centimetres
off stays away from the edges of the faces, where touches tell the most and miss the most, and one for a robot that is
known need not. Then come G (0.150, 0.101, 0.073), O5 (0.141, 0.105, 0.078), O1 and D (0.151 and 0.174, 0.111 and 0.107,
0.081 and 0.078) and A (0.169, 0.109, 0.075); E, O2, O3 and O4 leave 1.2 to 1.7 times as much as V. Even and random
touches leave 1.5 to 4.3 times as much.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from identify.estimation.calibrate import calibrate
from identify.model.touch import HIT, Plan, Touches
from identify.report.svg import AFTER, BEFORE, OUT, Chart, logarithmic, named, picture
from oed.criteria.criteria import CRITERIA
from oed.criteria.own import OwnCriterion
from oed.planning.candidate_set import make_candidate_set, plan_of
from oed.planning.plan import COUNT, plan
from oed.planning.strategies import Setting
from studies.common import FEW, arc_welder, zone
from studies.engine import Table, column, distinct, where
from studies.many import ManyTouches, calibrate_many, draw_faces, draw_many, errors_in_zone, touch_every

NUMBERS = (33, 50, 100)
FIRST = 30  # touches before the rest of a sequential set is planned
ROBOTS, SEQUENTIAL = 200, 20
OTHERS = ("even", "random", "sequential")


def tasks(small: bool, own: Mapping[str, str] | None = None) -> list[dict[str, Any]]:
    """Every strategy at every number of touches; a criterion of one's own beside even touches and V alone."""
    names, numbers = [*OTHERS[:2], *CRITERIA, *OTHERS[2:]], list(NUMBERS)
    if small or own:
        names, numbers = ["even", "V"], numbers[:1] if small else numbers
    if own:
        names.append(OwnCriterion(**own).define().name)
    robots = {"sequential": SEQUENTIAL}
    size = {"robots": 3, "offered": FEW} if small else {"robots": ROBOTS, "offered": COUNT}
    some = {name: size if small else size | {"robots": robots.get(name, ROBOTS)} for name in names}
    further = {"own": own} if own else {}
    return [
        {"name": name, "n": n, **some[name], **(further if name == names[-1] else {})}
        for name in names
        for n in numbers
    ]


def run(
    rng: np.random.Generator, name: str, n: int, robots: int, offered: int, own: Mapping[str, str] | None = None
) -> list[dict[str, Any]]:
    """One row a robot: its tip error in the zone after calibration."""
    if own:
        OwnCriterion(**own).define()  # of the process that computes
    cell = arc_welder()
    theta = draw_many(cell, robots, rng)
    errors = _sequential(rng, n, theta, offered) if name == "sequential" else _at_once(rng, name, n, theta, offered)
    error = errors_in_zone(cell, theta, errors, zone(200))
    return [
        {
            "strategy": name,
            "touches": n,
            "mean_mm": float(e.mean()),
            "rms_mm": float(np.sqrt((e**2).mean())),
            "p95_mm": float(np.quantile(e, 0.95)),
            "max_mm": float(e.max()),
        }
        for e in error
    ]


def chosen(rng: np.random.Generator, name: str, n: int, offered: int) -> Plan:
    """The touches of a strategy; `name` is even, random or an index to optimise."""
    options: dict[str, Any] = {"strategy": name} if name in ("even", "random") else {"strategy": "optimal"}
    options |= {"criterion": name} if name in CRITERIA else {}
    return plan(arc_welder(), n, rng=rng, count=offered, **options).plan


def _at_once(rng: np.random.Generator, name: str, n: int, theta: np.ndarray, offered: int) -> np.ndarray:
    cell, touch_plan = arc_welder(), chosen(rng, name, n, offered)
    proud = draw_faces(cell, touch_plan, len(theta), rng)
    return calibrate_many(cell, touch_every(cell, theta, touch_plan, rng, proud=proud), eliminate=False).theta


def _sequential(rng: np.random.Generator, n: int, theta: np.ndarray, count: int) -> np.ndarray:
    """Robots identified from touches of which the later ones were planned after the first were made."""
    cell, first = arc_welder(), chosen(rng, "V", FIRST, count)
    errors = []
    for true in theta[:, None]:
        touches = [_touches(first, touch_every(cell, true, first, rng, proud=draw_faces(cell, first, 1, rng)))]
        if n > FIRST:
            offer = make_candidate_set(cell, rng, after=calibrate(cell, *touches, folds=0, errors="cell"), count=count)
            rest = plan_of(Setting(offer, "V", "optimal", rng).quickly(n - FIRST))
            touches.append(
                _touches(rest, touch_every(cell, true, rest, rng, proud=draw_faces(cell, rest, 1, rng)), "b")
            )
        errors.append(calibrate(cell, *touches, folds=0, errors="cell").theta)
    return np.array(errors)


def _touches(touch_plan: Plan, simulation: ManyTouches, mark: str = "a") -> Touches:
    """The touches of one robot as the driver writes them; misses are left out."""
    count, nothing = len(touch_plan), ("",) * len(touch_plan)
    ids = tuple(f"{mark}{name}" for name in touch_plan.ids)
    table = Touches(
        ids,
        touch_plan.face,
        simulation.q[0],
        simulation.normal,
        simulation.offset,
        simulation.sigma,
        (HIT,) * count,
        np.full(count, np.nan),
        nothing,
        nothing,
    )
    return table.take(simulation.hit[0])


def medians(table: Table, measure: str = "rms_mm") -> dict[str, dict[int, float]]:
    """Strategy -> number of touches -> median over the robots."""
    return {
        name: {
            int(n): float(np.median(column(where(table, strategy=name, touches=n), measure)))
            for n in distinct(where(table, strategy=name), "touches")
        }
        for name in distinct(table, "strategy")
    }


def answer(table: Table) -> str:
    """Medians over the robots, a line each strategy, the best first."""
    curves = {measure: medians(table, measure) for measure in ("rms_mm", "p95_mm", "max_mm")}
    numbers = [int(n) for n in distinct(table, "touches")]
    order = sorted(curves["rms_mm"], key=lambda name: sum(np.log(list(curves["rms_mm"][name].values()))))
    lines = [f"{'median over robots, mm':24}" + "".join(f"{f'n = {n}: RMS':>13}{'95 %':>7}{'max':>7}" for n in numbers)]
    for name in order:
        cells = [
            f"{curves['rms_mm'][name][n]:13.3f}{curves['p95_mm'][name][n]:7.3f}{curves['max_mm'][name][n]:7.3f}"
            for n in numbers
        ]
        lines.append(f"{name:24}" + "".join(cells))
    return "\n".join(lines)


def pictures(table: Table) -> dict[str, str]:
    """Tip error by strategy, the best first, a colour for each number of touches."""
    curves = medians(table)
    numbers = [int(n) for n in distinct(table, "touches")]
    names = sorted(curves, key=lambda name: curves[name][numbers[0]])
    title = "RMS tip error in the weld zone, mm"
    chart = Chart(
        f"{title}, after calibration: median over robots drawn from the priors",
        named("how touches are chosen: optimal by an index, or else", names),
        logarithmic(title, [e for line in curves.values() for e in line.values()]),
        width=760,
        height=380,
        slanted=True,
    )
    for n, shade in zip(numbers, (BEFORE, AFTER, OUT), strict=False):
        error = np.array([curves[name].get(n, np.nan) for name in names])
        there = np.flatnonzero(np.isfinite(error))
        hints = [f"{names[i]}, {n} touches: {error[i]:.3f} mm" for i in there]
        chart.dots(there.astype(float), chart.y.scaled(error[there]), shade, hints, 4)
    chart.legend([(shade, f"{n} touches") for n, shade in zip(numbers, (BEFORE, AFTER, OUT), strict=False)])
    return {"strategies": picture(chart)}
