"""The touches that could be made: contact points on faces, wire and turn, joint values of contact and of approach."""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.ik import reach
from identify.model.jig import Face
from identify.model.measurement import Rows, touch_conditions
from oed.candidates.edge_margins import EDGE, SHARE, Margins, margins, warnings
from oed.candidates.feasibility import Feasibility, Infeasibility, unreached
from oed.candidates.hits import Hits
from oed.candidates.ik_branches import Branches, Poses
from oed.candidates.targets import Targets, spread, structured
from probe.motion.bodies import notes as notes_on_bodies
from probe.motion.clearance import MARGIN

COUNT = 30_000
ROUND = (3_000, 16_000)  # targets asked for at a time, at the least and at the most
STRUCTURED = 0.9  # of them; the others are spread evenly
ROUNDS = 8  # at the most, or as many as give three times the targets for what is asked
RARE = 1e-3  # share of robots that meet a touch, below which it counts as so rare
SURELY = 4  # power of that share by which a touch counts: rather a sure touch than a telling one that many miss
EXPLORED = 0.2  # of as many contacts, that show first what can be reached, and how uncertain the tip is there


@dataclass(frozen=True, eq=False)
class Candidates:
    """Feasible touches, columns of equal length; `faces` are the faces of the jig that `face` counts through."""

    faces: tuple[Face, ...]
    face: Int[np.ndarray, " touches"]  # index into `faces`
    point: Float[np.ndarray, "touches 3"]  # [mm], below the middle of the wire's end, in the plane of the face
    normal: Float[np.ndarray, "touches 3"]  # outward
    tilt: Float[np.ndarray, " touches"]  # [rad], between the wire and the normal
    q: Float[np.ndarray, "touches joints"]  # [rad] or [mm], at contact
    approach: Float[np.ndarray, "touches joints"]  # [rad] or [mm]
    hit: Float[np.ndarray, " touches"]  # share of the robots that may be off whose search meets its face
    margins: Margins  # kept by all of them
    hits: Hits  # by which `hit` was found
    notes: tuple[str, ...] = ()  # sentences: faces that are not reached and why, faces that may be missed

    def __len__(self) -> int:
        return len(self.face)

    def take(self, index: Int[np.ndarray, " some"] | Bool[np.ndarray, " touches"]) -> "Candidates":
        """Some of the candidates, in the order of the index."""
        return replace(self, **{name: getattr(self, name)[index] for name in COLUMNS})

    def followed_by(self, others: "Candidates") -> "Candidates":
        """These candidates and others."""
        columns: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(others, name)]) for name in COLUMNS
        }
        return replace(self, **columns)

    @cached_property
    def number(self) -> Int[np.ndarray, " faces"]:
        """How many there are on each face."""
        return np.bincount(self.face, minlength=len(self.faces))

    def names(self) -> tuple[str, ...]:
        """The name of the face of every touch."""
        return tuple(self.faces[i].name for i in self.face)

    def expected_rows(self, cell: Cell, power: float | None = None) -> Rows:
        """The equations with standard deviations by which a touch counts as much as it is worth planning.

        A touch that a share p of the robots meets tells p f f' on average; it counts p^SURELY f f', since a miss costs
        time, and misses of one robot come together. Another `power` is for robots of which each misses its own.
        """
        rows = self.rows(cell)
        power = SURELY if power is None else power
        return replace(rows, sigma=rows.sigma * np.maximum(self.hit, RARE) ** (-power / 2))

    def rows(self, cell: Cell) -> Rows:
        """The equations that these touches will give."""
        wire, m = cell.wire, len(self)
        offset = np.array([face.offset for face in self.faces])[self.face]
        return Rows(
            self.q,
            self.normal,
            offset + wire.ball,
            np.full(m, wire.flat),
            np.full(m, cell.touch.sigma),
            tuple(map(str, range(m))),
            np.arange(m),
            touch_conditions(self.q, self.approach),
            self.names(),
        )


COLUMNS = tuple(f.name for f in fields(Candidates) if f.name not in ("faces", "margins", "hits", "notes"))


