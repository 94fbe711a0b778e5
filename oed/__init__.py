"""From the model to a plan, the closed loop, and the command line.

The front, loaded when it is used:

    plan(cell, n)                  touches that tell the most about the robot, and what they promise: a PlanResult
    campaign(cell, touch=...)      touch, identify and plan by turns
    exact_design(rows, n)          the n best of many candidate rows, an ExactDesign
    approximate_design(rows)       the best weights on them, with a bound, an ApproximateDesign
    score(...), CRITERIA           what makes one set of touches better than another, a Criterion each

Its rooms, in the order in which data walks through:

    criteria    what makes one set of touches better than another
    design      designs over many candidates: best weights, and the best n touches
    candidates  the touches that can be made
    refinement  chosen touches moved continuously, and the bound over the whole manifold
    planning    plans: the touches that tell the most where it matters, in the order of making them
    campaigns   touch, identify and plan by turns
    cli         the command line
"""

from typing import TYPE_CHECKING

from identify.model import front

if TYPE_CHECKING:
    from oed.campaigns.campaign import campaign as campaign
    from oed.criteria.criteria import CRITERIA as CRITERIA
    from oed.criteria.criteria import score as score
    from oed.criteria.criterion import Criterion as Criterion
    from oed.design.exact import ExactDesign as ExactDesign
    from oed.design.exact import exact_design as exact_design
    from oed.design.relaxation import ApproximateDesign as ApproximateDesign
    from oed.design.relaxation import approximate_design as approximate_design
    from oed.planning.plan import PlanResult as PlanResult
    from oed.planning.plan import plan as plan

_FRONT = {
    "criteria.criteria": "CRITERIA score",
    "criteria.criterion": "Criterion",
    "design.relaxation": "ApproximateDesign approximate_design",
    "design.exact": "ExactDesign exact_design",
    "planning.plan": "PlanResult plan",
    "campaigns.campaign": "campaign",
}
if not TYPE_CHECKING:
    __getattr__, __dir__ = front(__name__, _FRONT)
