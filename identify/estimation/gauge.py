"""What no measurement can tell because it is a choice of frame, and whether any length is known."""

import numpy as np
from jaxtyping import Float

from identify.model.files import InputError
from identify.model.frames import transform
from identify.model.measurement import Rows
from identify.uncertainty.unknowns import Unknowns

UNSEEN = 1e-8  # of the largest singular value: directions below it are a choice of frame
LOOSE = 10.0  # [mm]: a face with a larger tolerance stands anywhere
SHRUNK = 1e-3  # share by which all lengths might shrink; measurements have to notice it


def without_gauge(
    unknowns: Unknowns, origin: Float[np.ndarray, " unknowns"], basis: Float[np.ndarray, "unknowns size"], rows: Rows
) -> Float[np.ndarray, "unknowns fewer"]:
    """The basis without directions that have no prior and that no row depends on: they stay where they start."""
    if not unknowns.named:
        return basis
    loose = (unknowns.precision[:, None] * np.abs(basis)).sum(axis=0) == 0
    if not loose.any():
        return basis
    J = _consistent(unknowns, origin, rows) @ basis[:, loose]
    unit = np.linalg.norm(J, axis=0)
    unit[unit == 0] = 1.0
    s, Vt = np.linalg.svd(J / unit)[1:]
    rank = int((s > UNSEEN * s[0]).sum())
    visible = np.linalg.qr(Vt[:rank].T / unit[:, None])[0]
    return np.hstack([basis[:, ~loose], basis[:, loose] @ visible])


def _consistent(
    unknowns: Unknowns, x: Float[np.ndarray, " unknowns"], rows: Rows
) -> Float[np.ndarray, "rows unknowns"]:
    """The Jacobian of rows that a robot without errors would make: each tip is moved to where it was measured.

    A turn of two sockets about the line through them is a choice of frame. The tips of a robot as it starts lie beside
    that line, which would make the turn look as if it were seen.
    """
    r, _ = unknowns.linearize(x, rows)
    theta, placed_rows = unknowns.each(x, rows)
    theta = np.tile(theta, (len(rows), 1)) if theta.ndim == 1 else theta.copy()
    shift = np.zeros((len(rows.ids), 3))
    np.add.at(shift, rows.owner, -rows.normal * r[:, None])
    R = unknowns.cell.kinematics.tip(rows.q, theta)[1]
    in_flange = transform(theta[:, -6:])[:, :3, :3] @ np.swapaxes(R, 1, 2)
    theta[:, -6:-3] += np.einsum("mij,mj->mi", in_flange, shift[rows.owner])
    return unknowns.slopes_at(theta, placed_rows)


def gauge_words(unknowns: Unknowns, basis: Float[np.ndarray, "unknowns size"]) -> str:
    """The choice of frame in words; empty if there is none."""
    loose = np.flatnonzero(unknowns.precision == 0)
    share = 1 - (basis[loose] ** 2).sum(axis=1)
    free = len(loose) - round(float((basis[loose] ** 2).sum()))
    if free <= 0:
        return ""
    names = sorted({unknowns.names[i].rpartition(".")[0] for i, s in zip(loose, share, strict=True) if s > 0.01})
    return (
        f"{free} directions of {', '.join(names)} are a choice of frame: no measurement depends on them, and they stay "
        "where the search began"
    )


def require_scale(unknowns: Unknowns, x: Float[np.ndarray, " unknowns"], rows: Rows) -> None:
    """Raise InputError if all lengths could shrink together without a measurement that notices."""
    faces = () if unknowns.cell.jig is None else unknowns.cell.jig.faces
    loose = {f"face.{face.name}": face.offset for face in faces if face.tolerance > LOOSE}
    if not (unknowns.named or loose):
        return
    values = unknowns.origin + x * unknowns.scale + [loose.get(name, 0.0) for name in unknowns.names]
    values[: len(unknowns.parameters)] = unknowns.theta(x)[unknowns.parameters]
    fixed_names = {shared.name for shared in unknowns.shared} - loose.keys()
    pairs = zip(unknowns.names, unknowns.units, strict=True)
    lengths = np.array([unit == "mm" and name not in fixed_names for name, unit in pairs])
    shrink = np.where(lengths, values / unknowns.scale, 0.0)
    shares = unknowns.linearize(x, rows)[1] @ shrink / rows.sigma
    if SHRUNK * np.linalg.norm(shares) < 1:
        raise InputError(
            "no length is known among what was measured: the robot and all placements could shrink together, and no "
            "measurement would notice. Give one length: a distance between two points (spacings:), a distance to a "
            f"point of known place, or touches on a jig whose faces are known to better than {LOOSE:g} mm"
        )
