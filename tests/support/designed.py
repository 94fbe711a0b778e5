"""How much 50 touches tell, chosen at random, or from a structure and then moved."""

import numpy as np

from identify.uncertainty.information import touch_sigma
from oed import exact_design
from oed.criteria.criteria import CRITERIA, score
from oed.planning.candidate_set import offer
from oed.refinement.coordinate import Refinement, refine

TOUCHES = 50


def scattered(cell, count, iterations=None):
    """D-value of the best touches among `count` random ones."""
    offered = offer(cell, np.random.default_rng(0), count=count, structured=False)
    chosen = exact_design(offered.rows, TOUCHES, prior=offered.known.precision, iterations=iterations)
    return volume(offered, offered.rows[chosen.indices])


def refined(cell, count, iterations=None):
    """D-value of the best touches among `count` structured ones, moved to where they tell more."""
    offered = offer(cell, np.random.default_rng(0), count=count)
    chosen = exact_design(offered.rows, TOUCHES, prior=offered.known.precision, iterations=iterations)
    touches = offered.found.take(chosen.indices)
    touches = refine(
        Refinement(offered.known, offered.feasibility), touches, CRITERIA["D"], together=iterations is None
    )
    return volume(offered, offered.known.rows(touches.q, touches.normal, touch_sigma(cell, touches.names())))


def volume(offered, rows):
    """D-value of touches beside what is known of the robot."""
    return float(score("D", offered.known.precision + rows.T @ rows, len(rows)))
