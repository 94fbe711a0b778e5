"""When do lengths collapse, and what does one known length do?

Setup: the arc-welder, its base and tool known to 2.5 mm and half a degree, brings a ball into four sockets whose places
are to be fitted, 60 contacts in all, to 0.03 mm. No length is known, or the distance of two sockets, 400 or 350 mm
apart, to 0.01 to 1 mm. 30 robots a line. The identified robot's tips at the poses of the zone are laid over the true
ones by the best rigid motion (Umeyama 1991): what is left is the error that no choice of frame explains, and the scale
between them is the error of all lengths together.

Answer: without a known length all lengths could shrink together and every contact would still fit: calibrations are
refused, all of them, and the same holds for a length that is known to a millimetre, since a thousandth of 400 mm would
pass unnoticed. One length known to 0.01 mm leaves a scale error of 47 to 52 millionths and 0.02 mm RMS in the zone;
0.03 mm leave 76 to 81 millionths, 0.1 mm leave 265 to 283, which is the error of the length itself; 0.3 mm leave 0.08
mm RMS. From 0.03 mm on, a better known length buys nothing for the tip: the scatter of the contacts remains.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float

from identify.estimation.calibrate import calibrate
from identify.model.cell import Cell, Device, Point, Spacing
from identify.model.files import InputError
from identify.model.measurement import Measurements
from identify.model.zone import zone_poses
from identify.report.svg import Chart, colour, logarithmic, picture
from oed.candidates.kinds import measurements
from probe.virtual.readings import readings
from studies.common import arc_welder
from studies.engine import Table, column, distinct, where
from studies.promise import scaled

SOCKETS = np.array([[60.0, 40.0, 260.0], [460.0, 40.0, 260.0], [60.0, 340.0, 290.0], [330.0, 250.0, 330.0]])  # [mm]
LENGTHS = ((0, 3), (0, 1))  # sockets whose distance is known
SIGMAS = (0.01, 0.03, 0.1, 0.3, 1.0)  # [mm], of that distance
CONTACTS, SIGMA = 60, 0.03  # and their scatter [mm]
ROBOTS = 30
NEAR = 0.25  # of the priors of the library cell


def tasks(small: bool) -> list[dict[str, Any]]:
    """A known length and how well it is known, a task; first no length at all."""
    sigmas, robots = (SIGMAS[1:2], 2) if small else (SIGMAS, ROBOTS)
    tasks = [{"pair": k, "sigma": sigma} for k in range(len(LENGTHS)) for sigma in sigmas]
    return [{"pair": -1, "sigma": 0.0, "robots": min(robots, 5)}, *({**one, "robots": robots} for one in tasks)]


@lru_cache(maxsize=1)
def planned() -> tuple[Cell, Measurements]:
    """Sockets about where they stand, and postures in them."""
    points = {f"socket_{k}": Point(place, 0.0) for k, place in enumerate(SOCKETS)}
    cell = replace(scaled(arc_welder(), NEAR), jig=None, zone=arc_welder().zone, points=points)
    cell = replace(cell, devices={"contact": Device(sigma=SIGMA)})
    return cell, measurements(cell, "contact", np.random.default_rng(0), CONTACTS)[0]


def run(rng: np.random.Generator, pair: int, sigma: float, robots: int) -> list[dict[str, Any]]:
    """One row a robot: the error of its scale, and of the tip in the zone once it is laid over the truth."""
    cell, table = planned()
    start = replace(cell, points={name: Point(None) for name in cell.points})
    q, rows = zone_poses(cell, rng=np.random.default_rng(4711)), []
    for _ in range(robots):
        theta = cell.theta + cell.spread * rng.standard_normal(len(cell.theta))
        places = SOCKETS + rng.standard_normal(SOCKETS.shape)
        true = dict(zip(cell.points, places, strict=True))
        tables = readings(replace(cell, points={n: Point(p) for n, p in true.items()}), table, theta, rng)
        spacings: tuple[Spacing, ...] = ()
        if pair >= 0:
            a, b = LENGTHS[pair]
            length = float(np.linalg.norm(places[a] - places[b]))
            read = length + sigma * rng.standard_normal()
            spacings = (Spacing(f"socket_{a}", f"socket_{b}", read, sigma),)
        row = {
            "length_mm": round(float(np.linalg.norm(np.subtract(*SOCKETS[list(LENGTHS[pair])]))), -1)
            if pair >= 0
            else 0.0
        }
        try:
            calibration = calibrate(replace(start, spacings=spacings), tables, folds=0, errors="cell")
        except InputError:
            rows.append(row | {"sigma_mm": sigma, "refused": 1, "scale_ppm": np.nan, "rms_mm": np.nan})
            continue
        tips = [cell.kinematics.tip(q, one)[0] for one in (calibration.theta, theta)]
        rms, scale = laid_over(*tips)
        rows.append(row | {"sigma_mm": sigma, "refused": 0, "scale_ppm": 1e6 * (scale - 1), "rms_mm": rms})
    return rows


def laid_over(points: Float[np.ndarray, "points 3"], onto: Float[np.ndarray, "points 3"]) -> tuple[float, float]:
    """RMS distance [mm] after the best rigid motion, and the scale of the points (Umeyama 1991)."""
    a, b = points - points.mean(axis=0), onto - onto.mean(axis=0)
    U, s, Vt = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    R = (U * sign) @ Vt
    return float(np.sqrt(((a @ R.T - b) ** 2).sum(axis=1).mean())), float((a**2).sum() / (s * sign).sum())


def answer(table: Table) -> str:
    """A line a length and how well it is known."""
    lines = [f"{'known length mm':>16}{'sigma mm':>10}{'robots':>8}{'refused':>9}{'scale 1e-6':>12}{'RMS mm':>8}"]
    for length in distinct(table, "length_mm"):
        for sigma in distinct(where(table, length_mm=length), "sigma_mm"):
            some = where(table, length_mm=length, sigma_mm=sigma)
            scale, rms = column(some, "scale_ppm"), column(some, "rms_mm")
            good = np.isfinite(scale)
            words = f"{np.sqrt((scale[good] ** 2).mean()):12.0f}{np.median(rms[good]):8.3f}" if good.any() else ""
            lines.append(f"{length:16.0f}{sigma:10.2f}{len(scale):8d}{int((~good).sum()):9d}{words}")
    return "\n".join(lines)


def pictures(table: Table) -> dict[str, str]:
    """Error of the scale against how well the length is known."""
    some = {name: [v for v, no in zip(cells, table["refused"], strict=True) if not no] for name, cells in table.items()}
    points: list[tuple[float, np.ndarray, np.ndarray]] = []
    for length in distinct(some, "length_mm"):
        part = where(some, length_mm=length)
        levels = distinct(part, "sigma_mm")
        rms = [float(np.sqrt((column(where(part, sigma_mm=s), "scale_ppm") ** 2).mean())) for s in levels]
        points.append((length, np.array(levels, dtype=float), np.array(rms)))
    chart = Chart(
        "Error of all lengths together, RMS over robots",
        logarithmic("sigma of the known length, mm", np.concatenate([p[1] for p in points])),
        logarithmic("error of the scale, 1e-6", np.concatenate([p[2] for p in points])),
        width=480,
        height=320,
    )
    shades = colour(np.linspace(0.0, 0.7, len(points)))
    for (_, sigmas, error), shade in zip(points, shades, strict=True):
        chart.line(chart.x.scaled(sigmas), chart.y.scaled(error), shade)
        chart.dots(chart.x.scaled(sigmas), chart.y.scaled(error), shade, [f"{e:.0f}e-6" for e in error])
    chart.legend([(shade, f"length of {length:.0f} mm") for (length, _, _), shade in zip(points, shades, strict=True)])
    return {"scale": picture(chart)}
