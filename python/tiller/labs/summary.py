"""What a simulation is compared by: a vector of fixed length (docs/theory/likelihood_free.md#summaries)."""
from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from .problem import Array, InferenceError, Problem


class Summary(Protocol):
    is_scaled: bool  # in units of its noise

    def learn(self, v: Array, y: Array) -> Array:
        """Learns from simulations, and gives their summaries (n, size), each as if it had been left out."""
        ...

    def of(self, y: Array) -> Array:
        """Summaries of trajectories (n, periods, ny)."""
        ...


class CrossCorrelation:
    """By hand, as BayesSim: mean products of changes with inputs, mean and variance of the changes."""
    is_scaled = False

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    def learn(self, v: Array, y: Array) -> Array:
        return self.of(y)

    def of(self, y: Array) -> Array:
        changes = self.problem.changes(y)
        products = np.einsum("ntu,tk->nuk", changes, self.problem.inputs) / changes.shape[1]
        return np.concatenate([products.reshape(len(y), -1), changes.mean(axis=1), changes.var(axis=1)], axis=1)


class _Estimate:
    """The estimate that one linear model of the data y (n, values) makes."""

    def learn(self, design: Array, d: int, y: Array) -> Array:
        """design (n, terms): one, w (d), products. Least squares without row k has the terms less p_k e_k / (1 - h_k),
        where p_k = (D'D)^-1 d_k, h_k = d_k' p_k and e_k is the row's residual."""
        p = np.linalg.solve(design.T @ design, design.T)
        terms = p @ y
        residual = y - design @ terms
        freedom = max(1.0, len(y) - design.shape[1])
        # a value that never errs must not have all the say: a millionth of its spread is kept
        spread = ((y - y.mean(axis=0)) ** 2).sum(axis=0) / freedom
        variance = np.maximum(np.maximum((residual**2).sum(axis=0) / freedom, 1e-12 * spread), 1e-300)
        slope = terms[1:1 + d]
        weighed = slope / variance
        information = weighed @ slope.T
        # what a parameter does not move must not make the others' statistics infinite
        root = np.linalg.cholesky(information + (1e-9 * np.trace(information) + 1e-300) * np.eye(d))
        self.gain, self.centre = np.linalg.solve(root, weighed), terms[0]
        leverage = np.minimum((design * p.T).sum(axis=1), 1 - 1e-6)
        error = residual / (1 - leverage)[:, None]
        off = y - self.centre + p[0][:, None] * error
        shared = (error / variance * off).sum(axis=1)
        return off @ self.gain.T - np.linalg.solve(root, p[1:1 + d]).T * shared[:, None]

    def of(self, y: Array) -> Array:
        return (y - self.centre) @ self.gain.T


class Linear:
    """Two numbers per parameter: what linear models of the values and of their changes estimate."""
    is_scaled = True

    def __init__(self, problem: Problem) -> None:
        self.problem, self.values, self.changes = problem, _Estimate(), _Estimate()
        self.has_changes = len(problem.first) < len(problem.measured)  # else values and changes say the same

    def learn(self, v: Array, y: Array) -> Array:
        d, n = v.shape[1], len(v)
        spread = v.std(axis=0)
        w = (v - v.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
        products = [w[:, i] * w[:, j] for i in range(d) for j in range(i + 1)]
        columns = [np.ones(n), *w.T, *(products if n >= 10 * (1 + d + len(products)) else [])]
        design = np.stack(columns, axis=1)
        both = [self.values.learn(design, d, y.reshape(n, -1))]
        if self.has_changes:
            both.append(self.changes.learn(design, d, self.problem.changes(y).reshape(n, -1)))
        return np.concatenate(both, axis=1)

    def of(self, y: Array) -> Array:
        both = [self.values.of(y.reshape(len(y), -1))]
        if self.has_changes:
            both.append(self.changes.of(self.problem.changes(y).reshape(len(y), -1)))
        return np.concatenate(both, axis=1)


class Sequence:
    """What a recurrent network reads: changes and values, summed over blocks of all periods behind each other."""
    is_scaled = False
    LONGEST = 50  # steps

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        periods = len(problem.measured)
        self.steps = min(self.LONGEST, periods)
        self.first = -(-np.arange(self.steps) * periods // self.steps)
        inputs = np.add.reduceat(problem.inputs, self.first, axis=0) if problem.inputs.size else problem.inputs[:0]
        inputs = inputs.reshape(self.steps, -1) if inputs.size else np.zeros((self.steps, 0))
        self.inputs = (inputs - inputs.mean(axis=0)) / np.where(inputs.std(axis=0) > 0, inputs.std(axis=0), 1.0)

    def learn(self, v: Array, y: Array) -> Array:
        return self.of(y)

    def of(self, y: Array) -> Array:
        rows = np.concatenate([self.problem.changes(y), y], axis=2)
        return np.asarray(np.add.reduceat(rows, self.first, axis=1)).reshape(len(y), -1)


class Given:
    """Simulations are statistics already: one row of them each (methods/steps.py)."""
    is_scaled = False

    def __init__(self, problem: Problem) -> None:
        pass

    def learn(self, v: Array, y: Array) -> Array:
        return self.of(y)

    def of(self, y: Array) -> Array:
        return y[:, 0]


SUMMARIES: dict[str, Callable[[Problem], Summary]] = {"linear": Linear, "cross_correlation": CrossCorrelation,
                                                    "recurrent": Sequence, "given": Given}


def make_summary(name: str, problem: Problem) -> Summary:
    if name not in SUMMARIES:
        raise InferenceError(f"no summary is called {name}; choose one of {', '.join(SUMMARIES)}")
    return SUMMARIES[name](problem)
