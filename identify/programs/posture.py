"""In which posture a nominal robot reaches the positions of a program: solutions, and those that the flags allow."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from identify.compensation.postures import nominal
from identify.compensation.trust import joint_change
from identify.model.frames import inverse, transform
from identify.model.ik import reach, within
from identify.model.kinematics import Kinematics
from identify.model.robot import Robot
from identify.programs.records import Postures

DRAWS = 24  # starts drawn for a position none of whose solutions fits its flags
SAME = 1e-4  # [rad] or [mm]
ALIGNED = 0.05  # sine of the angle within which axes count as parallel or square

Fits = Callable[[Postures], Bool[np.ndarray, " solutions"]]


@dataclass(frozen=True, eq=False)
class Choice:
    """The posture chosen for one position."""

    q: Float[np.ndarray, " joints"]  # [rad] or [mm], NaN where there is no solution at all
    fits: bool  # whether it is as the flags say
    solved: bool = True
    others: tuple[Float[np.ndarray, " joints"], ...] = ()  # that fit as well


class Chooser:
    """Finds postures of a nominal robot for poses of its tip in the jig frame."""

    def __init__(self, kinematics: Kinematics, theta: Float[np.ndarray, " parameters"], robot: Robot) -> None:
        self.kinematics, self.theta, self.robot = kinematics, theta, robot  # the robot counts as the maker does
        self.middle = (robot.lower + robot.upper) / 2
        self.elbow = elbow(kinematics, theta)

    def choose(
        self,
        T: Float[np.ndarray, "targets 4 4"],
        fits: Sequence[Fits],
        near: Float[np.ndarray, " joints"] | None,
        thorough: Sequence[bool],
    ) -> list[Choice]:
        """The solution nearest to a posture among those that fit, and the others that fit as well.

        The search begins at `near` and at its flipped wrist; where that shows no solution that fits, or where it is to
        be `thorough`, there are DRAWS more.
        """
        first, reached = nominal(self.kinematics, self.theta, T, near)
        pool = [[q] if ok else [] for q, ok in zip(first, reached, strict=True)]
        self._more(pool, T, np.flatnonzero(reached), _flipped(first[reached]))
        goal = self.middle if near is None else near
        choices = self._choices(pool, fits, goal)
        open_ = np.array([i for i, choice in enumerate(choices) if thorough[i] or not choice.fits], dtype=int)
        rng, robot = np.random.default_rng(0), self.kinematics.robot
        for _ in range(DRAWS if len(open_) else 0):
            self._more(pool, T, open_, rng.uniform(robot.lower, robot.upper, (len(open_), len(goal))))
        for i, choice in zip(
            open_, self._choices([pool[i] for i in open_], [fits[i] for i in open_], goal), strict=True
        ):
            choices[i] = choice
        return choices

    def postures(self, q: Float[np.ndarray, "solutions joints"]) -> Postures:
        """Joint values as the maker describes them."""
        front, above = (None, None) if self.elbow is None else self._sides(q)
        return Postures(self.robot.to_controller(q), front, above)

    def _more(self, pool: list[list[np.ndarray]], T: np.ndarray, which: np.ndarray, start: np.ndarray) -> None:
        """Add what is found from other starts."""
        result = reach(self.kinematics, self.theta, T[which, :3, 3], T[which, :3, :3], start)
        for i, q, ok in zip(which, result.q, result.reached(), strict=True):
            if ok and not any(np.abs(q - other).max() < SAME for other in pool[i]):
                pool[i].append(q)

    def _choices(self, pool: Sequence[list[np.ndarray]], fits: Sequence[Fits], goal: np.ndarray) -> list[Choice]:
        """For each position the nearest solution that fits, whole turns within the limits included."""
        nothing = np.empty((0, len(goal)))
        solutions = [_turns(self.kinematics.robot, np.array(joints)) if joints else nothing for joints in pool]
        postures = self.postures(np.concatenate([nothing, *solutions]))
        edges = np.cumsum([0, *map(len, solutions)])
        return [
            self._choice(q, fit(postures.take(slice(*edges[i : i + 2]))), goal)
            for i, (q, fit) in enumerate(zip(solutions, fits, strict=True))
        ]

    def _choice(
        self, q: Float[np.ndarray, "solutions joints"], fitting: Bool[np.ndarray, " solutions"], goal: np.ndarray
    ) -> Choice:
        """The nearest of the solutions that fit; else the nearest of all."""
        if not len(q):
            return Choice(np.full(len(goal), np.nan), False, False)
        robot = self.kinematics.robot
        order = np.argsort((((q - goal) / (robot.upper - robot.lower)) ** 2).sum(axis=1), kind="stable")
        allowed = q[order][fitting[order]]
        if not len(allowed):
            return Choice(q[order[0]], False)
        apart = joint_change(robot, np.broadcast_to(allowed[0], allowed.shape), allowed).max(axis=1)
        return Choice(allowed[0], True, others=tuple(allowed[apart > SAME]))

    def _sides(self, q: Float[np.ndarray, "solutions joints"]) -> tuple[np.ndarray, np.ndarray]:
        """Whether the wrist stands before axis 1, and whether it stands before the lower arm."""
        base_T_jig = inverse(transform(self.theta[:6]))
        frames = [base_T_jig[:3] @ _square(T) for T in self.kinematics.links(q, self.theta)]
        up, x = frames[0][:, :3, 2], np.array([1.0, 0.0, 0.0])  # axis 1; its sense does not matter
        up = up * np.sign(up[:, 2:])
        turned = self.robot.to_controller(q)[:, 0] * np.pi / 180 * self._sense()
        forward = _about(up, x - (up @ x)[:, None] * up, turned)
        shoulder, upper, wrist = (T[:, :, 3] for T in (frames[1], frames[2], frames[4]))
        arm, reach_ = upper - shoulder, wrist - shoulder
        front = np.einsum("ij,ij->i", wrist - frames[0][:, :, 3], forward) > 0
        along = [(np.einsum("ij,ij->i", v, up), np.einsum("ij,ij->i", v, forward)) for v in (arm, reach_)]
        return front, along[0][0] * along[1][1] - along[0][1] * along[1][0] > 0

    def _sense(self) -> float:
        """Whether the maker's axis 1 turns counter-clockwise seen from above."""
        sign = self.robot.counting.sign[0] if self.robot.counting.sign else 1
        return sign * float(np.sign(self.kinematics.robot.base_T_first[2, 2]))


