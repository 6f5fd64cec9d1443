"""What a network is taught along its own passage, where no law was fitted: iLQR from there on."""
from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .guide import Goal, Guide, Motions, random_commands, unlimited
from .minimise import Numbers
from .physics import Family
from .student import Student
from .task import Task, features

SWEEPS = 20
STARTS, EVERY = 12, 5  # passages, and periods between the states of them that are planned from
KEPT = 5  # periods of a plan that are taught
NEAR, SHARED, LIBRARY = 8, 3, 384  # plans from near states, how many of those are followed, plans that are kept
BESIDE = 3  # states drawn beside each of those, by the plan's gain


class Taught(NamedTuple):
    """Rows of states and the commands wanted there."""
    x: Numbers  # (n, nx)
    u: Numbers  # (n, nu)

    @classmethod
    def joined(cls, parts: list[Taught]) -> Taught:
        return cls(*map(np.concatenate, zip(*parts, strict=True)))


class Teacher:
    """DAgger (Ross, Gordon, Bagnell, AISTATS 2011) whose expert plans on the model as it is known (as the MPC of Zhang,
    Kahn, Levine, Abbeel, ICRA 2016): a horizon as long as the task's from any state, so that what it wants there does
    not depend on the time."""

    def __init__(self, task: Task, goal: Goal, family: Family, guide: Guide, noise_sd: Numbers) -> None:
        self._task, self._goal, self._guide, self._noise_sd = task, goal, guide, noise_sd
        self._follow: Any = None
        self._library: Motions | None = None  # the last plans
        self._physics = family.physics

    def passages(self, student: Student, params: Any, rng: np.random.Generator) -> tuple[Numbers, Numbers]:
        """States (STARTS, T + 1, nx) and commands of the network on the model, from the task's starts and its own
        measurements."""
        task = self._task
        if self._follow is None:
            def follow(params: Any, arrays: Any, scale: Any, start: Any, noise: Any) -> Any:
                step = jax.vmap(self._physics(params))

                def period(x: Any, off: Any) -> Any:
                    u = jnp.clip(student.answers(arrays, scale, x + off), task.low, task.high)
                    return step(jnp.concatenate([x, u], 1))[0], (x, u)

                last, (x, u) = jax.lax.scan(period, start, noise)
                return jnp.concatenate([x, last[None]]).swapaxes(0, 1), u.swapaxes(0, 1)
            self._follow = jax.jit(follow)
        start = rng.multivariate_normal(task.start_mean, task.start_covariance, STARTS)
        noise = self._noise_sd * rng.standard_normal((task.horizon, STARTS, task.nx))
        x, u = self._follow(params, student.arrays, student.scale, start, noise)
        return np.asarray(x), np.asarray(u)

    def lesson(self, x: Numbers, u: Numbers, known: Motions, params: Any, rng: np.random.Generator) -> Taught:
        """Of passages x (n, T + 1, nx) under u: from some of their states on the cheapest of what guesses come to, the
        passage's own commands, the nearest of known motions followed, and random ones; then of what the cheapest plans
        from near states come to when they are followed from there. Without the latter two states beside each other are
        taught the opposite, each by an optimum of its own."""
        horizon, goal = self._task.horizon, self._goal
        first = rng.integers(EVERY)
        at = [(i, k) for i in np.flatnonzero(np.isfinite(x).all((1, 2))) for k in range(first, horizon, EVERY)]
        if not at:
            return Taught(np.empty((0, x.shape[2])), np.empty((0, u.shape[2])))
        starts = np.array([x[i, k] for i, k in at])
        own = [u[i, np.minimum(k + np.arange(horizon), horizon - 1)] for i, k in at]
        random = random_commands(goal, len(at), horizon, rng)[rng.permutation(len(at))]
        guesses = np.stack([own, self._nearest(starts, known, params), random], 1)
        plans = self._guide.motions(params, goal, starts, guesses, SWEEPS)
        plans = self._shared(plans, params)
        self._library = Motions.joined([*([self._library] if self._library else []), plans]).of(slice(-LIBRARY, None))
        return self._beside(plans, self._guide.gains(params, goal, plans), rng)

    def _seen(self, x: Numbers) -> Numbers:
        return np.asarray(features(self._task.angles, x))[..., self._task.seen]

    def _nearest(self, starts: Numbers, known: Motions, params: Any) -> Numbers:
        """Commands (n, T, nu) that follow the known motions from where they are nearest on, in deviations of the
        features."""
        count, rows, nx = known.x.shape
        places = self._seen(known.x.reshape(-1, nx))
        which, k = np.divmod(_gap(self._seen(starts), places).argmin(1), rows)
        later = np.minimum(k[:, None] + np.arange(rows), rows - 1)
        then, at = np.minimum(later[:, :-1], rows - 2), which[:, None]
        gains = self._guide.gains(params, unlimited(self._goal), known)
        rest = Motions(known.x[at, later], known.u[at, then], known.cost[which])
        return self._guide.tracked(params, self._goal, starts, rest, gains[at, then])

    def _shared(self, plans: Motions, params: Any) -> Motions:
        """Each plan, or a cheaper one by way of the cheapest from near states, of these plans and earlier ones."""
        all_ = Motions.joined([*([self._library] if self._library else []), plans])
        starts, n = plans.x[:, 0], len(plans.u)
        near = np.argsort(_gap(self._seen(starts), self._seen(all_.x[:, 0])), 1)[:, 1:1 + NEAR]
        which = np.take_along_axis(near, np.argsort(all_.cost[near], 1)[:, :SHARED], 1).ravel()
        gains = self._guide.gains(params, unlimited(self._goal), all_)
        wide = np.repeat(starts, SHARED, 0)
        guesses = self._guide.tracked(params, self._goal, wide, all_.of(which), gains[which])
        others = self._guide.motions(params, self._goal, starts, guesses.reshape(n, SHARED, *guesses.shape[1:]), SWEEPS)
        both = Motions.joined([plans, others])
        return both.of(np.arange(n) + n * (others.cost < plans.cost))

    def _beside(self, plans: Motions, gains: Numbers, rng: np.random.Generator) -> Taught:
        """The plans' first periods, and states beside them with the gains' commands."""
        x, u, gains = plans.x[:, :KEPT], plans.u[:, :KEPT], gains[:, :KEPT]
        spread = 3 * self._noise_sd + 0.02 * plans.x.std((0, 1))
        off = spread * rng.standard_normal((BESIDE, *x.shape))
        more = np.einsum("pkij,bpkj->bpki", gains, off) + u
        nx, nu = x.shape[-1], u.shape[-1]
        wanted = np.concatenate([u.reshape(-1, nu), more.reshape(-1, nu)])
        return Taught(np.concatenate([x.reshape(-1, nx), (x + off).reshape(-1, nx)]),
                      np.clip(wanted, self._goal.low, self._goal.high))


def _gap(here: Numbers, places: Numbers) -> Numbers:
    """(n, m) squared distances in deviations of the places."""
    sd = np.maximum(1e-9, places.std(0))
    return (((here[:, None] - places) / sd)**2).sum(-1)
