"""Optimal transport between weighted points: as a linear program, primal and dual, and with an entropy (Sinkhorn)."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
from scipy.optimize import linprog

from .problem import Numbers


class Transport(NamedTuple):
    value: float
    plan: Numbers  # (n, m) what goes from each source to each sink
    f: Numbers     # (n) and (m): potentials, f_i + g_j <= cost_ij
    g: Numbers


def _marginals(n: int, m: int) -> sparse.csr_matrix:
    return sparse.vstack([sparse.kron(sparse.eye(n), np.ones((1, m))), sparse.kron(np.ones((1, n)), sparse.eye(m))])


def primal(cost: Numbers, a: Numbers, b: Numbers) -> Transport:
    """Least sum of plan x cost with marginals a (n) and b (m). The potentials are the constraints' prices."""
    done = linprog(cost.ravel(), A_eq=_marginals(*cost.shape), b_eq=np.concatenate([a, b]), method="highs")
    prices = done.eqlin.marginals
    return Transport(float(done.fun), done.x.reshape(cost.shape), prices[:len(a)], prices[len(a):])


def dual(cost: Numbers, a: Numbers, b: Numbers) -> Transport:
    """Largest a' f + b' g with f_i + g_j <= cost_ij (Kantorovich). The plan is the constraints' prices."""
    n, m = cost.shape
    done = linprog(-np.concatenate([a, b]), A_ub=_marginals(n, m).T, b_ub=cost.ravel(), bounds=(None, None),
                   method="highs")
    return Transport(-float(done.fun), -done.ineqlin.marginals.reshape(n, m), done.x[:n], done.x[n:])


def sinkhorn(cost: Numbers, a: Numbers, b: Numbers, epsilon: float, iterations: int = 10000) -> Transport:
    """The primal plus epsilon times the plan's negative entropy; `value` is the plan's cost without it (ott-jax)."""
    from ott.geometry import geometry
    from ott.problems.linear import linear_problem
    from ott.solvers.linear import sinkhorn as solver

    given = linear_problem.LinearProblem(geometry.Geometry(cost_matrix=cost, epsilon=epsilon), a=a, b=b)
    out = solver.Sinkhorn(threshold=1e-9, max_iterations=iterations)(given)
    plan = np.asarray(out.matrix)
    return Transport(float((plan * cost).sum()), plan, np.asarray(out.f), np.asarray(out.g))
