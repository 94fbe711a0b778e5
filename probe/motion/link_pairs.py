"""Which capsules of an arm could hit each other."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int

from identify.model.joint import Capsule
from identify.model.robot import Robot
from probe.motion.distances import Frames, placed, segment_segment

GENERIC = 300  # postures that show which capsules always overlap

Rows = Int[np.ndarray, " rows"]


def link_pairs(
    robot: Robot,
    capsules: Sequence[Capsule],
    bodies: int,
    frames: Callable[[Float[np.ndarray, "postures joints"]], Frames],
    overlapping: Callable[[int, int, Frames, Rows], Rows],
) -> tuple[tuple[int, int], ...]:
    """Capsules that are not neighbours in the chain and do not overlap in most postures.

    Behind the first capsules stand `bodies`, shapes whose overlap `overlapping` knows better. Shapes that meet while
    all joints read zero are left out, too: a robot is drawn where it does not hit itself, so these are drawn into each
    other.
    """
    q = np.random.default_rng(2).uniform(robot.lower, robot.upper, (GENERIC, len(robot.joints)))
    q[0] = np.clip(0.0, robot.lower, robot.upper)
    T, zero = frames(q), not q[0].any()

    def always(i: int, j: int) -> bool:
        """Whether two overlap in most postures, or, as shapes, in the first one."""
        start, end = placed((capsules[i], capsules[j]), T)
        gap = segment_segment(start[:, 0], end[:, 0], start[:, 1], end[:, 1]) - capsules[i].radius - capsules[j].radius
        over = overlapping(i, j, T, np.flatnonzero(gap <= 0))
        return 2 * len(over) >= len(gap) or bool(min(i, j) < bodies and zero and len(over) and over[0] == 0)

    links = [c.link for c in capsules]
    apart = [(i, j) for i in range(len(links)) for j in range(i) if abs(links[i] - links[j]) > 1]
    return tuple((i, j) for i, j in apart if not always(i, j))
