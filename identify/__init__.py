"""From touches to parameters, their uncertainty, and what they change."""

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
