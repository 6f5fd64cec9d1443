"""The robot file's cost as a sum of terms, each with a coefficient, through the rollout kernel.

The cost is linear in its weights. A term is so the difference between two robots, of which one has a weight twice as
large. Changes of inputs are added here, S (u - u before)^2: a path begins with the change from the input that was in
force before it. Slopes are the kernel's; curvatures are central differences of these, with negative ones cut off.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .problem import Array, Motion, Numbers, Problem
from .robot_text import with_numbers, without

QUADRATIC = {"target", "state_weight", "terminal_weight", "bounds", "input_weight", "input_rate_weight"}


@dataclass(frozen=True, eq=False)
class Cost:
    """groups: what is kept, then a learnt term each, at weight one."""
    robots: tuple[Any, ...]  # without changes of inputs: the file's, then one with twice the weight of each term
    mix: Numbers             # (groups, robots)
    rate: Numbers            # (groups, nu) of changes of inputs
    params: Numbers          # (np) what the model knows
    convex: bool             # every term is a sum of squares

    @property
    def has_rates(self) -> bool:
        return bool((self.rate > 0).any())


def is_convex(text: str) -> bool:
    import tomlkit

    return set(tomlkit.parse(text).get("cost", {})) <= QUADRATIC


def make_cost(problem: Problem, learnt: dict[str, float]) -> Cost:
    """Groups of the robot file's cost: `learnt` are the paths of weights with their values."""
    import tiller

    bare = without(problem.text, "cost.input_rate_weight")
    kernel = {path: value for path, value in learnt.items() if ".input_rate_weight." not in path}
    texts = [bare] + [with_numbers(bare, {path: 2 * value}) for path, value in kernel.items()]
    robots = tuple(tiller.Robot.from_text(text, problem.path) for text in texts)
    mix, rate = np.zeros((1 + len(learnt), len(robots))), np.zeros((1 + len(learnt), len(problem.inputs)))
    mix[0, 0], rate[0] = 1.0, problem.rate_weight
    for group, (path, value) in enumerate(learnt.items(), 1):
        if path in kernel:
            at = 1 + list(kernel).index(path)
            mix[group, [0, at]] = -1 / value, 1 / value
            mix[0, [0, at]] += 1, -1
        else:
            at = problem.inputs.index(path.rsplit(".", 1)[1])
            rate[group, at], rate[0, at] = 1.0, 0.0
    return Cost(robots, mix, rate, np.asarray(robots[0].prior_centre), is_convex(problem.text))


def whole_cost(problem: Problem, text: str, rate_weight: Numbers) -> Cost:
    """The cost of a text as one group."""
    import tiller

    robot = tiller.Robot.from_text(without(text, "cost.input_rate_weight"), problem.path)
    return Cost((robot,), np.ones((1, 1)), rate_weight[None], np.asarray(robot.prior_centre), is_convex(text))


def _changes(rate: Array, before: Array, inputs: Array) -> Array:
    steps = jnp.diff(jnp.concatenate([jnp.broadcast_to(before, inputs[..., :1, :].shape), inputs], -2), axis=-2)
    return jnp.einsum("gi,...ki->g...", rate, steps**2)


def rollout_features(cost: Cost, start: Array, inputs: Array, before: Array) -> Array:
    """(groups, ..) of rollouts from start (.., nx) under inputs (.., T, nu)."""
    import tiller.jax

    values = jnp.stack([tiller.jax.cost(robot, start, inputs, cost.params, threads=1) for robot in cost.robots])
    return jnp.einsum("gb,b...->g...", cost.mix, values) + _changes(jnp.asarray(cost.rate), before, inputs)


def motion_features(cost: Cost, motion: Motion) -> Numbers:
    """(groups) of a motion whose states are not quite the model's. What the last state costs as the end of a horizon
    is taken where the model goes from the last but one."""
    import tiller.jax

    last = motion.steps - 1
    values = np.array([
        sum(robot.stage_cost(motion.states[k], motion.inputs[k], k) for k in range(last))
        + float(tiller.jax.cost(robot, jnp.asarray(motion.states[last]), jnp.asarray(motion.inputs[last:]),
                                cost.params, threads=1)) for robot in cost.robots])
    changes = _changes(jnp.asarray(cost.rate), jnp.asarray(motion.inputs[0]), jnp.asarray(motion.inputs))
    return cost.mix @ values + np.asarray(changes)


