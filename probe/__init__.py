"""From a plan to touches, over a serial line.

The front, loaded when it is used:

    open_controller(port, protocol, robot)   the controller of a robot
    Session(path, cell, plan), Settings      the table of touches and its journal; speeds, waits, limits
    rehearse, run, retreat                   a dry run, the touches, the way out of contact
    estimate_delay(results, cell)            how late touches come
    touch_batch(cell, truth, plan, rng)      touches of a hidden robot (draw_truth, a Truth), without a port

Its rooms, in the order in which data walks through:

    line         bytes, lines and commands between driver and controller
    motion       how the arm moves without hitting anything, for planner and driver
    controllers  robot controllers by the protocol they speak
    runs         the run of a plan: touches made, judged, remembered
    programs     the touches of a plan in a controller's own language, and what it logs
    virtual      a virtual robot cell behind a port
"""

from typing import TYPE_CHECKING

from identify.model import front

if TYPE_CHECKING:
    from probe.controllers import open_controller as open_controller
    from probe.motion.settings import Settings as Settings
    from probe.runs.delay import estimate_delay as estimate_delay
    from probe.runs.execution import retreat as retreat
    from probe.runs.execution import run as run
    from probe.runs.rehearsal import rehearse as rehearse
    from probe.runs.session import Session as Session
    from probe.virtual.batch import touch_batch as touch_batch
    from probe.virtual.truth import Truth as Truth
    from probe.virtual.truth import draw_truth as draw_truth

_FRONT = {
    "motion.settings": "Settings",
    "controllers": "open_controller",
    "runs.rehearsal": "rehearse",
    "runs.session": "Session",
    "runs.execution": "retreat run",
    "runs.delay": "estimate_delay",
    "virtual.batch": "touch_batch",
    "virtual.truth": "Truth draw_truth",
}
if not TYPE_CHECKING:
    __getattr__, __dir__ = front(__name__, _FRONT)
