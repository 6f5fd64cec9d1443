"""Logs of a linear system for the methods of `tiller identify`: dx/dt = a u + b v, dy/dt = b u - a v. No state acts on
it."""
import numpy as np

from tiller.labs.methods.logs import Logs
from tiller.labs.methods.serve import METHODS
from tiller.labs.methods.settings import Settings
from tiller.labs.problem import Prior, Problem

DT, NOISE = 0.1, 0.7
NORMAL = [Prior("a", "normal", 0.5, 1.0), Prior("b", "normal", 0.5, 1.0)]


def problem_of(priors=NORMAL, seed=1, mixture=None):
    return Problem("logs", priors, [], np.zeros(0), np.array([0]), np.zeros((1, 0)), np.zeros((1, 0)), np.zeros((1, 1)),
                   lambda *_: None, seed, mixture)


def logs_of(state, inputs, steps=1, process_sd=NOISE, sensor_sd=0.0, angle=(False, False), wall=np.inf):
    """Logged states (points, 2) and inputs (points - 1, 2), cut to rollouts of so many periods (0: one). A candidate
    whose a is beyond the wall diverges."""
    state, inputs = np.asarray(state, float), np.asarray(inputs, float)
    begin = np.arange(len(inputs)) // (steps or len(inputs)) * (steps or len(inputs))
    rows = np.arange(len(inputs))

    def simulate(params):
        a, b = params[:, 0], params[:, 1]
        rate = np.stack([inputs[:, :1] * a + inputs[:, 1:] * b, inputs[:, :1] * b - inputs[:, 1:] * a], axis=1)
        way = np.concatenate([np.zeros((1, 2, len(params))), np.cumsum(DT * rate, axis=0)])
        states = state[begin][..., None] + way[rows + 1] - way[begin]
        return np.where(a > wall, np.nan, states)

    doubt = np.full((len(inputs), 2), sensor_sd)
    return Logs(begin, rows - begin + 1.0, inputs, state[begin], doubt, state[1:].copy(), doubt, np.array(angle),
                np.full(2, process_sd), DT, 64, simulate)


def linear_logs(seed, noise=NOISE, periods=40, truth=(0.9, -0.3), **more):
    rng = np.random.default_rng([seed, 300])
    inputs = np.repeat(rng.normal(size=(periods // 5 + 1, 2)), 5, axis=0)[:periods]
    inputs /= (inputs**2).mean() ** 0.5  # 40 periods leave a posterior about a quarter as wide as the prior
    a, b = truth
    rate = np.stack([a * inputs[:, 0] + b * inputs[:, 1], b * inputs[:, 0] - a * inputs[:, 1]], axis=1)
    change = DT * rate + noise * DT**0.5 * rng.normal(size=rate.shape)
    return logs_of(np.cumsum(np.concatenate([np.zeros((1, 2)), change]), axis=0), inputs, process_sd=noise, **more)


def exact(logs, eta=1.0):
    """Mean and covariance by the normal equations; the likelihood counts 1 / eta times."""
    variance = eta * (logs.process_sd[0] ** 2 * DT + 2 * logs.state_sd[0, 0] ** 2)
    u, v = logs.inputs.T
    design = DT * np.concatenate([np.stack([u, v], axis=1), np.stack([-v, u], axis=1)])
    change = (logs.state - logs.start).T.reshape(-1)
    covariance = np.linalg.inv(np.eye(2) + design.T @ design / variance)
    return covariance @ (np.full(2, 0.5) + design.T @ change / variance), covariance


def run(name, logs, problem=None, **settings):
    return METHODS[name](problem or problem_of(), logs, Settings(**settings))
