"""Touches and calibrations of many robots at once: no Python loop over robots, a few hundred microseconds each."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.identifiability import structure
from identify.model.measurement import Rows, measurement_model
from identify.model.touch import Plan
from probe.virtual.batch import search_end
from probe.virtual.contact import INTERVAL, Paths, first_contact
from probe.virtual.surfaces import surfaces

ITERATIONS = 12  # of Gauss-Newton; 3 to 6 are usual
STEP = 1e-3  # in posterior standard deviations: smaller steps change nothing
EXACT = 1e-4  # [mm] from the face
FARTHEST = 6.0  # approaches beyond which a face is not met any more by aiming again
REJECT = 4.0  # scatters of a residual beyond which a touch is left out, as the robust fit of one robot does


@dataclass(frozen=True, eq=False)
class ManyTouches:
    """The touches that many robots made of one plan."""

    q: Float[np.ndarray, "robots touches joints"]  # [rad] or [mm]
    hit: Bool[np.ndarray, "robots touches"]  # whether the planned face was met
    normal: Float[np.ndarray, "touches 3"]
    offset: Float[np.ndarray, " touches"]  # [mm]
    sigma: Float[np.ndarray, " touches"]  # [mm], of the contact along the normal


@dataclass(frozen=True, eq=False)
class ManyCalibrations:
    """What was identified of many robots."""

    theta: Float[np.ndarray, "robots parameters"]  # [mm, rad]
    scatter: Float[np.ndarray, " robots"]  # of the residuals, in units of sigma
    used: Bool[np.ndarray, "robots touches"]
    converged: Bool[np.ndarray, " robots"]


def draw_many(
    cell: Cell, robots: int, rng: np.random.Generator, scale: float = 1.0
) -> Float[np.ndarray, "robots parameters"]:
    """Robots drawn from the cell's priors times `scale` [mm, rad]; what the cell calls fixed keeps its value."""
    return cell.theta + scale * cell.spread * rng.standard_normal((robots, len(cell.theta)))


def draw_faces(cell: Cell, plan: Plan, robots: int, rng: np.random.Generator) -> Float[np.ndarray, "robots touches"]:
    """By how much the touched faces of each robot's jig stand proud of their drawing [mm], by their tolerances."""
    proud = rng.standard_normal((robots, len(cell.the_jig.faces))) * [face.tolerance for face in cell.the_jig.faces]
    names = [face.name for face in cell.the_jig.faces]
    return proud[:, [names.index(name) for name in plan.face]]


def touch_many(
    cell: Cell,
    theta: Float[np.ndarray, "robots parameters"],
    plan: Plan,
    rng: np.random.Generator,
    *,
    sigma: float | None = None,
    proud: Float[np.ndarray, "robots touches"] | None = None,
) -> ManyTouches:
    """What robots measure that are truly `theta`, when each makes the touches of a plan.

    Each touch searches along the planned way and stops at the first thing that it meets (`first_contact`). Contacts
    scatter by `sigma` [mm] along the normal (default: the cell's); faces stand `proud` of their drawing.
    """
    robots, count = len(theta), len(plan)
    end = search_end(cell, plan)
    start = np.tile(plan.approach, (robots, 1))
    paths = Paths(start, np.tile(end, (robots, 1)), np.repeat(theta, count, axis=0))
    shift = _shift(cell, (robots, count), rng, sigma, proud)
    surface = surfaces(cell.the_jig, cell.wire)
    intervals = int(np.ceil(1.25 * cell.touch.travel / INTERVAL))
    fraction, met, early = first_contact(cell.kinematics, surface, paths, shift.ravel(), intervals)
    names = np.array([*surface.names, ""])
    hit = (names[met] == np.tile(np.array(plan.face), robots)) & (fraction < 1) & ~early
    return _made(cell, plan, start + np.where(hit, fraction, 0.0)[:, None] * (paths.end - start), hit)


def touch_every(
    cell: Cell,
    theta: Float[np.ndarray, "robots parameters"],
    plan: Plan,
    rng: np.random.Generator,
    *,
    sigma: float | None = None,
    proud: Float[np.ndarray, "robots touches"] | None = None,
) -> ManyTouches:
    """What robots measure when every touch meets its face: a touch that would miss is taken to have been aimed again.

    The planned way is followed, forwards or backwards, to where the wire meets the plane of its face; a way that never
    does is a miss.
    """
    robots, count = len(theta), len(plan)
    shift = _shift(cell, (robots, count), rng, sigma, proud).ravel()
    start, way = np.tile(plan.approach, (robots, 1)), np.tile(plan.q - plan.approach, (robots, 1))
    paths = Paths(start, start + way, np.repeat(theta, count, axis=0))
    surface, rows = surfaces(cell.the_jig, cell.wire), np.arange(robots * count)
    face = np.tile([surface.names.index(name) for name in plan.face], robots)

    def gap(fraction: np.ndarray) -> np.ndarray:
        return surface.gap(*paths.tips(cell.kinematics, rows, fraction))[rows, face] - shift

    a, b = np.zeros(len(rows)), np.ones(len(rows))
    fa, fb = gap(a), gap(b)
    for _ in range(5):  # secant: the way is nearly straight, and a few steps leave nanometres
        step = np.clip(-fb * (b - a) / np.where(fb == fa, 1.0, fb - fa), -1.0, 1.0)
        a, b, fa = b, b + step, fb
        fb = gap(b)
    hit = (np.abs(fb) < EXACT) & (np.abs(b - 1) < FARTHEST)
    return _made(cell, plan, start + np.where(hit, b, 0.0)[:, None] * way, hit)


