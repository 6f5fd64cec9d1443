"""Problems whose posterior is known."""
import numpy as np

from tiller.labs import Prior, Problem


def problem_of(priors, measured, simulate, *, inputs=None, noise_sd=0.0, seed=1):
    """One piece that begins at zero, measured (periods) or (periods, ny); simulate(params (np), rng) -> the same."""
    rows = np.asarray(measured, float)
    rows = rows[:, None] if rows.ndim == 1 else rows
    names = ["position_m", "height_m"][:rows.shape[1]]

    def answer(params, starts, seeds):
        y = np.stack([simulate(p, np.random.default_rng(int(s))) for p, s in zip(params, seeds)])
        return y.reshape(len(y), *rows.shape), [""] * len(y)

    return Problem("box", priors, names, np.full(len(names), noise_sd), np.array([0]), np.zeros((1, len(names))),
                   np.zeros((len(rows), 0)) if inputs is None else inputs, rows, answer, seed)


class Drift:
    """y[k+1] = y[k] + a + b u[k] + w, w ~ N(0, step_sd^2): changes of the value are a linear regression on the input,
    so that normal priors of a and b have a normal posterior."""

    def __init__(self, seed, periods=60, step_sd=0.2):
        self.u, self.step_sd = 1 + np.sin(0.7 * np.arange(periods)), step_sd
        rng = np.random.default_rng([seed, 200])
        self.truth = rng.normal(size=2) * [1, 2] + [0, 0.5]
        self.problem = problem_of([Prior("push", "normal", 0.0, 1.0), Prior("gain", "normal", 0.5, 2.0)],
                                  self.run(self.truth, rng), self.run, inputs=self.u[:, None], seed=seed)

    def run(self, params, rng):
        steps = params[0] + params[1] * self.u + self.step_sd * rng.normal(size=len(self.u))
        return np.cumsum(steps)

    def exact(self):
        """Mean and covariance by the normal equations."""
        design = np.column_stack([np.ones_like(self.u), self.u])
        change = np.diff(self.problem.measured[:, 0], prepend=0)
        prior = np.diag([1, 0.25])
        covariance = np.linalg.inv(prior + design.T @ design / self.step_sd**2)
        return covariance @ (prior @ [0, 0.5] + design.T @ change / self.step_sd**2), covariance


def moments(result):
    mean = result.weight @ result.params
    off = result.params - mean
    return mean, off.T @ (result.weight[:, None] * off)


def divergence(mean, covariance, exact_mean, exact_covariance):
    """Kullback-Leibler divergence of two normals, nats."""
    inverse, off = np.linalg.inv(exact_covariance), np.asarray(exact_mean) - mean
    ratio = np.linalg.slogdet(exact_covariance)[1] - np.linalg.slogdet(covariance)[1]
    return 0.5 * (np.trace(inverse @ covariance) + off @ inverse @ off - len(off) + ratio)
