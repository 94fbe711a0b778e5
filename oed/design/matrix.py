"""Candidate rows: their information, and what each of them would add to it."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

BLOCK = 16384  # rows priced at once: the block and its product stay in cache, and memory stays flat at 1e6 candidates
RANK_TOLERANCE = 1e-13  # of an eigenvalue of the scaled information, so 3e-7 of a singular value of the rows


def checked(rows: np.ndarray, name: str = "rows") -> Float[np.ndarray, "candidates parameters"]:
    """The rows as float64, after a look at shape and finiteness."""
    rows = np.asarray(rows, dtype=float)
    if rows.ndim != 2 or 0 in rows.shape:
        raise ValueError(f"{name}: shape {rows.shape}, expected (candidates, parameters) with at least one of each")
    finite = np.isfinite(rows).all(axis=1)
    if not finite.all():
        raise ValueError(
            f"{name}: {int((~finite).sum())} of {len(rows)} rows are not finite, the first is row "
            f"{int(np.argmin(finite))}; leave such touches out of the candidates"
        )
    return rows


def checked_prior(prior: np.ndarray | None, parameters: int) -> Float[np.ndarray, "parameters parameters"]:
    """The information already known, zero if there is none."""
    if prior is None:
        return np.zeros((parameters, parameters))
    prior = np.asarray(prior, dtype=float)
    if prior.shape != (parameters, parameters) or not np.isfinite(prior).all():
        raise ValueError(f"prior: shape {prior.shape}, expected finite numbers of shape ({parameters}, {parameters})")
    if np.abs(prior - prior.T).max() > 1e-9 * max(np.abs(prior).max(), 1e-300):
        raise ValueError("prior: not symmetric; give the information matrix J'J of what is known")
    smallest, largest = np.linalg.eigvalsh(prior)[[0, -1]]
    if smallest < -1e-9 * max(largest, 1e-300):
        raise ValueError(f"prior: eigenvalue {smallest:.3g} is negative; an information matrix has none")
    return (prior + prior.T) / 2


def information(
    rows: Float[np.ndarray, "touches parameters"], weights: Float[np.ndarray, " touches"] | None = None
) -> Float[np.ndarray, "parameters parameters"]:
    """Fisher information of whitened rows, each counted `weights` times."""
    return rows.T @ rows if weights is None else (rows.T * weights) @ rows


def blocks(count: int, size: int = BLOCK) -> Iterator[slice]:
    """Slices that cover `count` rows."""
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


def sensitivities(
    rows: Float[np.ndarray, "candidates parameters"], S: Float[np.ndarray, "parameters parameters"]
) -> Float[np.ndarray, " candidates"]:
    """The number x' S x for every candidate row x: with S = M^-1 the variance that the touch would see."""
    out = np.empty(len(rows))
    for block in blocks(len(rows)):
        np.einsum("ij,ij->i", rows[block] @ S, rows[block], out=out[block])
    return out


def whitener(M: Float[np.ndarray, "parameters parameters"]) -> Float[np.ndarray, "parameters parameters"]:
    """T with T' M T = 1, so that rows @ T have unit information; says so when M does not determine every parameter."""
    T, _ = seen(M)
    rank, empty = T.shape[1], np.flatnonzero(np.diag(M) == 0)
    if rank < len(M):
        where = f" (parameter {empty[0]} is in no row)" if len(empty) else ""
        raise ValueError(
            f"rows: they determine {rank} of {len(M)} parameters{where}; eliminate what cannot be seen, add candidates "
            "of another kind, or give a prior"
        )
    return T


def seen(
    M: Float[np.ndarray, "parameters parameters"],
) -> tuple[Float[np.ndarray, "parameters seen"], Float[np.ndarray, "parameters unseen"]]:
    """T with T' M T = 1 and as many columns as M has rank, and directions along which M tells nothing."""
    size = np.sqrt(np.diag(M))
    scale = 1 / np.where(size == 0, 1, size)
    eigenvalues, V = np.linalg.eigh(M * scale * scale[:, None])
    strong = eigenvalues > RANK_TOLERANCE * eigenvalues[-1]
    return scale[:, None] * V[:, strong] / np.sqrt(eigenvalues[strong]), scale[:, None] * V[:, ~strong]
