"""Exchange passes over several models at once: the last pass of every plan, and plans that suit many robots."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from oed.aim import Aim

PASSES = 20  # at the most
LEAST = 1e-7  # gain of a swap that counts


def swapped(
    rows: Float[np.ndarray, "models pool kept"],
    precision: Float[np.ndarray, "kept kept"],
    chosen: Int[np.ndarray, " n"],
    aims: Sequence[Aim],
    *,
    allowed: Bool[np.ndarray, " pool"] | None = None,
    worst: bool = False,
    passes: int = PASSES,
) -> Int[np.ndarray, " n"]:
    """Replace touches one by one by better ones of the pool until none is left that helps; never worse than before.

    A touch is judged by the mean of the criterion over the models, or with `worst` by the least of them: robots drawn
    from what is known, each with rows and an aim of its own. Only `allowed` ones come in, and others have to leave,
    whatever that costs.
    """
    chosen = chosen.copy()
    M = precision + np.einsum("mnk,mnl->mkl", rows[:, chosen], rows[:, chosen])
    for _ in range(passes):
        changed = False
        for i in range(len(chosen)):
            out = rows[:, chosen[i]]
            rest = M - out[:, :, None] * out[:, None, :]
            scores = np.stack([
                aim.value(R) + aim.gains(F, np.linalg.inv(R)) for aim, R, F in zip(aims, rest, rows, strict=True)
            ])  # fmt: skip
            score = scores.min(axis=0) if worst else scores.mean(axis=0)
            now = score[chosen[i]] if allowed is None or allowed[chosen[i]] else -np.inf
            score[chosen] = -np.inf
            if allowed is not None:
                score[~allowed] = -np.inf
            best = int(np.argmax(score))
            if score[best] > now + LEAST:
                chosen[i], changed = best, True
                M = rest + rows[:, best, :, None] * rows[:, best, None, :]
        if not changed:
            break
    return chosen
