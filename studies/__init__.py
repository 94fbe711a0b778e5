"""Questions, each answered by one script: what it asks, how, and what came out, with numbers.

Its front, loaded when used: `Study.named(name)`, `evaluate(study, folder)`, `write_results(study, table, folder)`.
Its rooms, in the order in which data walks through:

    engine          a study run: tasks on this machine or on a cluster, each finished one on disk
    cluster         tasks on a Dask cluster
    common          what several studies start from, computed once a process
    many            touches and calibrations of many robots at once
    strategies      Which strategy of choosing touches leaves the smallest tip error, and by which index?
    paper           Does the paper's procedure give the paper's figures?
    models          Why a fifth parameter, beta, where two joint axes are nearly parallel, and why not a sixth?
    observability   Does an observability index tell how accurate a calibration will be?
    touches         How many touches does a tip error in the zone ask for, and does the plan foretell it?
    simulator       robots and touches simulated by code that shares no line with what is judged
    jigs            what the study of the jig is made of
    jig             Which jig: what is each face worth, where should it stand, and what does a second placement buy?
    racers          one module a library of the race
    peers           How do SciPy, figaroh, pybotics and cvxpy do on the same problems?
    beyond          Does the choice of joint errors find what a robot has, and nothing else?
    campaign        Does touching by turns keep its promise, and does it need fewer touches than one shot?
    promise         Is the promised tip error kept, and how wide is it?
    setups          Are intervals and promises kept with several targets, two stands, a ball bar, and an arm on a track?
    kinds           What is each kind of measurement worth per minute, and what are several worth together?
    scale           When do lengths collapse, and what does one known length do?
    screenshot      a picture of a page, by a headless Chromium
    readme          studies/README.md, made from the scripts
    pages           the pages of the API, from the docstrings
    examples        short programs to start from
"""

from pathlib import Path
from typing import TYPE_CHECKING

from identify.model import front

if TYPE_CHECKING:
    from studies.engine import Study as Study
    from studies.engine import evaluate as evaluate
    from studies.engine import write_results as write_results

_FRONT = {"engine": "Study evaluate write_results"}
if not TYPE_CHECKING:
    __getattr__, __dir__ = front(__name__, _FRONT)

STUDIES = (
    "strategies",
    "paper",
    "models",
    "observability",
    "touches",
    "jig",
    "peers",
    "beyond",
    "promise",
    "campaign",
    "kinds",
    "scale",
    "setups",
)
"""Every study is a module of this package: its docstring is question, setup and answer; `tasks`, `run`, `answer` and
`pictures` make it (`studies.engine.Study`)."""

PICTURES = Path(__file__).parent / "pictures"
