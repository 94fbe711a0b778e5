"""Does the model mean what the pendant shows? Poses read off it, and the usual reasons why they differ.

Axis signs, a coupling of joint 3 to joint 2 and zeros that are a right angle off belong to how the controller counts:
they are proposed as `joints:` of the cell.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identify.model.cell import DEG, Cell
from identify.model.files import read_sheet
from identify.model.frames import rotation, transform
from identify.model.io.tables import POINT, joint_columns
from identify.model.joint_counting import JointCounting

EULER = ("w_deg", "p_deg", "r_deg")
NEAR_MM, NEAR_RAD = 1.0, 0.2 * DEG  # a pendant shows nominal numbers, rounded: what is further off is another model
FEWEST = 3


@dataclass(frozen=True, eq=False)
class Pendant:
    """Poses as the pendant shows them: joints, and the tool's place X Y Z W P R in the robot's base frame."""

    ids: tuple[str, ...]
    q: Float[np.ndarray, "poses joints"]  # [rad] or [mm]
    point: Float[np.ndarray, "poses 3"]  # [mm]
    angles: Float[np.ndarray, "poses 3"]  # [rad], W, P, R


@dataclass(frozen=True)
class Cause:
    """One reason why a pendant and a model differ, and what to do about it."""

    name: str
    cure: str


@dataclass(frozen=True)
class Agreement:
    """How far model and pendant are apart, before and after the causes found."""

    position_mm: float  # largest, with the model as it is
    angle_deg: float
    causes: tuple[Cause, ...]
    explained_mm: float  # largest, with the causes
    explained_deg: float
    counting: JointCounting | None = None  # of the controller, by the causes; None: as the cell says

    @property
    def agrees(self) -> bool:
        """Whether the model as it is means what the pendant shows."""
        return self.position_mm < NEAR_MM and self.angle_deg < NEAR_RAD / DEG

    @property
    def explained(self) -> bool:
        """Whether the causes make model and pendant agree."""
        return self.explained_mm < NEAR_MM and self.explained_deg < NEAR_RAD / DEG


def read_pendant(path: Path, cell: Cell) -> Pendant:
    """Read pendant.csv: columns id, q1_deg ... qN_deg, x_mm, y_mm, z_mm, w_deg, p_deg, r_deg; raises InputError."""
    sheet = read_sheet(path, ["id", *joint_columns(cell.robot), *POINT, *EULER], [])
    q = cell.robot.from_controller(np.column_stack([sheet.numbers(name) for name in joint_columns(cell.robot)]))
    point, angles = (np.column_stack([sheet.numbers(name) for name in names]) for names in (POINT, EULER))
    if len(sheet.lines) < FEWEST:
        sheet.at(0, f"{len(sheet.lines)} poses tell too little; read at least {FEWEST}, with every joint moved")
    sheet.stop()
    return Pendant(tuple(sheet.text("id")), q, point, angles * DEG)


def compare(cell: Cell, pendant: Pendant) -> Agreement:
    """Compare model and pendant; where they differ, the fewest usual causes that explain it."""
    as_is = _misfit(cell, pendant, pendant.q[None], _READINGS[0])
    position, angle = float(as_is[0][0]), float(as_is[1][0])
    best = Agreement(position, angle / DEG, (), position, angle / DEG)
    if best.agrees:
        return best
    agreement = min(_explanations(cell, pendant), key=lambda a: (not a.explained, *_cost(a)))
    return replace(agreement, position_mm=position, angle_deg=angle / DEG)


def _cost(a: Agreement) -> tuple[float, float]:
    """Fewer causes first where they explain; the smaller misfit first where nothing does."""
    return (len(a.causes), a.explained_mm) if a.explained else (a.explained_mm, len(a.causes))


@dataclass(frozen=True)
class _Reading:
    """How the numbers of a pose may be meant."""

    flange: bool  # the flange is shown, not the tip
    metres: bool
    shifted: bool  # by a constant, as with a base plate or another origin
    order: str  # of the Euler angles

    def causes(self, shift: Float[np.ndarray, " 3"]) -> Iterator[Cause]:
        if self.flange:
            yield Cause(
                "the pendant shows the flange, not the wire tip",
                "select the tool on the pendant, or compare with tool zero",
            )
        if self.metres:
            yield Cause("the pendant's lengths are metres", "multiply x, y and z by 1000")
        if self.shifted:
            words = ", ".join(f"{v:+.1f}" for v in shift)
            yield Cause(
                f"the pendant's origin lies ({words}) mm from the model's base",
                "add it to the base's height in robot.yaml (d_mm of joint 1), or to base: in cell.yaml",
            )
        if self.order != "zyx":
            yield Cause(
                f"the angles are meant as {' '.join('R' + axis for axis in self.order)}, not Rz Ry Rx",
                "convert them, or read them in the W P R convention",
            )


_READINGS = [_Reading(f, m, s, o) for o in ("zyx", "xyz", "zyz") for s, m, f in product((False, True), repeat=3)]


@dataclass(frozen=True, eq=False)
class _Convention:
    """Another way to count the joints, and the causes that it stands for."""

    causes: tuple[Cause, ...]
    counting: JointCounting | None  # None: as the cell says
    q: Float[np.ndarray, "poses joints"]  # [rad] or [mm]


def _explanations(cell: Cell, pendant: Pendant) -> Iterator[Agreement]:
    """Every combination of joint conventions with every way to read a pose."""
    conventions = list(_conventions(cell, pendant.q))
    q = np.stack([convention.q for convention in conventions])
    size = np.array([len(convention.causes) for convention in conventions])
    for reading in _READINGS:
        position, angle, shift = _misfit(cell, pendant, q, reading)
        good = (position < NEAR_MM) & (angle < NEAR_RAD)
        for i in {int(np.argmin(position + angle * 300)), int(np.argmin(np.where(good, size, 99)))}:
            causes = (*conventions[i].causes, *reading.causes(shift[i]))
            apart = float(position[i]), float(angle[i]) / DEG
            yield Agreement(0.0, 0.0, causes, *apart, conventions[i].counting)


def _conventions(cell: Cell, q: Float[np.ndarray, "poses joints"]) -> Iterator[_Convention]:
    """Joint values under axis signs, a coupling of joint 3 to joint 2, and an offset of a right angle."""
    robot, n = cell.robot, q.shape[1]
    names = [joint.name for joint in robot.joints]
    A, b = robot.counting.matrix(n)
    offsets = [None, *((i, turn) for i in range(n) if not robot.prismatic[i] for turn in (90, -90, 180))]
    for signs, couple, offset in product(product((1, -1), repeat=n), (0, 1, -1) if n > 2 else (0,), offsets):
        change, turned = np.diag(np.array(signs, dtype=float)), np.zeros(n)
        cure = "it belongs into joints: of cell.yaml"
        causes = [Cause(f"the axis of {names[i]} points the other way", cure) for i in range(n) if signs[i] < 0]
        if couple:
            change[2, 1] = couple
            sign = "+" if couple > 0 else "-"
            causes.append(
                Cause(f"{names[2]} is coupled to {names[1]}: the model's is the pendant's {sign} {names[1]}", cure)
            )
        if offset is not None:
            turned[offset[0]] = offset[1]
            causes.append(Cause(f"the zero of {names[offset[0]]} is {offset[1]:+d} degrees off", cure))
        if len(causes) > 3:
            continue
        counting = JointCounting.of_matrix(change @ A, change @ b + turned) if causes else None
        if counting is not None or not causes:
            counting = counting and replace(counting, pulses=robot.counting.pulses)
            yield _Convention(tuple(causes), counting, q @ change.T + turned * robot.joint_unit())


def _misfit(
    cell: Cell, pendant: Pendant, q: Float[np.ndarray, "ways poses joints"], reading: _Reading
) -> tuple[Float[np.ndarray, " ways"], Float[np.ndarray, " ways"], Float[np.ndarray, "ways 3"]]:
    """Largest distances [mm] and angles [rad] of each way of meaning the joints, and the constant shift taken out."""
    ways, poses, joints = q.shape
    p, R = cell.kinematics.flange(q.reshape(-1, joints), cell.theta)
    if not reading.flange and cell.tool is not None:
        tool = transform(cell.tool)
        p, R = p + R @ tool[:3, 3], R @ tool[:3, :3]
    point = pendant.point * (1000.0 if reading.metres else 1.0)
    way = point - p.reshape(ways, poses, 3)
    shift = way.mean(axis=1) if reading.shifted else np.zeros((ways, 3))
    display = _shown(pendant.angles, reading.order)
    cosine = (np.einsum("wpij,pij->wp", R.reshape(ways, poses, 3, 3), display) - 1) / 2
    angle = np.arccos(np.clip(cosine, -1, 1))
    return np.linalg.norm(way - shift[:, None], axis=2).max(axis=1), angle.max(axis=1), shift


def _shown(angles: Float[np.ndarray, "poses 3"], order: str) -> Float[np.ndarray, "poses 3 3"]:
    """Rotations of W, P, R in an order of elementary rotations; zyx is Rz(R) Ry(P) Rx(W)."""
    w, p, r = angles.T
    zero = np.zeros_like(w)
    if order == "zyx":
        return rotation(r, p, w)
    if order == "xyz":
        return rotation(zero, zero, w) @ rotation(zero, p, zero) @ rotation(r, zero, zero)
    return rotation(w, p, zero) @ rotation(r, zero, zero)
