"""What planned touches leave in the dark, in words, and what would bring it to light."""

import numpy as np
from jaxtyping import Float

from identify.uncertainty.information import Knowledge

SHARE = 0.1  # of the square of a direction that a parameter carries, to be named
BETTER = 3.0  # times as much as the best touch of this jig, for another face to be worth its place
LISTED = 6  # directions told, the worst first


def unseen(
    known: Knowledge,
    pool: Float[np.ndarray, "touches kept"],
    chosen: Float[np.ndarray, "n kept"],
    zone: Float[np.ndarray, "poses joints"],
) -> tuple[str, ...]:
    """A sentence for every direction of parameters that n touches see less well than what is known before.

    `pool` are the rows of all touches that the jig offers: where even n of the best of them would not do, the jig is to
    blame, else the number or the choice. A face that would show more is looked for along the axes of the jig frame, at
    the poses of the weld zone.
    """
    root = np.linalg.cholesky(known.precision)  # directions are compared with what is known before
    value, vector = np.linalg.eigh(np.linalg.solve(root, np.linalg.solve(root, chosen.T @ chosen).T))
    weak = [np.linalg.solve(root.T, v) for v in vector.T[value < 1.0]]
    return tuple(_sentence(known, pool, len(chosen), zone, v) for v in weak[:LISTED])


def limiting(
    known: Knowledge,
    covariance: Float[np.ndarray, "kept kept"],
    zone: Float[np.ndarray, "poses joints"],
) -> str:
    """What most of the tip error in the zone comes from after the touches, and the face that would show it best.

    The direction of parameters in which the covariance moves the tip most, on the average over the zone.
    """
    tip = known.tip_rows(zone)
    root = np.linalg.cholesky(covariance)
    moves = np.einsum("pik,kl->pil", tip, root, optimize=True)
    value, vector = np.linalg.eigh(np.einsum("pik,pil->kl", moves, moves, optimize=True))
    v = root @ vector[:, -1]
    share = value[-1] / value.sum()
    pose, axis = np.unravel_index(int(np.argmax(np.abs(tip @ v))), tip.shape[:2])
    return (
        f"{100 * share:.0f} % of the tip variance that is left comes from one direction, {_names(known, v)}; "
        f"a face that looks along {_where(known, zone, int(pose), int(axis))} would show it best"
    )


def _where(known: Knowledge, zone: np.ndarray, pose: int, axis: int) -> str:
    """An axis, and a place in the jig frame."""
    at = known.cell.kinematics.tip(zone[pose : pose + 1], known.theta)[0][0]
    return f"{'xyz'[axis]} near ({', '.join(f'{x:.0f}' for x in at)}) mm"


def _sentence(known: Knowledge, pool: np.ndarray, n: int, zone: np.ndarray, v: Float[np.ndarray, " kept"]) -> str:
    """One direction: who it is, whether the jig could show it, what it does in the zone, and what to add."""
    tip = known.tip_rows(zone) @ v
    best = float(((pool @ v) ** 2).max(initial=0.0))
    harm = float(np.sqrt((tip**2).sum(axis=1).mean()))
    fault = (
        f"no {n} touches of this jig would show it better than what is known"
        if n * best < 1
        else "these touches show it less well than what is known"
    )
    return f"{_names(known, v)}: {fault}; it leaves {harm:.2g} mm in the zone; {_cure(known, zone, tip, best, harm)}"


def _names(known: Knowledge, v: Float[np.ndarray, " kept"]) -> str:
    share = v**2 / (v @ v)
    order = np.argsort(-share, kind="stable")
    named = [known.names[i] for i in order if share[i] > SHARE]
    return " with ".join(named[:4]) + (" and others" if len(named) > 4 else "")


def _cure(known: Knowledge, zone: np.ndarray, tip: Float[np.ndarray, "poses 3"], best: float, harm: float) -> str:
    """The face that would show a direction best, or why none is worth it."""
    sigma = known.cell.touch.sigma
    if harm < sigma / 2:
        return "less than a touch scatters, so it may stay"
    pose, axis = np.unravel_index(int(np.argmax(np.abs(tip))), tip.shape)
    if (tip[pose, axis] / sigma) ** 2 < BETTER * best:
        return "make more touches"
    return f"add a face that looks along {_where(known, zone, int(pose), int(axis))}"
