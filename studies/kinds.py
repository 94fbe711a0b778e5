"""What is each kind of measurement worth per minute, and what are several worth together?

Setup: the arc-welder and the stepped jig, base and tool known to 2.5 mm and half a degree, in 4, 8 and 16 minutes of
measuring. A touch (0.05 mm) takes 6 seconds, a distance from one of two anchors by a draw wire (0.02 mm, anchors known
to 0.02 mm) 15, a position by a tracker (0.05 mm) 30. One design weighs 2,000 candidates of each kind (667 positions)
with the minutes as their cost (criterion V). The bound is the RMS tip error in the zone, over all robots, that no
measurements of the same minutes beat by the certificate: the median robot may be below it, where one direction leads,
as with two anchors; 30 robots drawn from the priors, with faces off by their tolerances, then make the plan and are
identified.

Answer: kinds together beat each alone. In 8 minutes, 80 touches leave 0.061 mm RMS (median of the robots), 32 distances
0.40 mm, since two anchors do not fix the frame, and 20 touches with 24 distances 0.043 mm; the bounds are 0.061, 0.613
and 0.039 mm, the promises 0.076, 0.614 and 0.046. In 16 minutes it is 0.047, 0.36 and 0.035 mm. A position that takes
five times as long as a touch is worth more than five touches: 16 of them leave 0.057 mm, 32 leave 0.035, and together
with touches 0.050 and 0.035, by the bounds 0.047 for 0.052 and 0.034 for 0.037. 4 minutes are few: 0.084 mm with 40
touches, 0.080 with 25 touches and 6 distances; 8 positions do not determine the robot, 0.36 mm, and a plan that may
take touches and positions takes 40 touches.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from identify.estimation.calibrate import calibrate
from identify.model.cell import Cell, Device, Point
from identify.model.measurement import Measurements
from identify.model.zone import zone_poses
from identify.report.svg import Chart, colour, logarithmic, picture
from oed.planning.kinds import plan_kinds
from oed.planning.kinds_problem import KindsProblem, kinds_problem
from probe.virtual.readings import draw_named, readings
from studies.common import arc_welder
from studies.engine import Table, column, distinct, where
from studies.promise import scaled
from studies.simulator.touching import touched

SETS = ("touch", "distance", "touch,distance", "position", "touch,position")
BUDGETS = (4.0, 8.0, 16.0)  # minutes
NEAR = 0.25  # of the priors of the library cell
ROBOTS = 30
WIRE = Device(minutes=0.25, sigma=0.02, range=(250.0, 900.0))
TRACKER = Device(minutes=0.5, sigma=0.05)
ANCHORS = {"anchor_a": (450.0, -50.0, 10.0), "anchor_b": (-50.0, 350.0, 10.0)}


def tasks(small: bool) -> list[dict[str, Any]]:
    """A set of kinds and a budget a task."""
    size = {"robots": 2, "count": 150} if small else {"robots": ROBOTS, "count": 2000}
    budgets, sets = (BUDGETS[1:2], SETS[1:3]) if small else (BUDGETS, SETS)
    return [{"kinds": kinds, "minutes": minutes, **size} for minutes in budgets for kinds in sets]


@lru_cache(maxsize=1)
def cell() -> Cell:
    """The library cell measured to a quarter of its tolerances, with two anchors for a draw wire and a tracker."""
    points = {name: Point(np.array(place), 0.02) for name, place in ANCHORS.items()}
    return replace(scaled(arc_welder(), NEAR), points=points, devices={"distance": WIRE, "position": TRACKER})


@lru_cache(maxsize=8)
def problem(kinds: str, count: int) -> KindsProblem:
    """The candidates of some kinds."""
    return kinds_problem(cell(), kinds.split(","), np.random.default_rng(0), count=count)


def run(rng: np.random.Generator, kinds: str, minutes: float, robots: int, count: int) -> list[dict[str, Any]]:
    """One row: what the bound of the design, the plan and robots that make it say of the tip error in the zone."""
    bound = problem(kinds, count).design(minutes, excursions=0)[0].relaxation
    design = plan_kinds(cell(), kinds.split(","), minutes, rng=np.random.default_rng(0), count=count)
    q, errors = zone_poses(cell(), rng=np.random.default_rng(4711)), []
    for _ in range(robots):
        theta = cell().theta + cell().spread * rng.standard_normal(len(cell().theta))
        further = draw_named(cell(), rng)
        faces = {face.name: face.tolerance * rng.standard_normal() for face in cell().the_jig.faces}
        tables: list[Measurements] = [
            touched(cell(), part.plan, theta, faces, rng)
            if part.table is None
            else readings(cell(), part.table, theta, rng, further)
            for part in design.parts
        ]
        calibration = calibrate(cell(), *tables, folds=0, errors="cell")
        off = [cell().kinematics.tip(q, one)[0] for one in (calibration.theta, theta)]
        errors.append(np.linalg.norm(off[0] - off[1], axis=1))
    rms = np.sqrt((np.array(errors) ** 2).mean(axis=1))
    return [
        {
            "kinds": kinds,
            "minutes": minutes,
            "measured": " + ".join(f"{n} {kind}" for kind, n in design.counts.items()),
            "bound_rms_mm": float(np.sqrt(bound.bound)),
            "promised_rms_mm": design.promise.rms_mm,
            "promised_p95_mm": design.promise.p95_mm,
            "rms_mm": float(np.median(rms)),
            "p95_mm": float(np.quantile(np.array(errors), 0.95)),
        }
    ]


def answer(table: Table) -> str:
    """A line a set and a budget."""
    lines = [f"{'kinds':18}{'minutes':>8}{'bound':>9}{'promise':>9}{'robots':>9}  RMS tip error in the zone, mm"]
    for kinds in distinct(table, "kinds"):
        some = where(table, kinds=kinds)
        rows = zip(
            *(some[name] for name in ("minutes", "bound_rms_mm", "promised_rms_mm", "rms_mm", "measured")), strict=True
        )
        lines += [f"{kinds:18}{m:8.0f}{b:9.3f}{p:9.3f}{r:9.3f}  {what}" for m, b, p, r, what in rows]
    return "\n".join(lines)


def pictures(table: Table) -> dict[str, str]:
    """RMS tip error of the robots against minutes, a line each set of kinds."""
    chart = Chart(
        "RMS tip error in the weld zone, median of robots, by what is measured",
        logarithmic("minutes of measuring", column(table, "minutes")),
        logarithmic("RMS tip error, mm", column(table, "rms_mm")),
        width=640,
        height=360,
    )
    sets = distinct(table, "kinds")
    shades = colour(np.linspace(0.0, 0.85, len(sets)))
    for kinds, shade in zip(sets, shades, strict=True):
        some = where(table, kinds=kinds)
        x, y = chart.x.scaled(column(some, "minutes")), chart.y.scaled(column(some, "rms_mm"))
        chart.line(x, y, shade)
        chart.dots(
            x, y, shade, [f"{what}: {e:.3f} mm" for what, e in zip(some["measured"], some["rms_mm"], strict=True)]
        )
    chart.legend([(shade, kinds.replace(",", " and ")) for shade, kinds in zip(shades, sets, strict=True)])
    return {"kinds": picture(chart)}
