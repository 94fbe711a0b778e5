"""The problems of `studies.peers`: robots measured, simulated and real, and touches to choose from."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identify.estimation.initial_guess import starting_point
from identify.model.cell import Cell, Wire
from identify.model.io.description import library, read_robot
from identify.model.measurement import Rows, measurement_model, rows
from identify.model.touch import Positions
from identify.model.zone import zone_poses
from studies.common import arc_welder
from studies.many import draw_many

DATA = "TOUCHCAL_DATA"
UNSEEN = 300
SIGMA, REPEATABILITY = 0.05, 0.1  # [mm] of a simulated measurement, and of the IRB 120


@dataclass(frozen=True, eq=False)
class Question:
    """What a racer is told, and the tips at the unseen poses that it is not told."""

    told: Mapping[str, np.ndarray]
    hidden: Float[np.ndarray, "unseen 3"]  # [mm]


def folder(name: str) -> Path:
    """Where measured data lie: beside the repository, or where TOUCHCAL_DATA says."""
    return Path(os.environ.get(DATA) or Path(__file__).parents[2] / "shared" / "data") / name


def tracker(rng: np.random.Generator, count: int) -> Question:
    """The paper's robot, off by its tolerances, seen by a tracker at poses of the weld zone."""
    cell = replace(arc_welder(), wire=Wire(0.0, "point"))
    truth, q = _robot(cell, count, rng)
    tip = cell.kinematics.tip(q, truth)[0]
    point = tip[:count] + SIGMA * rng.standard_normal((count, 3))
    return Question(_told(cell, cell.theta, q, count, SIGMA) | {"point": point}, tip[count:])


def touches(rng: np.random.Generator, count: int) -> Question:
    """The same robot touching planes across x, y and z in turn with its wire."""
    cell = arc_welder()
    truth, q = _robot(cell, count, rng)
    normal, radius = np.eye(3)[np.arange(count) % 3], np.full(count, cell.wire.radius)
    blank = Rows(q[:count], normal, np.zeros(count), radius, np.full(count, SIGMA), (), np.arange(count))
    offset = measurement_model(cell.robot).residual(truth, blank) + SIGMA * rng.standard_normal(count)
    numbers = _told(cell, cell.theta, q, count, SIGMA) | {"normal": normal, "offset": offset, "radius": radius}
    return Question(numbers, cell.kinematics.tip(q[count:], truth)[0])


def irb120(rng: np.random.Generator, count: int) -> Question:
    """The real IRB 120 at drawn poses, the others unseen; nobody knows where tracker and reflector are.

    All are told the base and the tool point that a linear fit of the nominal robot finds. Raises FileNotFoundError
    where the measurements are not there.
    """
    columns = np.genfromtxt(folder("irb120") / "positions.csv", delimiter=",", names=True)
    order = rng.permutation(len(columns))
    q = np.radians(np.column_stack([columns[f"q{i}_deg"] for i in range(1, 7)])[order])
    point = np.column_stack([columns[name] for name in ("x_mm", "y_mm", "z_mm")])[order]
    cell = Cell(read_robot(library("robots")["irb120"]), None, base=None, tool=None, wire=Wire(0.0, "point"))
    ids = tuple(map(str, range(count)))
    positions = Positions(ids, q[:count], point[:count], np.full(count, REPEATABILITY))
    start = starting_point(cell, rows(cell.wire, [positions]))
    return Question(_told(cell, start, q, count, REPEATABILITY) | {"point": positions.point}, point[count:])


QUESTIONS = {"tracker": tracker, "irb120": irb120, "touches": touches}


def _robot(cell: Cell, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A robot drawn from the tolerances, and poses of the zone: measured ones, then unseen ones."""
    return draw_many(cell, 1, rng)[0], zone_poses(cell, poses=count + UNSEEN, rng=rng)


def _told(cell: Cell, start: np.ndarray, q: np.ndarray, count: int, sigma: float) -> dict[str, np.ndarray]:
    return {
        "base": start[:6],
        "dh": start[6:-6].reshape(-1, 5),
        "tool": start[-6:],
        "prior": cell.prior,
        "scale": cell.scale,
        "sigma": np.array(sigma),
        "q": q[:count],
        "q_unseen": q[count:],
    }


def candidates(count: int, rng: np.random.Generator) -> Float[np.ndarray, "candidates parameters"]:
    """Touches drawn from oed20k, whitened; raises FileNotFoundError where it is not there."""
    with np.load(folder("oed20k") / "candidates.npz") as file:
        X = file["rows"]
    return np.asarray(X if count >= len(X) else X[rng.choice(len(X), count, replace=False)])
