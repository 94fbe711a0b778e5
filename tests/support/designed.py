"""How much 50 touches tell, chosen at random, or from a structure and then moved."""

import numpy as np

from oed import exact_design
from oed.criteria.criteria import CRITERIA, score
from oed.planning.candidate_set import make_candidate_set
from oed.refinement.coordinate import Refinement, refine

TOUCHES = 50


def scattered(cell, count, iterations=None):
    """D-value of the best touches among `count` random ones."""
    offered = make_candidate_set(cell, np.random.default_rng(0), count=count, structured=False)
    rows = offered.rows @ offered.identifiable.basis
    chosen = exact_design(rows, TOUCHES, prior=offered.identifiable.precision, iterations=iterations)
    return volume(offered, rows[chosen.indices])


def refined(cell, count, iterations=None):
    """D-value of the best touches among `count` structured ones, moved to where they tell more."""
    offered = make_candidate_set(cell, np.random.default_rng(0), count=count)
    rows = offered.rows @ offered.identifiable.basis
    chosen = exact_design(rows, TOUCHES, prior=offered.identifiable.precision, iterations=iterations)
    touches = offered.candidates.take(chosen.indices)
    touches = refine(Refinement(offered.identifiable, offered.feasibility), touches, CRITERIA["D"])
    return volume(offered, offered.identifiable.rows(touches.rows(cell)))


def volume(offered, rows):
    """D-value of touches beside what is known of the robot."""
    return float(score("D", offered.identifiable.information(rows), len(rows)))
