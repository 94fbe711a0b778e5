"""The delay of the touch signal, from touches made at two speeds: a latch comes late by speed times delay."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.touch import HIT, Touches
from probe.runs.records import Reading, Result

MOMENT = 1e-3  # [s], to find the speed of the tip by


@dataclass(frozen=True)
class Delay:
    """How late the touch signal is latched."""

    seconds: float
    sigma: float  # [s], from the scatter of the pairs
    pairs: int


def estimate_delay(results: Iterable[Result], cell: Cell) -> Delay:
    """The delay that explains by how much deeper the quick touch of each pair was latched, by least squares.

    With d_i the difference of the two latches along the normal and v_i that of the two speeds: d_i = v_i delay.
    Raises InputError where fewer than three touches were made at two speeds.
    """
    pairs = [
        (r, r.fast) for r in results if r.status == HIT and r.fast is not None and np.isfinite(r.fast.velocity).all()
    ]
    if len(pairs) < 3:
        raise InputError(f"{len(pairs)} touches were made at two speeds, expected at least 3; run with a fast speed")
    faces = {} if cell.jig is None else cell.jig.by_name
    normals = [faces[slow.face].normal for slow, _ in pairs]
    deeper = _along(normals, _tips(cell, [f.q for _, f in pairs]) - _tips(cell, [s.reading.q for s, _ in pairs]))
    faster = _along(normals, _speeds(cell, [f for _, f in pairs]) - _speeds(cell, [s.reading for s, _ in pairs]))
    weight = float(faster @ faster)
    if weight < 1e-6:
        raise InputError("both speeds of every pair are the same; run with a fast speed that differs from the slow one")
    seconds = float(faster @ deeper) / weight
    scatter = float(np.sum((deeper - faster * seconds) ** 2)) / (len(pairs) - 1)
    return Delay(seconds, float(np.sqrt(scatter / weight)), len(pairs))


def without_delay(results: Iterable[Result], cell: Cell, delay: float) -> Touches:
    """The touches that count, each set back to where the robot was `delay` [s] before its latch; the notes say so.

    Touches whose speed is not known stay out.
    """
    hits = [r for r in results if r.status == HIT and np.isfinite(r.reading.velocity).all()]
    faces = {} if cell.jig is None else cell.jig.by_name
    shifted = [replace(r, note="; ".join(filter(None, (r.note, f"set back by {1000 * delay:.2f} ms")))) for r in hits]
    joints = len(cell.robot.joints)
    return Touches(
        ids=tuple(r.id for r in shifted),
        face=tuple(r.face for r in shifted),
        q=np.array([r.reading.q - delay * r.reading.velocity for r in shifted]).reshape(-1, joints),
        normal=np.array([faces[r.face].normal for r in shifted]).reshape(-1, 3),
        offset=np.array([faces[r.face].offset for r in shifted]),
        sigma=np.full(len(shifted), cell.touch.sigma),
        status=(HIT,) * len(shifted),
        temperature=np.array([r.temperature for r in shifted]),
        time=tuple(r.time for r in shifted),
        note=tuple(r.note for r in shifted),
    )


def _tips(cell: Cell, q: Sequence[np.ndarray]) -> Float[np.ndarray, "touches 3"]:
    return cell.kinematics.tip(np.stack(q), cell.theta)[0]


def _speeds(cell: Cell, readings: Sequence[Reading]) -> Float[np.ndarray, "touches 3"]:
    """Velocities of the tip at readings [mm/s]."""
    ahead, behind = ([r.q + sign * MOMENT * r.velocity for r in readings] for sign in (1, -1))
    return (_tips(cell, ahead) - _tips(cell, behind)) / (2 * MOMENT)


def _along(normals: Sequence[np.ndarray], vectors: Float[np.ndarray, "touches 3"]) -> Float[np.ndarray, " touches"]:
    return np.einsum("ij,ij->i", np.stack(normals), vectors)
