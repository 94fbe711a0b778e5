"""Which capsules of an arm could hit each other."""

from typing import TYPE_CHECKING

import numpy as np

from probe.motion.distances import Frames, placed, segment_segment

if TYPE_CHECKING:
    from probe.motion.clearance import Clearance

GENERIC = 300  # postures that show which capsules always overlap


def link_pairs(clearance: "Clearance") -> tuple[tuple[int, int], ...]:
    """Capsules that are not neighbours in the chain and do not overlap in most postures.

    Shapes that meet while all joints read zero are left out, too: a robot is drawn where it does not hit itself, so
    these are drawn into each other.
    """
    robot = clearance.cell.robot
    q = np.random.default_rng(2).uniform(robot.lower, robot.upper, (GENERIC, len(robot.joints)))
    q[0] = np.clip(0.0, robot.lower, robot.upper)
    frames, zero = clearance.frames(q), not q[0].any()
    links = [c.link for c in clearance.capsules]
    apart = [(i, j) for i in range(len(links)) for j in range(i) if abs(links[i] - links[j]) > 1]
    return tuple((i, j) for i, j in apart if not _always(clearance, i, j, frames, zero))


def _always(clearance: "Clearance", i: int, j: int, frames: Frames, zero: bool) -> bool:
    """Whether two overlap in most postures, or, as shapes, in the first one."""
    start, end = placed((clearance.capsules[i], clearance.capsules[j]), frames)
    gap = segment_segment(start[:, 0], end[:, 0], start[:, 1], end[:, 1]) - clearance.radius[[i, j]].sum()
    over = np.flatnonzero(gap <= 0)
    if clearance.exact is not None and clearance.shaped((i, j, None)):
        over = over[clearance.exact.near((i, j, None), frames, over, np.zeros(len(over)))]
    body = min(i, j) < len(clearance.bodies)
    return 2 * len(over) >= len(gap) or bool(body and zero and len(over) and over[0] == 0)