def candidates(
    cell: Cell,
    rng: np.random.Generator,
    count: int = COUNT,
    *,
    theta: Float[np.ndarray, " parameters"] | None = None,
    root: Float[np.ndarray, "parameters directions"] | None = None,
    share: float = SHARE,
    margin: float = MARGIN,
    structured: float = STRUCTURED,
) -> Candidates:
    """Feasible touches of the jig, the surest of `count`; raises InputError where there are none.

    `theta` and root root', a covariance, are what is known of the robot, its nominal parameters and priors if not
    given: they place the touches, and keep them off the edges (see `margins`). `margin` is the clearance of arm and
    torch [mm]; `structured` is the share that is asked for on corners and edges, the others are spread evenly.
    """
    _require(cell)
    theta = cell.theta if theta is None else theta
    root = np.diag(cell.prior) if root is None else root
    size = int(np.clip(2 * count, *ROUND))
    search = _Search(cell, theta, root, share, margin, structured, int(EXPLORED * size), rng)
    rounds: list[Candidates] = []
    for _ in range(max(ROUNDS, 3 * count // size)):
        rounds.append(search.round(size))
        if sum(map(len, rounds)) >= count or not len(rounds[0]):
            break
    columns: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in rounds]) for name in COLUMNS}
    every = Candidates(search.faces, **columns, margins=search.feasibility.margins, hits=search.hits)
    feasibility = search.feasibility
    missing = unreached(feasibility, search.tally)
    if not len(every):
        raise InputError("no touch can be made. " + " ".join(missing))
    notes = (*missing, *warnings(cell, feasibility.margins, every.number > 0), *notes_on_bodies(cell.robot))
    hits = search.hits.requiring(every.face, every.hit)
    sure = np.flatnonzero(hits.sure(every.face, every.hit))
    some = rng.choice(sure, min(count, len(sure)), replace=False)
    return replace(every.take(np.sort(some)), notes=notes, hits=hits)


def _require(cell: Cell) -> None:
    if cell.jig is None:
        raise InputError("the cell has no jig to touch; name one in cell.yaml (jig: library:step-block)")
    for name, pose in (("base", cell.base), ("tool", cell.tool)):
        if pose is None:
            raise InputError(f"{name}: fit leaves open where the {name} stands; write its pose to plan touches")
    if cell.touch.travel <= cell.touch.approach:
        raise InputError(
            f"touch: a search of travel_mm: {cell.touch.travel:g} ends before the contact, which is approach_mm: "
            f"{cell.touch.approach:g} away; write a longer travel_mm"
        )


class _Search:
    """Rounds of targets, solved and judged."""

    def __init__(
        self,
        cell: Cell,
        theta: Float[np.ndarray, " parameters"],
        root: Float[np.ndarray, "parameters directions"],
        share: float,
        margin: float,
        regular: float,
        explored: int,
        rng: np.random.Generator,
    ) -> None:
        self.cell, self.theta, self.rng = cell, theta, rng
        self.regular = regular
        self.faces = cell.the_jig.faces
        size = np.stack([face.size for face in self.faces])
        edge = np.minimum(EDGE / size, 0.4)
        around = spread(cell, edge, explored // 2, rng).followed_by(structured(cell, edge, explored // 2, rng))
        self.branches = Branches(cell, theta, _poses(cell, around), rng)
        solutions = self.branches.known.within(cell.robot)
        face = around.face[self.branches.order][solutions.pose]
        edges = margins(cell, root, theta, face, solutions.q, share)
        self.inset = np.minimum(edges.inset / size, 0.5)
        self.feasibility = Feasibility(cell, theta, edges, margin)
        self.hits = Hits(cell, theta, root)
        self.tally = np.zeros((len(self.faces), len(Infeasibility)), dtype=int)

    def round(self, size: int) -> Candidates:
        """Touches that pass, of about `size` targets."""
        many = int(self.regular * size)
        targets = spread(self.cell, self.inset, size - many, self.rng)
        if many:
            targets = structured(self.cell, self.inset, many, self.rng).followed_by(targets)
        solutions = self.branches.solve(_poses(self.cell, targets))
        face = targets.face[solutions.pose]
        q, tilt = solutions.q, targets.tilt[solutions.pose]
        if len(self.cell.robot.joints) < 5:
            q, tilt = self._settled(targets.take(solutions.pose), q)
        approach, infeasibility = self.feasibility.touch(face, q)
        np.add.at(self.tally, (face, infeasibility), 1)
        ok = infeasibility == Infeasibility.NONE
        pose = solutions.pose[ok]
        return Candidates(
            self.faces,
            face[ok],
            targets.point[pose],
            targets.normal[pose],
            tilt[ok],
            q[ok],
            approach[ok],
            self.hits.share(face[ok], q[ok]),
            self.feasibility.margins,
            self.hits,
        )

    def _settled(
        self, targets: Targets, q: Float[np.ndarray, "touches joints"]
    ) -> tuple[Float[np.ndarray, "touches joints"], Float[np.ndarray, " touches"]]:
        """Joints and tilts at contact, where the robot and not the target says how the wire stands."""
        for _ in range(3):
            tip, R = self.cell.kinematics.tip(q, self.theta)
            tilt = np.arccos(np.clip(-(R[:, :, 2] * targets.normal).sum(axis=1), -1.0, 1.0))
            tip = replace(targets, tilt=tilt).tip(self.cell)
            q = reach(self.cell.kinematics, self.theta, tip, R, q, free_orientation=True, iterations=5).q
        return q, tilt


def _poses(cell: Cell, targets: Targets) -> Poses:
    return Poses(targets.tip(cell), targets.rotation, targets.face)
