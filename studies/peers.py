"""How do SciPy, figaroh, pybotics and cvxpy do on the same problems?

Setup: one run, one thread, each racer in a process of its own with a limit of processor time. Identification: the
paper's robot drawn from its tolerances, 100 positions seen by a tracker or 100 touches of planes (0.05 mm), and a real
IRB 120, 100 of its 500 measured positions; three draws each; the error is that of the tip at 300 to 400 poses that no
racer saw. Time is processor time, the least mean of nine blocks of runs after the first run, since others use the
machine; it reads no file that a racer can do without.
All minimise the same sum of squares with the same tolerances as priors, where they can: SciPy by `trf` and `lm` with
parameters scaled by their tolerances and equations written in NumPy for all touches at once; figaroh as its
documentation advises where tolerances are known (`map`), and by default (`structural`); pybotics as in its example.
Selection: 50 of 500 and of 4,000 touches of oed20k; D-efficiency is against the bound of the relaxation over the same
candidates. figaroh and cvxpy give weights, of which the 50 largest are taken; figaroh has an exchange (Detmax) too,
and is asked for 500 alone: its cone program takes 1.7 GB there, and in proportion to the candidates.
The peers: `pip install --group peers`, here or in an environment named by TOUCHCAL_PEERS_PYTHON; what is not installed
is reported as such.

Answer: all that estimate with the tolerances end at the same unseen error; without them it is 1.2 times as large on the
real robot, and millimetres on the simulated one, where the zone is small (figaroh structural 3.7 mm, pybotics 5.4 mm
against 0.027 mm). One fit of ours takes 7.6 ms of positions, 5.7 ms of the IRB 120's and 7.2 ms of touches on a machine
that five others used, 6.6, 9 and 14 times as fast as SciPy, the fastest peer (50, 51 and 99 ms); on a quiet one it was
3.9, 5.8 and 4.3 ms, 18, 11 and 42 times, and 470 times as fast as figaroh `map` (1.9 and 2.7 s). What follows is of the
quiet one.
On the IRB 120 ours finds by itself where tracker and reflector are and which parameters the positions determine, which
the others are told or leave to the tolerances, and that is a third of its time. `calibrate`, which also leaves outliers
out, weighs the tolerances by the scatter and looks for faults, takes 8.0, 20 and 8.0 ms: 9, 3.2 and 23 times as fast
as one fit of SciPy, and on the IRB 120, where it fits four times, better (0.170 mm mean against 0.191). SciPy with our
compiled equations takes 3.4 to 4.0 ms, so the gain is in the equations: Ipopt costs 0.3 ms to start and 0.4 ms an
iteration. In batches of 200 robots, a calibration from touches takes 2.7 ms: 66 times as fast.

50 of 500 touches: `exact_design` takes 0.07 s for a D-efficiency of 0.966, with 480 searches 0.83 s for the same; cvxpy
with Clarabel 2.3 s (0.948), figaroh's Detmax 12 s (0.955), its cone program 18 s and 1.6 GB (0.948). 50 of 4,000:
0.37 s (0.960), with 480 searches 1.1 s (0.961), against 18 s (0.889), 0.11 GB against 0.42. That is 31 and 48 times as
fast as the fastest peer, and better each time. (All 20,000 cost cvxpy 103 s and 1.3 GB, asked once, apart.)
"""

from typing import Any

import numpy as np

from identify.report.svg import AFTER, BEFORE, OUT, Chart, logarithmic, named, picture
from oed.design.relaxation import approximate_design
from studies.engine import Table, column, distinct, where
from studies.racers.peers_problems import QUESTIONS, candidates
from studies.racers.racing import race

