"""Where a robot stands well before a jig: of places and heights, the one from which it reaches most; how it parks."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Float, Int

from identify.model.cell import CATALOGUE, DEG, TAUGHT_BASE, TAUGHT_TOOL, Cell, Priors, Zone
from identify.model.frames import pose, transform
from identify.model.ik import reach
from identify.model.jig import Jig
from identify.model.robot import Robot
from identify.model.zone import cone, frames

DISTANCES = (0.4, 0.5, 0.6, 0.7, 0.8)  # of the longest reach, from the middle of the jig to the base
HEIGHTS = (-0.45, -0.3, -0.15, 0.0, 0.15, 0.3)  # of the longest reach, of the base over the foot of the jig
SHARES = (0.2, 0.8)  # along both edges of a face, of the points that are to be reached
LEAN = 25 * DEG  # of the torch from the normal: a touch may lean, and seldom stands square
POSES = 60  # of the zone
STARTS = 5  # of the inverse kinematics, for each target
SAMPLES = 2000  # postures that tell how far an arm reaches
MARGIN = 50.0  # [mm] of the zone around the jig, to the sides and above
TORCH, TORCH_SHARE, TORCH_BEND = 350.0, 0.4, -18 * DEG  # [mm] out of the flange, of the reach at most; the neck's bend
STEEP = -45 * DEG  # bend of a torch that an arm of fewer than six joints cannot lean itself
TOUCHING = 1.0  # [mm] by which solids may overlap that stand on each other
STRAIGHT = 1e-6  # sine of an angle that is none
ALIKE = 0.02  # share of targets by which places are as good as each other


PARKED = 150.0  # [mm] over the highest face of the jig
PARKED_STARTS = 64  # of its inverse kinematics
TRIES = 8  # places whose touches are searched with collisions
HARDLY = 0.5  # of what is reached with the jig on the base link: a place from which less is reached is none
SOME = 2  # touches on every face, of those searched for: enough

Touchable = Callable[[Cell], Int[np.ndarray, " faces"]]  # feasible touches on each face of the jig


@dataclass(frozen=True, eq=False)
class Placement:
    """Where the base stands, and what is reached from there."""

    base: Float[np.ndarray, " 6"]  # [mm, rad], jig -> base
    share: float  # of the touches and zone poses that were tried
    tried: int  # places
    clear: bool  # whether collisions were looked at


def starting_cell(
    robot: Robot, jig: Jig, outward: Float[np.ndarray, " 3"], touches: Touchable | None = None
) -> tuple[Cell, dict[str, str]]:
    """A cell to start from: a torch along `outward` of the flange, a base from which the jig is reached, and why."""
    rng = np.random.default_rng(0)
    low, high = jig.corners.min(axis=0), jig.corners.max(axis=0)
    zone = Zone(np.stack([low - MARGIN * np.array([1, 1, 0]), high + MARGIN], axis=1))
    priors = Priors(base=TAUGHT_BASE, tool=TAUGHT_TOOL, link=CATALOGUE)
    cell = Cell(robot, jig, base=None, tool=np.zeros(6), zone=zone, priors=priors)
    length = round(min(TORCH, TORCH_SHARE * longest_reach(cell, rng)[0]), -1)
    tool = np.eye(4)
    tool[:3, :3] = _turn_to(outward)
    bend, why = (TORCH_BEND, "") if len(robot.joints) > 5 else (STEEP, ", so that it meets walls and tops alike")
    cell = replace(cell, tool=pose(tool @ transform(np.array([0.0, 0.0, length, 0.0, bend, 0.0]))))
    placement = place_base(cell, rng, touches)
    notes = {
        "base": f"Of {placement.tried} places tried, from this one the torch reaches {100 * placement.share:.0f} % of "
        f"points on the jig and in the zone{'' if placement.clear else '; collisions aside'}.",
        "tool": f"A torch of {length:.0f} mm, bent by {-bend / DEG:.0f} degrees{why}: write yours.",
        "priors": "Base and tool as the pendant teaches them: the jig as a user frame of three points, the tip by four "
        "postures.\n# With a tape measure: base_mm 10, base_deg 2, tool_mm 10, tool_deg 2. Links of an industrial arm "
        "that is built\n# by its drawing: length_mm 0.5, angle_deg 0.05 (Slamani, Nubiola, Bonev 2012).",
    }
    return replace(cell, base=placement.base), notes


def _turn_to(z: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """The smallest rotation that brings the z axis to a direction."""
    across = np.cross([0.0, 0.0, 1.0], z)
    sine, cosine = float(np.linalg.norm(across)), float(z[2])
    if sine < STRAIGHT:
        return np.diag([1.0, np.sign(cosine), np.sign(cosine)])
    x, y, w = across / sine
    K = np.array([[0.0, -w, y], [w, 0.0, -x], [-y, x, 0.0]])
    turn: Float[np.ndarray, "3 3"] = np.eye(3) + sine * K + (1 - cosine) * K @ K  # Rodrigues
    return turn.round(9)


def place_base(cell: Cell, rng: np.random.Generator, touches: Touchable | None = None) -> Placement:
    """The place from which the robot of a cell reaches most touches of its jig and poses of its zone.

    The base stands upright with its middle posture towards the jig. Places about as good come in the order of their
    distance from the middle of them, so that a base that is off by its tolerance still reaches. `touches` counts the
    feasible touches on each face, collisions included: the first place with some on every face is taken, or the best
    of TRIES.
    """
    position, R = _targets(cell, cell.the_jig, rng)
    places = _places(cell, cell.the_jig, rng)
    share = np.array([_share(replace(cell, base=base), position, R, rng) for base in places])
    if share[:-1].max() > HARDLY * share[-1]:  # the jig stands on the base link only if that is all the chain allows
        places, share = places[:-1], share[:-1]
    middle = np.mean([places[i][:3] for i in np.flatnonzero(share >= share.max() - ALIKE)], axis=0)
    apart = np.linalg.norm(np.array(places)[:, :3] - middle, axis=1)
    order = np.lexsort([apart, -np.round(share / ALIKE)]).tolist()
    best, most = order[0], (-1, -1)
    if touches is not None:
        for i in order[:TRIES]:
            number = touches(replace(cell, base=places[i]))
            if (score := (int((number > 0).sum()), int(number.min()))) > most:
                best, most = i, score
            if number.min() >= SOME:
                break
    return Placement(places[best], float(share[best]), len(places), touches is not None)


def longest_reach(cell: Cell, rng: np.random.Generator) -> tuple[float, float]:
    """How far the tip comes from the axis of the base [mm], at most, and towards which side its middle is [rad]."""
    robot = cell.robot
    q = rng.uniform(robot.lower, robot.upper, (SAMPLES, len(robot.joints)))
    theta = robot.theta(np.zeros(6), np.zeros(6) if cell.tool is None else cell.tool)
    far = np.linalg.norm(cell.kinematics.tip(q, theta)[0][:, :2], axis=1).max()
    q[:, 0] = (robot.lower[0] + robot.upper[0]) / 2
    front = cell.kinematics.tip(q, theta)[0].mean(axis=0)
    return float(far), float(np.arctan2(front[1], front[0]))


def _places(cell: Cell, jig: Jig, rng: np.random.Generator) -> list[Float[np.ndarray, " 6"]]:
    """Places behind the jig (along its y axis), turned towards it, whose foot stands in no solid of the jig.

    The last place is the base link under the jig, as of a positioner from which the chain climbs.
    """
    far, front = longest_reach(cell, rng)
    low, high = jig.corners.min(axis=0), jig.corners.max(axis=0)
    middle, foot = (low + high) / 2, _foot(cell.robot)
    quarter = np.pi / 2
    turn = quarter * ((round((-quarter - front) / quarter) + 1) % 4 - 1)
    heights = [low[2] - foot[:, 2].min(), *(low[2] + height * far for height in HEIGHTS)]  # the jig's own table first
    places = [
        np.array([*np.round([middle[0], middle[1] + distance * far, height], -1), turn, 0.0, 0.0])
        for distance in DISTANCES
        for height in heights
    ]
    upright = [place for place in places if not _stands_in(transform(place), foot, jig)] or places
    return [*upright, np.array([*middle[:2].round(), low[2], 0.0, 0.0, 0.0])]


def _foot(robot: Robot) -> Float[np.ndarray, "points 3"]:
    """Points of the link that stands still, in the frame of the base [mm]; its origin where no solid is known."""
    points = [np.zeros((1, 3))]
    for shape in (shape for shape in robot.shapes if shape.link == 0):
        if shape.kind == "mesh":
            points.append(shape.mesh[0] if shape.readable else np.empty((0, 3)))
        elif shape.kind in ("box", "cylinder", "sphere"):
            half = {"box": np.array(shape.size) / 2, "cylinder": np.array(shape.size)[[0, 0, -1]] * [1, 1, 0.5]}
            corners = np.array(list(product((-1, 1), repeat=3))) * half.get(shape.kind, np.full(3, shape.size[0]))
            points.append(corners @ shape.pose[:3, :3].T + shape.pose[:3, 3])
    for capsule in (capsule for capsule in robot.capsules if capsule.link == 0):
        ends = np.array([capsule.start, capsule.end])
        points += [ends - capsule.radius, ends + capsule.radius]
    first = robot.base_T_first
    return np.concatenate([points[0], *(p @ first[:3, :3].T + first[:3, 3] for p in points[1:])])


def _stands_in(jig_T_base: Float[np.ndarray, "4 4"], foot: Float[np.ndarray, "points 3"], jig: Jig) -> bool:
    """Whether the box around the foot overlaps a solid box of the jig."""
    points = foot @ jig_T_base[:3, :3].T + jig_T_base[:3, 3]
    low, high = points.min(axis=0) + TOUCHING, points.max(axis=0) - TOUCHING
    return any(bool((low < box.upper).all() and (high > np.array(box.lower)).all()) for box in jig.boxes)


def _targets(
    cell: Cell, jig: Jig, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "targets 3"], Float[np.ndarray, "targets 3 3"]]:
    """Tips on the faces with a leaning torch, and in the zone; the roll about the torch is drawn."""
    points, axes = [], []
    for face in jig.faces:
        s, t = (grid.ravel() for grid in np.meshgrid(SHARES, SHARES))
        points.append(face.point(s, t))
        axes.append(cone(np.tile(-face.normal, (len(s), 1)), min(LEAN, cell.touch.max_tilt), rng.random((len(s), 2))))
    if cell.zone is not None:
        box = cell.zone.box
        points.append(rng.uniform(box[:, 0], box[:, 1], (POSES, 3)))
        axes.append(cone(np.tile([0.0, 0.0, -1.0], (POSES, 1)), cell.zone.max_tilt, rng.random((POSES, 2))))
    axis = np.concatenate(axes)
    return np.concatenate(points), frames(axis, 2 * np.pi * rng.random(len(axis)))


def _share(
    cell: Cell, position: Float[np.ndarray, "targets 3"], R: Float[np.ndarray, "targets 3 3"], rng: np.random.Generator
) -> float:
    """The share of targets that are reached, from any of some starts."""
    robot, reached = cell.robot, np.zeros(len(position), dtype=bool)
    joints = len(robot.joints)
    for _ in range(STARTS):
        start = rng.uniform(robot.lower, robot.upper, (len(position), joints))
        result = reach(
            cell.kinematics, cell.theta, position, R, start, free_roll=joints >= 5, free_orientation=joints < 5
        )
        reached |= result.reached()
    return float(reached.mean())


def parked(cell: Cell) -> Float[np.ndarray, " joints"]:
    """Jogged above the jig, the torch straight down, as an operator leaves a robot; zeros where it cannot reach there.

    Of all postures the one nearest to the middle of the joint limits.
    """
    robot = cell.robot
    zeros = np.clip(np.zeros(len(robot.joints)), robot.lower, robot.upper)
    if cell.jig is None:
        return zeros
    corners = np.concatenate([[f.origin, f.origin + f.u, f.origin + f.v, f.origin + f.u + f.v] for f in cell.jig.faces])
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    over = np.array([*(lower + upper)[:2] / 2, upper[2] + PARKED])
    start = np.random.default_rng(3).uniform(robot.lower, robot.upper, (PARKED_STARTS, len(robot.joints)))
    down = np.tile(np.diag([1.0, -1.0, -1.0]), (PARKED_STARTS, 1, 1))
    result = reach(cell.kinematics, cell.theta, np.tile(over, (PARKED_STARTS, 1)), down, start, free_roll=True)
    if not result.reached().any():
        return zeros
    q = result.q[result.reached()]
    middle, half = (robot.upper + robot.lower) / 2, (robot.upper - robot.lower) / 2
    return np.asarray(q[np.argmin((((q - middle) / half) ** 2).sum(axis=1))])