def elbow(kinematics: Kinematics, theta: Float[np.ndarray, " parameters"]) -> bool | None:
    """Whether a robot is an elbow arm: axis 1 upright, 2 and 3 level and parallel, then a wrist; None where not."""
    robot = kinematics.robot
    if len(robot.joints) != 6 or any(robot.prismatic):
        return None
    middle = ((robot.lower + robot.upper) / 2)[None]
    base_T_jig = inverse(transform(theta[:6]))
    axes = [(base_T_jig[:3, :3] @ T[0, :, 2]) for T in kinematics.links(middle, theta)]
    upright = np.hypot(*axes[0][:2]) < ALIGNED
    level = abs(axes[0] @ axes[1]) < ALIGNED
    parallel = np.linalg.norm(np.cross(axes[1], axes[2])) < ALIGNED
    return True if upright and level and parallel else None


def _flipped(q: Float[np.ndarray, "solutions joints"]) -> Float[np.ndarray, "solutions joints"]:
    """Starts near the solutions whose wrist is turned over."""
    start = q.copy()
    if q.shape[1] >= 6:
        start[:, [3, 5]] -= np.pi * np.where(start[:, [3, 5]] > 0, 1, -1)
        start[:, 4] *= -1
    return start


def _turns(robot: Robot, q: Float[np.ndarray, "solutions joints"]) -> Float[np.ndarray, "more joints"]:
    """Solutions, and what whole turns of their joints make of them within the limits."""
    for j in np.flatnonzero(~np.array(robot.prismatic)):
        steps = np.array([0.0, 2 * np.pi, -2 * np.pi])[:, None, None] * np.eye(q.shape[1])[j]
        q = (q + steps).reshape(-1, q.shape[1])
        q = q[within(robot, q)]
    return q


def _square(T: Float[np.ndarray, "poses 3 4"]) -> Float[np.ndarray, "poses 4 4"]:
    return np.concatenate([T, np.tile([[[0.0, 0.0, 0.0, 1.0]]], (len(T), 1, 1))], axis=1)


def _about(
    axis: Float[np.ndarray, "rows 3"], v: Float[np.ndarray, "rows 3"], angle: Float[np.ndarray, " rows"]
) -> Float[np.ndarray, "rows 3"]:
    """Vectors square to unit axes, turned about them (Rodrigues)."""
    return v * np.cos(angle)[:, None] + np.cross(axis, v) * np.sin(angle)[:, None]
