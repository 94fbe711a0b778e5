"""Which jig: what is each face worth, where and how should the jig stand, and what does a second placement buy?

Setup: the paper's arc-welder and the stepped jig, 50 touches, all of it as the cell file has it unless said otherwise.
A jig is judged by the RMS tip error in the weld zone that the best 50 touches promise (criterion V of the relaxation,
which no set of touches beats), the zone staying where it is before the robot; sets marked as simulated are chosen
(exact design), made by 200 robots drawn from the priors with faces off by their tolerances, and identified. Faces: the
jig without each of its faces, and three faces (top-low, front-low, right-low) with each of the others. Placement: three
searches (10 drawn placements, then 25 steps of Nelder and Mead) over shift, turn and tilt of the jig with the plate
that it stands on. Second placement: of the 50 touches some are made after the jig was moved, to a place that is known
exactly, or that is six more unknowns (10 mm, 2 degrees).

Answer: faces that stand opposite each other, or at another height, are what counts: three faces promise 1.30 mm (no
known distance), with left-high, left-low, right-high, front-high or top-high besides 0.14 to 0.24 mm, with the others
nothing; all eleven 0.082 (the robots: 0.091). Of all, leaving out front-low costs 17 %, top-low 13 %, front-high 9 %,
top-high 7 %, right-low 6 %, top-side and right-high 3 %, left-high 2 %, left-low 1 %; the two back faces can be left
out. The jig stands well: of 108 places looked at, up to 3.6 mm, none promises more than 2.5 % less than the present
one, and robots identified with the jig there are as far off. A second place that is known exactly takes 9 to 17 % off
the error, most turned by 90 degrees and 150 mm higher (0.068 mm; the robots: 0.080 for 0.092). One whose pose is
unknown buys nothing: at most 0.8 %, the robots as far off with it as without, since the touches that find its pose are
those that would have told more. Do not move the jig, or measure where it goes.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.frames import inverse, pose, transform
from oed.design.exact import exact_design
from oed.design.relaxation import approximate_design
from oed.planning.candidate_set import CandidateSet, make_candidate_set, plan_of
from studies.common import FEW, arc_welder, zone
from studies.jigs.jig_shown import ROBOTS, TOUCHES, answer, pictures
from studies.jigs.two_places import SECOND, second_places
from studies.many import calibrate_many, draw_faces, draw_many, errors_in_zone, touch_every

__all__ = ["answer", "pictures", "run", "tasks"]

POSES = 200
SEARCHES = 48  # of an exact design
THREE = ("top-low", "front-low", "right-low")
REACH = np.array([250.0, 250.0, 150.0, np.pi, 0.7, 0.7])  # [mm, rad] of shift, turn and tilts, either way
DRAWS, STEPS, STARTS = 10, 25, 3
OUT_OF_REACH = 10.0  # [mm], for the search


def tasks(small: bool) -> list[dict[str, Any]]:
    """Faces, searches and second placements."""
    size = {"offered": FEW, "robots": 3} if small else {"offered": 5000, "robots": ROBOTS}
    places = list(SECOND)[:1] if small else list(SECOND)
    starts, steps = (1, 2) if small else (STARTS, STEPS)
    tasks: list[dict[str, Any]] = [{"part": "second", "name": name, "steps": 0, **size} for name in places]
    search = {"steps": steps} | size | {"offered": FEW if small else 1500}
    tasks += [{"part": "placement", "name": f"search {k + 1}", **search} for k in range(starts)]
    return [*tasks, {"part": "faces", "name": "", "steps": 0, **size}]


def run(rng: np.random.Generator, part: str, name: str, offered: int, robots: int, steps: int) -> list[dict[str, Any]]:
    """One row a jig: what it promises, and what robots that were identified with it deliver."""
    parts = {"faces": _faces, "placement": _placement, "second": _second}
    return [{"part": part} | _EMPTY | row for row in parts[part](rng, name, offered, robots, steps)]


_EMPTY: dict[str, Any] = {
    "name": "",
    **dict.fromkeys(("x_mm", "y_mm", "z_mm", "rz_deg", "ry_deg", "rx_deg"), 0.0),
    "promised_mm": np.nan,
    "simulated_mm": np.nan,
}


def _faces(rng: np.random.Generator, name: str, count: int, robots: int, steps: int) -> list[dict[str, Any]]:
    cell = arc_welder()
    offer = make_candidate_set(cell, rng, count=count)
    names, of = list(cell.the_jig.by_name), np.array(offer.candidates.names())
    sets = {"all faces": names} | {f"without {face}": [n for n in names if n != face] for face in names}
    sets |= {"three faces": list(THREE)}
    sets |= {f"three and {face}": [*THREE, face] for face in names if face not in THREE}
    return [_judged(offer, np.flatnonzero(np.isin(of, some)), what, robots, rng) for what, some in sets.items()]


def _judged(
    offer: CandidateSet,
    some: np.ndarray,
    name: str,
    robots: int,
    rng: np.random.Generator,
    at: np.ndarray | None = None,
) -> dict[str, Any]:
    """What some of the touches on offer promise, and what they deliver."""
    coordinates = offer.all_unknowns
    rows = offer.rows_of(offer.candidates)[some] @ coordinates.basis  # all of them meet: they are aimed
    tip, prior = coordinates.tip_rows(zone(POSES)), coordinates.precision
    relaxation = approximate_design(rows, "V", 1e-3, touches=TOUCHES, prior=prior, zone=tip)
    members = exact_design(
        rows,
        TOUCHES,
        "V",
        prior=prior,
        zone=tip,
        relaxation=relaxation,
        iterations=SEARCHES if robots == ROBOTS else 6,
        rng=rng,
    ).indices
    cell, plan = offer.cell, plan_of(offer.candidates.take(some[members]))
    theta = draw_many(cell, robots, rng)
    touched = touch_every(cell, theta, plan, rng, proud=draw_faces(cell, plan, robots, rng))
    error = errors_in_zone(cell, theta, calibrate_many(cell, touched, eliminate=False).theta, zone(POSES))
    place = {} if at is None else _said(at)
    return {"name": name, **place, "promised_mm": float(np.sqrt(relaxation.value)), "simulated_mm": _rms(error)}


def _rms(error: np.ndarray) -> float:
    """Root of the mean square over poses, in the middle of the robots [mm]."""
    return float(np.median(np.sqrt((error**2).mean(axis=1))))


def moved(cell: Cell, at: Float[np.ndarray, " 6"]) -> Cell:
    """The cell with its jig and the plate below shifted, turned and tilted about the jig's middle; the robot stays."""
    middle = np.array([200.0, 150.0, 100.0])
    jig_T_moved = transform(at)
    jig_T_moved[:3, 3] += middle - jig_T_moved[:3, :3] @ middle
    assert cell.base is not None
    return replace(cell, base=pose(inverse(jig_T_moved) @ transform(cell.base)))


