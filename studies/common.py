"""What several studies start from, computed once a process."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.io.description import library, read_cell
from identify.model.touch import Plan
from identify.model.zone import zone_poses
from oed.planning.candidate_set import CandidateSet, candidate_set
from oed.planning.plan import plan

TOUCHES = 100  # as many as the paper made
FEW = 1500  # touches on offer where a study only shows that it works


@lru_cache(maxsize=1)
def arc_welder() -> Cell:
    """The paper's robot and the stepped jig."""
    return read_cell(library("cells")["arc-welder"])


@lru_cache(maxsize=2)
def offered(structured: bool) -> CandidateSet:
    """Touches that the paper's robot can make: structured ones, or only those spread evenly."""
    return candidate_set(arc_welder(), np.random.default_rng(7), structured=structured)


@lru_cache(maxsize=1)
def touches_of_the_paper() -> Plan:
    """Touches spread evenly over the faces, as the paper's were."""
    return plan(arc_welder(), TOUCHES, strategy="even", rng=np.random.default_rng(1)).plan


@lru_cache(maxsize=2)
def zone(poses: int) -> Float[np.ndarray, "poses joints"]:
    """Poses of the weld zone where errors are measured: others than those that planning looks at."""
    return zone_poses(arc_welder(), poses=poses, rng=np.random.default_rng(2024))
