"""What planned touches do not show, in words, and which touches would show it."""

import numpy as np
from jaxtyping import Float

from identify.uncertainty.coordinates import Coordinates
from identify.uncertainty.information import Information

SHARE = 0.1  # of the square of a direction that an unknown carries, to be named
BETTER = 3.0  # times as much as the best touch of this jig, for another face to be worth its place
LISTED = 6  # directions, the worst first


def unseen(
    coordinates: Coordinates,
    pool: Float[np.ndarray, "touches k"],
    rows: Float[np.ndarray, "n k"],
    zone: Float[np.ndarray, "poses joints"],
) -> tuple[str, ...]:
    """A sentence for every direction of identifiable parameters that n touches see less well than the priors do.

    `pool` are the rows of all candidates: if even n of the best of them would not do, the jig is to blame, else the
    number or the choice. A face that would show more is looked for along the axes of the jig frame, at the poses of the
    weld zone.
    """
    root = np.linalg.cholesky(coordinates.precision)  # directions are compared with the priors
    value, vector = np.linalg.eigh(np.linalg.solve(root, np.linalg.solve(root, rows.T @ rows).T))
    weak = [np.linalg.solve(root.T, v) for v in vector.T[value < 1.0]]
    return tuple(_sentence(coordinates, pool, len(rows), zone, v) for v in weak[:LISTED])


def limiting(after: Information, zone: Float[np.ndarray, "poses joints"]) -> str:
    """The combination of unknowns that most of the tip error in the zone comes from, and the face that would show it.

    It is the first principal component of the tip errors over all poses.
    """
    tip = after.unknowns.tip_rows(zone, after.theta)
    _, s, Vt = np.linalg.svd(after.root(tip).reshape(-1, len(after.R)), full_matrices=False)
    v = after.root(np.eye(len(after.R))) @ Vt[0]
    pose, axis = np.unravel_index(int(np.argmax(np.abs(tip @ v))), tip.shape[:2])
    return (
        f"{100 * s[0] ** 2 / (s @ s):.0f} % of the remaining tip variance comes from one combination of unknowns: "
        f"{_names(after.unknowns.names, v)}. To reduce it, add a face whose normal points along "
        f"{_where(after, zone, int(pose), int(axis))}."
    )


def _where(knowledge: Information, zone: np.ndarray, pose: int, axis: int) -> str:
    """An axis, and a place in the jig frame."""
    at = knowledge.unknowns.cell.kinematics.tip(zone[pose : pose + 1], knowledge.theta)[0][0]
    return f"{'xyz'[axis]}, near ({', '.join(f'{x:.0f}' for x in at)}) mm"


def _sentence(c: Coordinates, pool: np.ndarray, n: int, zone: np.ndarray, v: Float[np.ndarray, " k"]) -> str:
    """One direction: its name, whether the jig could show it, what it does in the zone, and what to add."""
    tip = c.tip_rows(zone) @ v
    best = float(((pool @ v) ** 2).max(initial=0.0))
    harm = float(np.sqrt((tip**2).sum(axis=1).mean()))
    fault = (
        f"no {n} touches of this jig would show it better than the priors do"
        if n * best < 1
        else "these touches show it less well than the priors do"
    )
    return f"{_names(c.names, v)}: {fault}; it leaves {harm:.2g} mm in the zone; {_cure(c, zone, tip, best, harm)}"


def _names(names: tuple[str, ...], v: Float[np.ndarray, " k"]) -> str:
    share = v**2 / (v @ v)
    order = np.argsort(-share, kind="stable")
    named = [names[i] for i in order if share[i] > SHARE] or [names[order[0]]]
    return " with ".join(named[:4]) + (" and others" if len(named) > 4 else "")


def _cure(c: Coordinates, zone: np.ndarray, tip: Float[np.ndarray, "poses 3"], best: float, harm: float) -> str:
    """The face that would show a direction best, or why none is worth it."""
    sigma = c.prior.unknowns.cell.touch.sigma
    if harm < sigma / 2:
        return "less than a touch scatters, so it may stay"
    pose, axis = np.unravel_index(int(np.argmax(np.abs(tip))), tip.shape)
    if (tip[pose, axis] / sigma) ** 2 < BETTER * best:
        return "make more touches"
    return f"add a face whose normal points along {_where(c.prior, zone, int(pose), int(axis))}"