def _shift(
    cell: Cell,
    shape: tuple[int, int],
    rng: np.random.Generator,
    sigma: float | None,
    proud: Float[np.ndarray, "robots touches"] | None,
) -> Float[np.ndarray, "robots touches"]:
    """How far before its face on the drawing each contact closes [mm]."""
    shift = (cell.touch.sigma if sigma is None else sigma) * rng.standard_normal(shape)
    return shift if proud is None else shift + proud


def _made(cell: Cell, plan: Plan, q: np.ndarray, hit: np.ndarray) -> ManyTouches:
    """The table of touches whose rows stand robot by robot."""
    faces, count = [cell.the_jig.by_name[name] for name in plan.face], len(plan)
    return ManyTouches(
        q.reshape(-1, count, q.shape[1]),
        hit.reshape(-1, count),
        np.array([face.normal for face in faces]),
        np.array([face.offset for face in faces]),
        np.hypot(cell.touch.sigma, [face.tolerance for face in faces]),
    )


def errors_in_zone(
    cell: Cell,
    true: Float[np.ndarray, "robots parameters"],
    estimate: Float[np.ndarray, "robots parameters"],
    zone: Float[np.ndarray, "poses joints"],
) -> Float[np.ndarray, "robots poses"]:
    """How far the tip of each robot is from where its calibration says, at poses of the zone [mm]."""
    q = np.tile(zone, (len(true), 1))
    tips = [cell.kinematics.tip(q, np.repeat(theta, len(zone), axis=0))[0] for theta in (true, estimate)]
    return np.asarray(np.linalg.norm(tips[0] - tips[1], axis=1)).reshape(len(true), len(zone))


def calibrate_many(
    cell: Cell, touches: ManyTouches, *, priors: bool = True, eliminate: bool = True
) -> ManyCalibrations:
    """Identify every robot from its touches: least squares with the cell's priors, as `identify.calibrate` has them.

    Gauss-Newton from the nominal robot, all robots in step; touches beyond REJECT scatters are left out, and the
    scatter of what is left sets how much the priors weigh. Without `eliminate` every parameter is estimated and the
    priors tell apart what touches cannot.
    """
    problem = Problem(cell, touches, priors, eliminate)
    mask, scale = touches.hit, np.ones(len(touches.q))
    theta, converged = problem.solve(np.tile(cell.theta, (len(scale), 1)), mask, scale)
    for _ in range(2):
        agreeing = problem.agreeing(theta, touches.hit, mask)
        if np.array_equal(agreeing, mask):
            break
        mask = agreeing
        theta, converged = problem.solve(theta, mask, scale)
    for _ in range(2):
        scatter = problem.scatter(theta, mask)
        theta, converged = problem.solve(theta, mask, np.maximum(scatter, 1.0))
    return ManyCalibrations(theta, problem.scatter(theta, mask), mask, converged)