def _slopes(cost: Cost, states: Array, inputs: Array) -> tuple[Array, Array]:
    """(robots, .., T + 1, nx) and (robots, .., T, nu); leading dimensions of length one stand for the others'."""
    from ... import _core
    from ...jax._primitives import cost_slopes_p

    params = jnp.asarray(cost.params).reshape((1,) * (states.ndim - 2) + (-1,))
    rows = [cost_slopes_p.bind(states, inputs, params, robot=_core.jax_number(robot), threads=1)[:2]
            for robot in cost.robots]
    return jnp.stack([r[0] for r in rows]), jnp.stack([r[1] for r in rows])


def _shifts(values: Array) -> tuple[Array, Array]:
    """(2 n, .., n) values shifted up and then down by each component, and the steps (n)."""
    n = values.shape[-1]
    step = 1e-4 * jnp.maximum(1e-2, jnp.abs(values).reshape(-1, n).max(0))
    moves = jnp.diag(step).reshape(n, *(1,) * (values.ndim - 1), n)
    return jnp.concatenate([values + moves, values - moves]), step


def _differences(values: Array, step: Array, axis: int) -> Array:
    """From what was found at _shifts()."""
    n = step.shape[0]
    up, down = jnp.split(jnp.moveaxis(values, axis, 0), 2)
    return (up - down) / (2 * step.reshape(n, *(1,) * (up.ndim - 1)))


def _convex(hessian: Array) -> Array:
    value, vector = jnp.linalg.eigh(hessian)
    return jnp.einsum("...ik,...k,...jk->...ij", vector, jnp.maximum(value, 0.0), vector)


def _settled(mix: Array, values: Array) -> Array:
    """Groups from robots; what is left of a difference by rounding is zero."""
    out = jnp.einsum("gb,b...->g...", mix, values)
    size = jnp.einsum("gb,b...->g...", jnp.abs(mix), jnp.abs(values))
    return jnp.where(jnp.abs(out) < 1e-9 * size, 0.0, out)


def stages(cost: Cost, states: Array, inputs: Array) -> tuple[Array, Array]:
    """Gradient (groups, T, nx + nu) and Hessian by states and inputs, of stages without changes of inputs."""
    mix = jnp.asarray(cost.mix)
    by_x, by_u = _slopes(cost, states, inputs)
    gradient = _settled(mix, jnp.concatenate([by_x[..., :-1, :], by_u], -1))
    x_shifted, x_step = _shifts(states)
    u_shifted, u_step = _shifts(inputs)
    of_x = _slopes(cost, x_shifted, inputs[None])
    of_u = _slopes(cost, states[None], u_shifted)
    rows = [_differences(jnp.concatenate([s[0][..., :-1, :], s[1]], -1), step, 1)
            for s, step in ((of_x, x_step), (of_u, u_step))]
    hessian = _settled(mix, jnp.moveaxis(jnp.concatenate(rows), 0, -2))
    hessian = 0.5 * (hessian + jnp.swapaxes(hessian, -1, -2))
    return gradient, hessian if cost.convex else _convex(hessian)


def ends(cost: Cost, states: Array) -> tuple[Array, Array]:
    """Gradient (groups, points, nx) and Hessian of each state as the end of a horizon."""
    mix = jnp.asarray(cost.mix)
    pairs = jnp.stack([states, states], -2)
    still = jnp.zeros((1, 1, cost.rate.shape[-1]))

    def last(paths: Array) -> Array:
        return _slopes(cost, paths, still.reshape((1,) * (paths.ndim - 3) + still.shape))[0][..., 1, :]

    shifted, step = _shifts(pairs)
    hessian = _settled(mix, jnp.moveaxis(_differences(last(shifted), step, 1), 0, -2))
    hessian = 0.5 * (hessian + jnp.swapaxes(hessian, -1, -2))
    return _settled(mix, last(pairs)), hessian if cost.convex else _convex(hessian)


def one_group(cost: Cost, coefficient: Sequence[float]) -> Cost:
    """The same cost with its groups added up."""
    c = np.asarray(coefficient, float)
    return Cost(cost.robots, (c @ cost.mix)[None], (c @ cost.rate)[None], cost.params, cost.convex)
