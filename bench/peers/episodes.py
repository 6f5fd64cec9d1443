"""The tasks of bench_accuracy (accuracy_tasks.cpp) once more in numpy, for peers: models, priors, excitation,
likelihood.

Written from the equations, not from the kernels: what both agree on is checked against exported episodes (`check`).
Shapes: state (nx, n), parameters (d, n), input (n); n systems side by side.
"""

import csv
import dataclasses
import pathlib

import numpy as np

PERIOD = 0.02
TICKS = 400
NOMINAL_SIGMA = 0.03
SHAPE = 0.5  # a0 of the inverse gamma over each state's noise variance
GRAVITY = 9.81


def pendulum(x, u, p):
    mass, length = p
    inertia = mass * length * length
    return ((u - 0.02 * x[1] - mass * GRAVITY * length * np.sin(x[0])) / inertia,)


def cart_pole(x, u, p):
    pole, half = p
    s, c = np.sin(x[1]), np.cos(x[1])
    moment, inertia = pole * half, 4.0 / 3.0 * pole * half * half
    coupling = moment * c
    push, turn = u + moment * s * x[3] ** 2, moment * GRAVITY * s
    whole = 1.0 + pole
    det = whole * inertia - coupling**2
    return (inertia * push - coupling * turn) / det, (whole * turn - coupling * push) / det


def acrobot(x, u, p):
    """Two uniform rods; p: their masses, then (where given) their lengths."""
    m1, m2 = p[0], p[1]
    l1, l2 = (p[2], p[3]) if len(p) == 4 else (1.0, 1.0)
    j1, j2 = m1 * l1 * l1 / 3.0 + m2 * l1 * l1, m2 * l2 * l2 / 3.0
    h = l1 * m2 * l2 / 2.0
    c2, s2 = np.cos(x[1]), np.sin(x[1])
    m11, m12 = j1 + j2 + 2.0 * h * c2, j2 + h * c2
    lower = m2 * l2 / 2.0 * GRAVITY * np.sin(x[0] + x[1])
    upper = (m1 * l1 / 2.0 + m2 * l1) * GRAVITY * np.sin(x[0])
    turn1 = -upper - lower + h * s2 * x[3] * (2.0 * x[2] + x[3])
    turn2 = u - lower - h * s2 * x[2] ** 2
    det = m11 * j2 - m12**2
    return (j2 * turn1 - m12 * turn2) / det, (m11 * turn2 - m12 * turn1) / det


@dataclasses.dataclass(frozen=True)
class Task:
    name: str
    accelerations: object
    parameters: tuple
    low: tuple
    high: tuple
    step_rms: tuple
    start: tuple
    amplitude: float
    limit: float
    feedback: tuple
    hold: int = 8

    @property
    def states(self):
        return len(self.start)

    def change(self, x, u, p):
        """What a period changes, semi-implicit Euler: (nx, n). Not f(x) - x, which would cancel."""
        half = self.states // 2
        rates = [PERIOD * a for a in self.accelerations(x, u, p)]
        return np.stack([PERIOD * (x[half + i] + rates[i]) + np.zeros_like(rates[i]) for i in range(half)] + rates)


TASKS = {t.name: t for t in [
    Task("cart-pole", cart_pole, ("pole_mass_kg", "half_length_m"), (0.1, 0.1), (1.0, 1.0),
         (0.022, 0.074, 0.122, 0.367), (0.0, np.pi, 0.0, 0.0), 12.0, 20.0, (4.0, 0.0, 2.0, 0.0)),
    Task("pendulum", pendulum, ("mass_kg", "length_m"), (0.1, 0.1), (1.0, 1.0), (0.071, 0.48), (2.5, 0.0), 1.0, 2.0,
         (0.0, 0.05)),
    Task("acrobot masses", acrobot, ("upper_mass_kg", "lower_mass_kg"), (0.5, 0.5), (2.0, 2.0),
         (0.022, 0.067, 0.208, 0.657), (0.0, 0.0, 0.0, 0.0), 6.0, 10.0, (0.0, 0.0, 0.0, 0.5)),
]}


@dataclasses.dataclass
class Episode:
    task: Task
    sigma: float
    seed: int
    truth: np.ndarray  # (d)
    state: np.ndarray  # (ticks + 1, nx)
    input: np.ndarray  # (ticks)
    exact: dict = None  # mean, covariance, log_density of the exact posterior, where known


def draw_prior(task, n, rng):
    low, high = np.array(task.low), np.array(task.high)
    return low + (high - low) * rng.random((n, len(low)))


def simulate(task, sigma, parameters, rng, ticks=TICKS):
    """Episodes of `parameters` (n, d): states (n, ticks + 1, nx) and inputs (n, ticks)."""
    n, p = len(parameters), parameters.T
    sd = (sigma * np.array(task.step_rms))[:, None]
    state, inputs = np.empty((n, ticks + 1, task.states)), np.empty((n, ticks))
    x = np.repeat(np.array(task.start)[:, None], n, axis=1)
    feedback = np.array(task.feedback)
    state[:, 0] = x.T
    for k in range(ticks):
        if k % task.hold == 0:
            push = task.amplitude * rng.uniform(-1, 1, n)
        inputs[:, k] = u = np.clip(push - feedback @ x, -task.limit, task.limit)
        x = x + task.change(x, u, p) + sd * rng.standard_normal(x.shape)
        # systems that left all bounds are kept finite: a summary of them must be a number
        x = np.clip(x, -1e4, 1e4)
        state[:, k + 1] = x.T
    return state, inputs