class Problem:
    """Residuals, Jacobians and normal equations of many robots that made the same touches."""

    def __init__(self, cell: Cell, touches: ManyTouches, priors: bool, eliminate: bool) -> None:
        robots, count, joints = touches.q.shape
        self.sigma = touches.sigma
        free = [i for i, name in enumerate(cell.robot.parameters) if name not in cell.fixed]
        self.model, self.kept = measurement_model(cell.robot), np.array(structure(cell).kept if eliminate else free)
        self.scale = cell.scale[self.kept]
        proper = np.isfinite(cell.prior[self.kept]) & priors
        self.precision = np.diag(np.where(proper, (self.scale / cell.prior[self.kept]) ** 2, 0.0))
        self.start = cell.theta
        wire = cell.wire
        self.rows = Rows(
            touches.q.reshape(-1, joints),
            np.tile(touches.normal, (robots, 1)),
            np.tile(touches.offset + wire.ball, robots),
            np.full(robots * count, wire.flat),
            np.tile(touches.sigma, robots),
            (),
            np.arange(robots * count),
        )

    def linearize(
        self, theta: Float[np.ndarray, "some parameters"], some: Int[np.ndarray, " some"] | None = None
    ) -> tuple[Float[np.ndarray, "some touches"], Float[np.ndarray, "some touches kept"]]:
        """Residuals and Jacobian by the whitened kept parameters of some robots, both in units of sigma."""
        count = len(self.sigma)
        rows = self.rows if some is None else self.rows.take((some[:, None] * count + np.arange(count)).ravel())
        r, J = self.model.linearize(np.repeat(theta, count, axis=0), rows)
        r, J = r.reshape(-1, count), J[:, self.kept].reshape(len(theta), count, -1)
        return r / self.sigma, J * self.scale / self.sigma[:, None]

    def solve(
        self,
        theta: Float[np.ndarray, "robots parameters"],
        inliers: Bool[np.ndarray, "robots touches"],
        scale: Float[np.ndarray, " robots"],
    ) -> tuple[Float[np.ndarray, "robots parameters"], Bool[np.ndarray, " robots"]]:
        """Gauss-Newton; robots that have arrived stand still while the others go on."""
        theta, weight = theta.copy(), inliers / scale[:, None] ** 2
        going = np.arange(len(theta))
        for _ in range(ITERATIONS):
            r, J = self.linearize(theta[going], going)
            H, weighted = self.normal(J, weight[going])
            x = (theta[going][:, self.kept] - self.start[self.kept]) / self.scale
            gradient = (weighted * r[:, :, None]).sum(axis=1) + x @ self.precision
            step = -np.linalg.solve(H, gradient[:, :, None])[:, :, 0]
            theta[np.ix_(going, self.kept)] += step * self.scale
            size = np.sqrt(np.maximum(-(step * gradient).sum(axis=1), 0.0))
            going = going[size > STEP]
            if not len(going):
                break
        converged = np.isfinite(theta).all(axis=1)
        converged[going] = False
        return theta, converged

    def normal(self, J: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The normal matrix of every robot, and its weighted Jacobian."""
        weighted = J * weight[:, :, None]
        H = weighted.transpose(0, 2, 1) @ J + self.precision
        tiny = 1e-12 * np.trace(H, axis1=1, axis2=2) / len(self.kept)  # too few touches, no priors: singular otherwise
        return H + np.maximum(tiny, 1e-12)[:, None, None] * np.eye(len(self.kept)), weighted

    def freedom(self, J: np.ndarray, inliers: np.ndarray) -> Float[np.ndarray, " robots"]:
        """Touches less the degrees of freedom that parameters take: their number, less what the priors hold."""
        freedom_of_priors = (np.linalg.inv(self.normal(J, inliers * 1.0)[0]) * self.precision).sum(axis=(1, 2))
        return np.maximum(inliers.sum(axis=1) - len(self.kept) + freedom_of_priors, 1.0)

    def scatter(
        self, theta: Float[np.ndarray, "robots parameters"], inliers: Bool[np.ndarray, "robots touches"]
    ) -> Float[np.ndarray, " robots"]:
        """Root of chi-square a degree of freedom."""
        r, J = self.linearize(theta)
        return np.asarray(np.sqrt((np.where(inliers, r, 0.0) ** 2).sum(axis=1) / self.freedom(J, inliers)))

    def agreeing(
        self,
        theta: Float[np.ndarray, "robots parameters"],
        hit: Bool[np.ndarray, "robots touches"],
        inliers: Bool[np.ndarray, "robots touches"],
    ) -> Bool[np.ndarray, "robots touches"]:
        """Touches whose residual is within REJECT robust scatters; none of a robot without an estimate or a touch."""
        r, J = self.linearize(theta)
        size, middle = np.abs(r), np.full(len(r), np.nan)
        some = (inliers & np.isfinite(size)).any(axis=1)
        middle[some] = np.nanmedian(np.where(inliers, size, np.nan)[some], axis=1)
        limit = REJECT * np.maximum(1.4826 * middle * np.sqrt(inliers.sum(axis=1) / self.freedom(J, inliers)), 1.0)
        return np.asarray(hit & (size <= limit[:, None]))


def linear_identification(
    cell: Cell, touches: ManyTouches, steps: int, *, update: bool
) -> Float[np.ndarray, "robots parameters"]:
    """Identify by linear least squares alone, as the work before the paper did (equations 50 and 55).

    One step solves for the errors at once; more repeat it with the Jacobian of the nominal robot, or with `update` with
    that of the parameters found so far. No priors, nothing left out; what diverges ends as infinity or NaN.
    """
    problem = Problem(cell, touches, False, True)
    theta = np.tile(cell.theta, (len(touches.q), 1))
    J = problem.linearize(theta)[1]
    with np.errstate(all="ignore"):
        for _ in range(steps):
            r, here = problem.linearize(theta)
            J = here if update else J
            finite = np.isfinite(r).all(axis=1) & np.isfinite(J).all(axis=(1, 2))
            change = np.full((len(theta), len(problem.kept)), np.nan)
            E, dY = J[finite] * touches.hit[finite][:, :, None], r[finite] * touches.hit[finite]
            change[finite] = -np.einsum("rkm,rm->rk", np.linalg.pinv(E), dY)
            theta[:, problem.kept] += change * problem.scale
    return theta
