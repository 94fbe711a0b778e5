"""When a touch counts (DESIGN.md, section 6): every rule, and the sentence where it is broken.

The same rules hold for a live touch and for one that an earlier run has left in the journal. `objection` judges what is
known while the robot rests on the contact, `unconfirmed` what is known once it has retracted.
"""

from collections.abc import Mapping

import numpy as np

from probe.line.controller import Contact
from probe.motion.joint_path import Geometry
from probe.runs.records import APPROACH, CONTACT, RETRACTED, Intent, Observation

Evidence = Mapping[str, Observation]  # by place


def objection(contact: Contact, search: Intent, evidence: Evidence, geometry: Geometry) -> str:
    """Why a contact does not count as the outcome of a search, or nothing."""
    settings = geometry.settings
    if contact.boot != search.boot:
        return f"the latch is of another start of the controller ({contact.boot}, expected {search.boot})"
    if contact.sequence != search.sequence:
        return f"the latch is of command {contact.sequence}, expected {search.sequence}"
    if reason := _not_begun(evidence.get(APPROACH), search, geometry):
        return reason
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
    return _not_closed(evidence.get(CONTACT), contact, geometry)


def unconfirmed(evidence: Evidence, search: Intent) -> str:
    """Why a contact does not count after the retract, or nothing."""
    after = evidence.get(RETRACTED)
    if after is None:
        return "nothing shows that the input opened when the wire left the face"
    if after.closed or after.boot != search.boot:
        return "the touch input was still closed after the retract"
    return ""


def _not_begun(before: Observation | None, search: Intent, geometry: Geometry) -> str:
    """Why a search did not begin as it must, or nothing."""
    if before is None or before.boot != search.boot:
        return "nothing shows that the robot stood at the approach before the search"
    if geometry.span(before.q, search.start) > geometry.settings.arrived:
        return "the robot did not stand at the approach before the search"
    return "the touch input was closed before the search" if before.closed else ""


def _not_closed(resting: Observation | None, contact: Contact, geometry: Geometry) -> str:
    """Why the contact was none when the robot stood on it, or nothing."""
    if resting is None or not resting.closed or resting.boot != contact.boot:
        return "the contact did not last until the robot stood still"
    if geometry.span(resting.q, contact.stop) > geometry.settings.arrived:
        return "the robot did not stay where the search ended"
    return ""
