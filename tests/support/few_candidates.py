"""A few touches that the arc-welder can make: enough for claims that need some."""

from functools import cache

import numpy as np

from identify.model.io.description import library, read_cell
from oed.planning.candidate_set import CandidateSet, make_candidate_set


@cache
def few(count: int = 300) -> CandidateSet:
    """Candidates of the library's cell, made once a process."""
    return make_candidate_set(read_cell(library("cells")["arc-welder"]), np.random.default_rng(4), count=count)
