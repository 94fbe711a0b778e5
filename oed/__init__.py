"""From the model to a plan, the closed loop, and the command line.

In the order in which data walks through:

    criteria    what makes one set of touches better than another
    design      designs over many candidates: best weights, and the best n touches
    candidates  the touches that can be made
    refinement  chosen touches moved continuously, and the bound over the whole manifold
    planning    plans: the touches that tell the most where it matters, in the order of making them
    campaigns   touch, identify and plan by turns
    cli         the command line
"""

from importlib import import_module
from typing import Any

_FRONT = {
    "approximate_design": "oed.design.relaxation",
    "exact_design": "oed.design.exact",
    "plan": "oed.planning.plan",
}
__all__ = ["approximate_design", "exact_design", "plan"]


def __getattr__(name: str) -> Any:
    """Load what the front page names only when it is asked for: the command line must answer at once."""
    if name not in _FRONT:
        raise AttributeError(f"module 'oed' has no attribute '{name}'")
    return getattr(import_module(_FRONT[name]), name)
