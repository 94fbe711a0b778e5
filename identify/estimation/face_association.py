"""What a few touches and the tolerances tell together, while the touches alone could not determine the robot."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.estimation.problem import with_face_scatter
from identify.model.cell import Cell
from identify.model.io.calibration_file import Calibration, Errors, Residual, fingerprints, summarize
from identify.model.jig import Face, Jig
from identify.model.measurement import Rows, measurement_model, rows
from identify.model.touch import Touches
from identify.uncertainty.information import map_step

STEPS = 30  # of Gauss and Newton; six are usual
BEYOND = 5.0  # standard deviations at which a touch is on something else
DRAWS = 1000  # robots that the tolerances allow, looked at for starts
STARTS = 16
BLUR = (20.0, 8.0, 3.0, 1.0)  # [mm], how exactly touches are taken while it is being found out what they met
TURNS = 8  # of faces and parameters, for each blur
DOUBTED = 2.0  # blurs from its face at which a touch weighs a quarter
LATEST = 1.0  # [mm], the blur at which no search begins any more
ALIKE_ROBOTS = 0.1  # of every tolerance
SETTLED = 0.01  # of a tolerance, by which the parameters change no more
RARE = 6.0  # -2 log of how much rarer another face is met than the planned one
ALIKE = 0.7  # least cosine between the normals of the planned face and of one that a search from nowhere may meet
GRAZING = 0.05  # largest cosine between a search and the normal of a face that it may meet: a robot may be off
SOLID = "a box"  # what is no face: named by nothing
ROUGH = 1.0  # [mm], how exactly a box is known
REST = 2.0  # [mm], by which a contact may lie beside its face, beside three standard deviations


@dataclass(frozen=True, eq=False)
class Belief:
    """The most probable robot, how far it may be off, and the touches on the faces that they most probably met."""

    theta: Float[np.ndarray, " parameters"]  # [mm, rad]
    covariance: Float[np.ndarray, "parameters parameters"]  # [mm, rad]
    touches: Touches  # `face` is what was met, as far as can be told
    used: Bool[np.ndarray, " touches"]  # those that agree with the rest

    def as_planned(self, touches: Touches) -> Bool[np.ndarray, " touches"]:
        """Touches that agree with the rest, and met what they were meant to."""
        return self.used & np.array([a == b for a, b in zip(self.touches.face, touches.face, strict=True)], dtype=bool)


def believe(cell: Cell, touches: Touches, before: Belief | None = None) -> Belief:
    """The most probable parameters (MAP) and faces met; nothing is eliminated, only what is called fixed stays.

    A robot that is badly known may meet another face than the planned one, and the controller cannot tell. So faces are
    found together with the parameters: from many robots that the tolerances allow, by turns the nearest faces and the
    parameters, with touches taken more and more exactly; the most probable end is returned. What was believed
    `before`, of fewer touches, is where one of the searches begins.
    """
    search = _Search(cell, touches)
    starts, best = search.starts(), list[End]()
    starting = [] if before is None else [before.theta]
    for blur in BLUR:
        ends = (search.settle(theta, blur) for theta in [*starting, *(theta for theta, _ in best), *starts])
        best = search.different(ends)
        starts = search.around(best, blur) if blur > LATEST else []
    return search.belief(*search.plainest(min(best, key=lambda end: search.surprise(*end))))


End = tuple[Float[np.ndarray, " parameters"], Int[np.ndarray, " touches"]]  # parameters and faces that go together


@dataclass(eq=False)
class _Search:
    cell: Cell
    touches: Touches

    def __post_init__(self) -> None:
        faces = (*self.cell.the_jig.faces, *_sides(self.cell.the_jig))
        self.free = free(self.cell)
        self.prior = self.cell.prior[self.free]
        self.model = measurement_model(self.cell.robot)
        equations = rows(self.cell.wire, [self.touches], self.cell.robot)
        self.rows = with_face_scatter(self.cell, equations)
        self.rough = np.arange(len(faces)) >= len(self.cell.the_jig.faces)
        self.names = tuple(f.name for f in faces)
        self.normal, self.offset = np.stack([f.normal for f in faces]), np.array([f.offset for f in faces])
        self.origin, self.size = np.stack([f.origin for f in faces]), np.stack([f.size for f in faces])
        self.axes = np.stack([np.stack([f.u, f.v]) / f.size[:, None] for f in faces])
        self.planned = np.array([self.names.index(name) for name in self.touches.face])
        self.possible = self._towards() | (self.planned[:, None] == np.arange(len(faces)))

    def starts(self) -> list[Float[np.ndarray, " parameters"]]:
        """The nominal robot, and those drawn from the tolerances that fit the touches best."""
        rng = np.random.default_rng(0)
        draws = np.tile(self.cell.theta, (DRAWS, 1))
        draws[:, self.free] += self.prior * rng.standard_normal((DRAWS, len(self.prior)))
        score = np.array([np.minimum(self._misfit(theta, BLUR[0]).min(axis=1), 9.0).sum() for theta in draws])
        best = np.argsort(score)[:STARTS]
        return [self.cell.theta, *draws[best]]

    def settle(self, theta: Float[np.ndarray, " parameters"], blur: float) -> End:
        """Parameters and faces that go together where touches are taken as exactly as the blur [mm] says."""
        every, face = np.arange(len(self.planned)), self.nearest(theta, blur)
        for _ in range(TURNS):
            off = self._misfit(theta, blur)[every, face]
            before, (theta, _) = theta, self.solve(theta, face, blur * (1 + off / DOUBTED**2), steps=2)
            again = self.nearest(theta, blur)
            change = np.abs((theta - before)[self.free] / self.prior).max()
            if np.array_equal(again, face) and change < SETTLED:
                break
            face = again
        return theta, face

    def plainest(self, end: End) -> End:
        """The end with planned faces in place of others, one after the other, wherever that is more probable."""
        for i in np.flatnonzero(end[1] != self.planned):
            face = np.where(np.arange(len(self.planned)) == i, self.planned, end[1])
            theta, _ = self.solve(end[0], face, np.full(len(face), BLUR[-1]), steps=3)
            end = min(end, (theta, face), key=lambda some: self.surprise(*some))
        return end

    def different(self, ends: Iterable[End]) -> list[End]:
        """One of each that are alike."""
        distinct = list[End]()
        for theta, face in ends:
            near = (np.abs((theta - other)[self.free] / self.prior).max() < ALIKE_ROBOTS for other, _ in distinct)
            if not any(near):
                distinct.append((theta, face))
        return distinct

    def around(self, ends: Sequence[End], blur: float) -> list[Float[np.ndarray, " parameters"]]:
        """Other robots that touches taken as exactly as the blur says leave possible, drawn beside each of the ends."""
        rng, draws = np.random.default_rng(len(ends)), list[Float[np.ndarray, " parameters"]]()
        for theta, face in ends:
            C = self.solve(theta, face, np.full(len(face), blur), steps=1)[1]
            for z in rng.standard_normal((max(1, STARTS // len(ends)), len(C))):
                other = theta.copy()
                other[self.free] += self.prior * (np.linalg.cholesky(C) @ z)
                draws.append(other)
        return draws

    def surprise(self, theta: Float[np.ndarray, " parameters"], face: Int[np.ndarray, " touches"]) -> float:
        """Minus twice the logarithm of the posterior density; what is far from every face counts as an outlier."""
        off = ((theta - self.cell.theta)[self.free] / self.prior) ** 2
        misfit = self._misfit(theta, BLUR[-1])[np.arange(len(face)), face]
        return float(off.sum() + np.minimum(misfit, BEYOND**2).sum() + RARE * (face != self.planned).sum())

    def belief(self, theta: Float[np.ndarray, " parameters"], face: Int[np.ndarray, " touches"]) -> Belief:
        """The most probable parameters with touches as exact as they are, without those that do not agree."""
        sigma = np.where(self.rough[face], ROUGH, self.rows.sigma)
        agreeing = self._misfit(theta, BLUR[-1])[np.arange(len(face)), face] < BEYOND**2
        while True:
            theta, C = self.solve(theta, face, np.where(agreeing, sigma, np.inf), steps=STEPS)
            r, J = self._linearize(theta, face)
            W = J[:, self.free] * self.prior / sigma[:, None]
            variance = np.einsum("ij,jk,ik->i", W, C, W)
            away = np.where(agreeing, np.abs(r) / sigma / np.sqrt(np.clip(1 - variance, 1e-9, 1)), 0.0)
            worst = int(np.argmax(away))
            if away[worst] <= BEYOND:
                break
            agreeing[worst] = False
        covariance = np.zeros((len(theta), len(theta)))
        covariance[np.ix_(self.free, self.free)] = C * np.outer(self.prior, self.prior)
        met = replace(
            self.touches, face=tuple(self.names[i] for i in face), normal=self.normal[face], offset=self.offset[face]
        )
        return Belief(theta, covariance, met, agreeing)

    def nearest(self, theta: Float[np.ndarray, " parameters"], blur: float) -> Int[np.ndarray, " touches"]:
        """The face that every touch met most probably; the planned one where that is hardly less probable."""
        misfit = self._misfit(theta, blur)
        misfit[np.arange(len(misfit)), self.planned] -= RARE
        return np.argmin(misfit, axis=1)

    def solve(
        self,
        theta: Float[np.ndarray, " parameters"],
        face: Int[np.ndarray, " touches"],
        sigma: Float[np.ndarray, " touches"],
        steps: int,
    ) -> tuple[Float[np.ndarray, " parameters"], Float[np.ndarray, "free free"]]:
        """Most probable parameters for given faces, and the covariance of the free ones in units of their priors."""
        theta = theta.copy()
        for _ in range(steps):
            r, J = self._linearize(theta, face)
            offset = (theta - self.cell.theta)[self.free]
            step, M = map_step(r, J[:, self.free], sigma, offset, self.prior)
            theta[self.free] += self.prior * step
            if np.abs(step).max() < 1e-9:
                break
        return theta, np.linalg.inv(M)

    def _linearize(
        self, theta: Float[np.ndarray, " parameters"], face: Int[np.ndarray, " touches"]
    ) -> tuple[Float[np.ndarray, " touches"], Float[np.ndarray, "touches parameters"]]:
        offset = self.offset[face] + self.cell.wire.ball
        equations = replace(self.rows, normal=self.normal[face], offset=offset)
        return self.model.linearize(theta, equations)

    def _misfit(self, theta: Float[np.ndarray, " parameters"], blur: float) -> Float[np.ndarray, "touches faces"]:
        """Squared distances of the tip from every face, its edges considered, in units of the blur."""
        tip = self.cell.kinematics.tip(self.rows.q, theta)[0]
        high = tip @ self.normal.T - self.offset
        local = np.einsum("fai,mfi->mfa", self.axes, tip[:, None] - self.origin)
        beside = np.maximum(np.maximum(-local, local - self.size) - REST, 0.0)
        return np.where(self.possible, (high**2 + (beside**2).sum(axis=2)) / blur**2, np.inf)

    def _towards(self) -> Bool[np.ndarray, "touches faces"]:
        """Faces that the tip moves towards in a search; where it is not known, those that look like the planned one."""
        alike = self.normal[self.planned] @ self.normal.T > ALIKE
        if self.touches.approach is None:
            return alike
        start, end = (self.cell.kinematics.tip(q, self.cell.theta)[0] for q in (self.touches.approach, self.rows.q))
        way = end - start
        way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
        return np.where(np.isnan(way).any(axis=1, keepdims=True), alike, way @ self.normal.T < GRAZING)


def _sides(jig: Jig) -> list[Face]:
    """What a search may meet beside the faces: sides of solid boxes, the table among them, where no face is."""
    sides = list[Face]()
    for box in jig.boxes:
        lower, upper = np.array(box.lower), np.array(box.upper)
        for axis in range(3):
            u, v = np.roll(np.diag(upper - lower), -axis, axis=0)[1:]
            high = np.where(np.arange(3) == axis, upper, lower)
            sides += [Face(SOLID, high, u, v), Face(SOLID, lower, v, u)]
    return [side for side in sides if not any(_in_one_plane(side, face) for face in jig.faces)]


def _in_one_plane(side: Face, face: Face) -> bool:
    return bool(side.normal @ face.normal > 1 - 1e-9) and abs(side.offset - face.offset) < 1e-6


def free(cell: Cell) -> Bool[np.ndarray, " parameters"]:
    """Parameters that may differ from the cell file, by known tolerances."""
    return np.asarray(cell.spread > 0)


def provisional(cell: Cell, belief: Belief) -> Calibration:
    """A belief in the shape of a calibration, to plan touches after it; all free parameters are in it."""
    names, free_parameters = cell.robot.parameters, free(cell)
    equations: Rows = rows(cell.wire, [belief.touches], cell.robot)
    model, ids = measurement_model(cell.robot), belief.touches.ids
    before, after = (model.residual(theta, equations) for theta in (cell.theta, belief.theta))
    good = after[belief.used]
    return Calibration(
        cell=cell,
        theta=belief.theta,
        start=cell.theta,
        estimated=tuple(name for name, use in zip(names, free_parameters, strict=True) if use),
        combinations={},
        covariance=belief.covariance[np.ix_(free_parameters, free_parameters)],
        scatter=1.0,
        scatter_significant=False,
        weak=(),
        outliers={ids[i]: float(after[i]) for i in np.flatnonzero(~belief.used)},
        fit=summarize(good) if len(good) else Errors(0, 0.0, 0.0, 0.0, 0.0),
        held_out=None,
        residuals={
            name: Residual(float(was), float(now), bool(use))
            for name, was, now, use in zip(ids, before, after, belief.used, strict=True)
        },
        fingerprints=frozenset(fingerprints(equations.q, equations.offset[:, None])),
        iterations=0,
        solve_s=0.0,
    )


def as_identified(cell: Cell, calibration: Calibration) -> Cell:
    """The cell with the robot that a calibration has found, its joint errors as well; another base than its stays."""
    base = calibration.cell.base
    same = cell.base is None or (base is not None and np.array_equal(cell.base, base))
    cell = replace(cell, robot=cell.robot.with_errors(calibration.cell.robot.errors))
    moved_cell = believed(cell, calibration.theta)
    return moved_cell if same else replace(moved_cell, base=cell.base)


def believed(cell: Cell, theta: Float[np.ndarray, " parameters"]) -> Cell:
    """The cell with its robot as it is believed to be, in place of its drawing: for motions near the jig."""
    robot = cell.robot.identified(theta)
    return replace(cell, robot=robot, base=theta[:6].copy(), tool=theta[-6:].copy())
