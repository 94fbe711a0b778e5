"""From touches to parameters, their uncertainty, and what they change.

In the order in which data walks through:

    model         what is described: robot, joint errors, jig, touch, measurement, cell, weld zone; files in and out
    uncertainty   what is known of all unknowns, and what that promises of the tip
    estimation    from measurements to parameters
    compensation  from wanted poses to joints and command poses that bring the true tip there
    workpiece     where a workpiece stands
    health        whether a robot is still the one that was identified
    programs      robot programs corrected in place
    export        the calibrated robot for other tools
    pendant       whether the model means what the pendant shows
    report        pages and pictures of calibrations and plans
"""

from importlib import import_module
from typing import Any

_FRONT = {
    "calibrate": "identify.estimation.calibrate",
    "compensate": "identify.compensation.compensate",
    "judge": "identify.health.judge",
    "locate": "identify.workpiece.localization",
    "verify": "identify.estimation.verification",
}
__all__ = ["calibrate", "compensate", "judge", "locate", "verify"]


def __getattr__(name: str) -> Any:
    """Load what the front page names only when it is asked for: CasADi takes most of a second."""
    if name not in _FRONT:
        raise AttributeError(f"module 'identify' has no attribute '{name}'")
    return getattr(import_module(_FRONT[name]), name)