def squared_residuals(episode, parameters):
    """(nx, n): sums of squared one-step residuals over the episode, for parameters (n, d)."""
    task = episode.task
    x, u = episode.state[:-1].T[:, :, None], episode.input[:, None]  # (nx, ticks, 1)
    change = np.diff(episode.state, axis=0).T[:, :, None]
    p = parameters.T[:, None, :]
    return np.square(change - task.change(x, u, p)).sum(axis=1)


def log_posterior(episode, parameters):
    """(n) up to a constant: noise variances integrated out under InvGamma(a0, a0 q^2 dt), q nominal; uniform prior."""
    task = episode.task
    parameters = np.atleast_2d(parameters)
    inside = np.all((parameters > task.low) & (parameters < task.high), axis=1)
    out = np.full(len(parameters), -np.inf)
    if inside.any():
        s = squared_residuals(episode, parameters[inside])
        scale = SHAPE * (NOMINAL_SIGMA * np.array(task.step_rms))[:, None] ** 2
        out[inside] = -(SHAPE + 0.5 * len(episode.input)) * np.log(scale + 0.5 * s).sum(axis=0)
    return out


def _numbers(text):
    return np.array([float(v) for v in text.split()])


def check(episode):
    """None, or why an episode is not of the task that stands here."""
    task = episode.task
    if not np.allclose(episode.state[0], task.start):
        return f"{task.name}: it does not begin at {task.start}"
    free = np.abs(episode.input) < task.limit * (1 - 1e-9)
    push = episode.input + episode.state[:-1] @ np.array(task.feedback)
    held = push[: TICKS // task.hold * task.hold].reshape(-1, task.hold)
    clipped = ~free[: held.size].reshape(-1, task.hold)
    held = np.where(clipped, np.nan, held)
    if np.nanmax(np.nanmax(held, 1) - np.nanmin(held, 1)) > 1e-6 or np.nanmax(np.abs(held)) > task.amplitude + 1e-6:
        return f"{task.name}: its inputs are not the excitation that stands here"
    s = squared_residuals(episode, episode.truth[None])[:, 0]
    ratio = np.sqrt(s / len(episode.input)) / (episode.sigma * np.array(task.step_rms))
    if np.any(np.abs(ratio - 1) > 0.25):
        return f"{task.name}: residuals at the truth are {ratio} times the noise"
    return None


def read(folder):
    """Episodes that `bench_accuracy --export` wrote, of the tasks that stand here; raises where they differ."""
    folder = pathlib.Path(folder)
    episodes = []
    with open(folder / "episodes.csv", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            task = TASKS.get(row["task"])
            if task is None:
                continue
            if tuple(row["parameters"].split()) != task.parameters or not np.allclose(
                    [_numbers(row["low"]), _numbers(row["high"])], [task.low, task.high]):
                raise ValueError(f"{task.name}: parameters or prior are not those that stand here")
            table = np.genfromtxt(folder / row["file"], delimiter=",", skip_header=1)
            truth = _numbers(row["truth"])
            exact = {"mean": _numbers(row["mean"]), "covariance": _numbers(row["covariance"]).reshape(len(truth), -1),
                     "log_density": float(row["exact_log_density"])}
            episode = Episode(task, float(row["sigma"]), int(row["seed"]), truth, table[:, : task.states],
                              table[:-1, task.states], exact)
            if (problem := check(episode)) is not None:
                raise ValueError(problem)
            episodes.append(episode)
    return episodes


def make(task, sigma, seed):
    """An episode of this file's own."""
    rng = np.random.default_rng(seed)
    truth = draw_prior(task, 1, rng)
    state, inputs = simulate(task, sigma, truth, rng)
    return Episode(task, sigma, seed, truth[0], state[0], inputs[0])


def exact_on_grid(episode, side=401, rounds=4):
    """Mean, covariance and points of the posterior over two parameters, on a grid that zooms in."""
    low, high = np.array(episode.task.low), np.array(episode.task.high)
    for number in range(rounds):
        axes = [np.linspace(l, h, (side if number == rounds - 1 else 101) + 2)[1:-1] for l, h in zip(low, high)]
        grid = np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], axis=1)
        value = np.concatenate([log_posterior(episode, part) for part in np.array_split(grid, 1 + len(grid) // 2000)])
        weight = np.exp(value - value.max())
        weight /= weight.sum()
        mean = weight @ grid
        covariance = (grid - mean).T @ ((grid - mean) * weight[:, None])
        step = np.array([a[1] - a[0] for a in axes])
        reach = 7 * np.sqrt(np.diag(covariance)) + 2 * step
        low, high = np.maximum(low, mean - reach), np.minimum(high, mean + reach)
    return {"mean": mean, "covariance": covariance, "grid": grid, "weight": weight, "cell": float(np.prod(step))}