ALONE = True  # one task at a time, in this process: clocks are read
MEASURED = ("cpu_s", "first_s", "peak_mb", "runs", "result")
DRAWS, MEASUREMENTS, TOUCHES = 3, 100, 50
POSITIONS = (("with_figaroh", "figaroh map"), ("with_figaroh", "figaroh structural"), ("with_pybotics", "pybotics"))
ANY = (
    ("with_touchcal", "touchcal calibrate"),
    ("with_touchcal", "touchcal one fit"),
    ("with_scipy", "SciPy trf"),
    ("with_scipy", "SciPy lm"),
    ("with_touchcal", "SciPy our Jacobian"),
)
IDENTIFY = {
    "tracker": (*ANY, *POSITIONS),
    "irb120": (*ANY, *POSITIONS),
    "touches": (*ANY, ("with_touchcal", "touchcal batch")),
}
LARGE = (
    ("with_touchcal", "touchcal exact_design"),
    ("with_touchcal", "touchcal 480 searches"),
    ("with_cvxpy", "cvxpy Clarabel"),
)
SELECT = {"oed500": (*LARGE, ("with_figaroh", "figaroh SOCP"), ("with_figaroh", "figaroh Detmax")), "oed4k": LARGE}
RACERS = IDENTIFY | SELECT
COLOURS = {"tracker": AFTER, "irb120": OUT, "touches": BEFORE, "oed500": AFTER, "oed4k": OUT}
WORDS = {
    "tracker": "simulated, tracker",
    "irb120": "IRB 120, measured",
    "touches": "simulated, touches",
    "oed500": "50 of 500 touches",
    "oed4k": "50 of 4,000 touches",
}


def tasks(small: bool) -> list[dict[str, Any]]:
    """One problem a task, all racers on it."""
    if small:
        return [
            {"data": "oed500", "draw": 0, "size": 500, "seconds": 6},
            {"data": "tracker", "draw": 0, "size": 40, "seconds": 6},
        ]
    rows = [
        {"data": data, "draw": draw, "size": MEASUREMENTS, "seconds": 60} for data in QUESTIONS for draw in range(DRAWS)
    ]
    return [
        *rows,
        {"data": "oed500", "draw": 0, "size": 500, "seconds": 150},
        {"data": "oed4k", "draw": 0, "size": 4000, "seconds": 90},
    ]


def run(rng: np.random.Generator, data: str, draw: int, size: int, seconds: float) -> list[dict[str, Any]]:
    """One row a racer: what it took and how good it was."""
    try:
        rows = _identified(rng, data, size, seconds) if data in IDENTIFY else _selected(rng, data, size, seconds)
    except FileNotFoundError as error:
        rows = [{"result": f"{error.filename} is not there"} for _ in RACERS[data]]
    return [
        {"data": data, "draw": draw, "method": method, **_row(row)}
        for (_, method), row in zip(RACERS[data], rows, strict=True)
    ]


def _row(answer: dict[str, Any]) -> dict[str, Any]:
    numbers = ("cpu_s", "first_s", "runs", "peak_mb", "mean_mm", "max_mm", "efficiency", "weights_efficiency")
    return {name: float(answer.get(name, np.nan)) for name in numbers} | {"result": answer.get("result", "done")}


def _identified(rng: np.random.Generator, data: str, size: int, seconds: float) -> list[dict[str, Any]]:
    question = QUESTIONS[data](rng, size)
    rows = []
    for racer, method in IDENTIFY[data]:
        answer = race(racer, method, question.told, seconds)
        if "tip" in answer:
            error = np.linalg.norm(answer["tip"] - question.hidden, axis=1)
            answer |= {"mean_mm": error.mean(), "max_mm": error.max()}
        rows.append(answer)
    return rows


def _selected(rng: np.random.Generator, data: str, size: int, seconds: float) -> list[dict[str, Any]]:
    X = candidates(size, rng)
    best = _phi(X, approximate_design(X).weights)
    rows = []
    for racer, method in SELECT[data]:
        answer = race(racer, method, {"rows": X, "n": np.array(TOUCHES)}, seconds)
        if "indices" in answer:
            design = np.bincount(answer["indices"], minlength=len(X)) / TOUCHES
            answer |= {"efficiency": _phi(X, design) / best}
        if "weights" in answer:
            weights = np.maximum(answer["weights"], 0.0)
            answer |= {"weights_efficiency": _phi(X, weights / weights.sum()) / best}
        rows.append(answer)
    return rows


def _phi(X: np.ndarray, weights: np.ndarray) -> float:
    """The D-criterion: root of the determinant of the information of one touch, on average."""
    return float(np.exp(np.linalg.slogdet((X.T * weights) @ X)[1] / X.shape[1]))