def _placement(rng: np.random.Generator, name: str, count: int, robots: int, steps: int) -> list[dict[str, Any]]:
    """A search for the place: where it was looked, then the best place with robots to confirm it."""
    from scipy.optimize import minimize

    visits: list[tuple[float, np.ndarray]] = []

    def error(at: np.ndarray) -> float:
        at = np.clip(at, -1, 1) * REACH
        value = _promise(at, count)
        visits.append((value, at))
        return value if np.isfinite(value) else OUT_OF_REACH

    present = error(np.zeros(6))
    starts = rng.uniform(-1, 1, (min(DRAWS, steps), 6))
    best = starts[int(np.argmin([error(start) for start in starts]))]
    corners = np.vstack([best, best + 0.25 * np.diag(np.where(best > 0, -1.0, 1.0))])
    minimize(error, best, method="Nelder-Mead", options={"maxfev": steps, "initial_simplex": corners})
    rows = [{"name": name, **_said(at), "promised_mm": value} for value, at in visits]
    at = min((pair for pair in visits if np.isfinite(pair[0])), key=lambda pair: pair[0])[1]
    final = make_candidate_set(moved(arc_welder(), at), np.random.default_rng(1), count=2 * count)
    confirmed = _judged(final, np.arange(len(final.candidates)), "best", robots, rng, at)
    assert np.isfinite(present)
    return [*rows, confirmed]


def _promise(at: np.ndarray, count: int) -> float:
    """The RMS tip error that the jig promises from a place; NaN where the robot cannot touch it, or cannot learn."""
    try:
        offer = make_candidate_set(moved(arc_welder(), at), np.random.default_rng(0), count=count)
        coordinates = offer.all_unknowns
        tip, rows = coordinates.tip_rows(zone(POSES)), offer.rows_of(offer.candidates) @ coordinates.basis
        relaxation = approximate_design(rows, "V", 1e-3, touches=TOUCHES, prior=coordinates.precision, zone=tip)
    except (InputError, ValueError, np.linalg.LinAlgError):
        return float("nan")
    return float(np.sqrt(relaxation.value))


def _said(at: np.ndarray) -> dict[str, float]:
    names = ("x_mm", "y_mm", "z_mm", "rz_deg", "ry_deg", "rx_deg")
    return dict(zip(names, [*at[:3].tolist(), *np.degrees(at[3:]).tolist()], strict=True))


def _second(rng: np.random.Generator, name: str, count: int, robots: int, steps: int) -> list[dict[str, Any]]:
    """The first place alone, and with the second, known exactly or not."""
    searches = SEARCHES if robots == ROBOTS else 6
    return [
        {"name": case.name, **_said(case.at), "promised_mm": case.promised, "simulated_mm": _rms(case.error)}
        for case in second_places(name, count, robots, searches, zone(POSES), rng)
    ]
