"""cvxpy with Clarabel: the D-optimal weights as a convex program."""

import cvxpy as cp
import numpy as np

Problem = dict[str, np.ndarray]


def select(problem: Problem) -> Problem:
    """Weights that maximise log det; the rows of the largest weights are chosen."""
    X = problem["rows"]
    w = cp.Variable(len(X), nonneg=True)
    information = X.T @ cp.multiply(cp.reshape(w, (len(X), 1), order="C"), X)
    cp.Problem(cp.Maximize(cp.log_det(information)), [cp.sum(w) == 1]).solve(solver=cp.CLARABEL)
    return {"weights": w.value, "indices": np.argsort(-w.value)[: int(problem["n"])]}


METHODS = {"cvxpy Clarabel": select}
