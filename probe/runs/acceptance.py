"""When a touch counts (DESIGN.md, section 6): every rule, and the sentence where it is broken."""

import numpy as np

from probe.line.controller import Contact
from probe.motion.joint_path import Geometry
from probe.runs.records import Intent


def objection(contact: Contact, search: Intent, geometry: Geometry) -> str:
    """Why a contact does not count as the outcome of a search, or nothing.

    That the input was open before and after, and closed where the robot came to rest, is seen by asking for it.
    """
    settings = geometry.settings
    if contact.boot != search.boot:
        return f"the latch is of another start of the controller ({contact.boot}, expected {search.boot})"
    if contact.sequence != search.sequence:
        return f"the latch is of command {contact.sequence}, expected {search.sequence}"
    at, off = geometry.fraction(contact.q, search.start, search.end)
    if not 0 < at < 1:
        return f"the latched joints lie at {at:.4f} of the search, expected between 0 and 1"
    if off > settings.off_line:
        return f"the latched joints lie {np.degrees(off):.4f} deg off the line of search"
    ran = geometry.span(contact.q, contact.stop) / search.rate  # [s]
    if ran > settings.stop_time:
        return f"the robot ran {ran:.2f} s past the latch, expected at most {settings.stop_time:g} s"
    rested, off = geometry.fraction(contact.stop, search.start, search.end)
    if rested < at - settings.off_line / geometry.span(search.start, search.end) or off > settings.arrived:
        return "the robot did not come to rest on the line of search behind the latch"
    return ""