def middle(table: Table, data: str, method: str, name: str) -> float:
    """The median over draws; NaN where a racer did not arrive each time."""
    cells = column(where(table, data=data, method=method), name)
    return float(np.median(cells)) if len(cells) else float("nan")


def answer(table: Table) -> str:
    """Every racer on every problem, and the ratios to the fastest peer that is as good."""
    lines = []
    for data in distinct(table, "data"):
        lines.append(f"{WORDS[data]}:")
        methods = distinct(where(table, data=data), "method")
        lines += [f"  {method}: {_said(table, data, method)}" for method in methods]
        lines += [f"  {text}" for text in ratios(table, data)]
    return "\n".join(lines)


def _said(table: Table, data: str, method: str) -> str:
    time = middle(table, data, method, "cpu_s")
    if np.isnan(time):
        reasons = [r for r in where(table, data=data, method=method)["result"] if r != "done"]
        return f"no answer ({reasons[0]})"
    label = f"{1e3 * time:.3g} ms, {middle(table, data, method, 'peak_mb'):.0f} MB"
    if data in IDENTIFY:
        error = middle(table, data, method, "mean_mm"), middle(table, data, method, "max_mm")
        return f"{label}, unseen error {error[0]:.4f} mm mean, {error[1]:.3f} mm max"
    weights = middle(table, data, method, "weights_efficiency")
    of_weights = "" if np.isnan(weights) else f" (weights {weights:.7f})"
    return f"{label}, D-efficiency {middle(table, data, method, 'efficiency'):.4f}{of_weights}"


def ratios(table: Table, data: str) -> list[str]:
    """How many times faster ours are than the fastest peer; its error, or its efficiency, beside ours."""
    quality = "mean_mm" if data in IDENTIFY else "efficiency"
    methods = distinct(where(table, data=data), "method")
    speed = {m: middle(table, data, m, "cpu_s") for m in methods}
    there = [m for m in methods if np.isfinite(speed[m])]
    ours = [m for m in there if m.startswith("touchcal")]
    peers = [m for m in there if not m.startswith("touchcal") and m != "SciPy our Jacobian"]
    if not peers:
        return []
    best = min(peers, key=speed.__getitem__)
    return [
        f"{mine} is {speed[best] / speed[mine]:.3g} times as fast as {best}, the fastest peer "
        f"({middle(table, data, mine, quality):.4f} against {middle(table, data, best, quality):.4f})"
        for mine in ours
    ]


def pictures(table: Table) -> dict[str, str]:
    """Time and quality of every racer."""
    return {
        "peers-identification-time": _chart(table, True, "cpu_s", "processor time of one identification, s"),
        "peers-identification-error": _chart(table, True, "mean_mm", "mean tip error at unseen poses, mm"),
        "peers-selection-time": _chart(table, False, "cpu_s", "processor time of one selection, s"),
        "peers-selection-loss": _chart(table, False, "loss", "D-efficiency missing to the bound, %"),
    }


def _chart(table: Table, identify: bool, name: str, title: str) -> str:
    names = [data for data in distinct(table, "data") if (data in IDENTIFY) == identify]
    methods = list(dict.fromkeys(m for data in names for m in distinct(where(table, data=data), "method")))
    value = {
        (data, m): 100 * (1 - middle(table, data, m, "efficiency")) if name == "loss" else middle(table, data, m, name)
        for data in names
        for m in methods
    }
    about = "Identification from 100 measurements" if identify else "Choosing 50 touches"
    chart = Chart(f"{about}: {title}", named("", methods), logarithmic(title, list(value.values())), slanted=True)
    for k, data in enumerate(names):
        points = [(i, value[data, m]) for i, m in enumerate(methods) if np.isfinite(value[data, m])]
        x, y = (np.array(part, dtype=float) for part in zip(*points, strict=True)) if points else (np.empty(0),) * 2
        hints = [f"{methods[int(i)]}, {WORDS[data]}: {v:.4g}" for i, v in zip(x, y, strict=True)]
        chart.dots(x + 0.16 * (k - (len(names) - 1) / 2), chart.y.scaled(y), COLOURS[data], hints, 4)
    chart.legend([(COLOURS[data], WORDS[data]) for data in names])
    return picture(chart)
