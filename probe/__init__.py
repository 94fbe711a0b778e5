"""From a plan to touches, over a serial line.

In the order in which data walks through:

    line         bytes, lines and commands between driver and controller
    motion       how the arm moves without hitting anything, for planner and driver
    controllers  robot controllers by the protocol they speak
    runs         the run of a plan: touches made, judged, remembered
    virtual      a virtual robot cell behind a port
"""

from importlib import import_module
from typing import Any

_FRONT = {
    "run": "probe.runs.execution",
    "retreat": "probe.runs.execution",
    "rehearse": "probe.runs.rehearsal",
    "Session": "probe.runs.session",
    "Settings": "probe.motion.settings",
    "open_controller": "probe.controllers",
    "estimate_delay": "probe.runs.delay",
}
__all__ = ["Session", "Settings", "estimate_delay", "open_controller", "rehearse", "retreat", "run"]


def __getattr__(name: str) -> Any:
    """Load what the front page names only when it is asked for."""
    if name not in _FRONT:
        raise AttributeError(f"module 'probe' has no attribute '{name}'")
    return getattr(import_module(_FRONT[name]), name)
