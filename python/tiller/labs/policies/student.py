"""The network that guided search teaches: a tanh perceptron fitted to commands, each weighed by a precision."""
from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

from ..distill.network import Perceptron
from .minimise import Numbers
from .task import Task, features

RATE, LAST_RATE = 1e-2, 0.02
CUT = 10.0  # a sample counts at most so many times as much as the median one, and at least its inverse


class Student:
    """Answers middle + half range times its output; the runtime cuts the output to [-1, 1]."""

    def __init__(self, task: Task, hidden: list[int], seed: int) -> None:
        self._task, self._hidden = task, hidden
        self._arrays, static = eqx.partition(Perceptron([len(task.seen), *hidden, task.nu], jax.random.key(seed)),
                                             eqx.is_array)
        self._scale: tuple[Numbers, Numbers] | None = None
        self._middle, self._half = 0.5 * (task.low + task.high), 0.5 * (task.high - task.low)
        many = lambda arrays, z: jax.vmap(eqx.combine(arrays, static))(z)

        def train(arrays: Any, x: Any, y: Any, precision: Any, steps: int) -> Any:
            adam = optax.adam(optax.cosine_decay_schedule(RATE, steps, LAST_RATE))

            def loss(arrays: Any) -> Any:
                off = many(arrays, x) - y
                return jnp.einsum("ni,nij,nj->n", off, precision, off).mean()

            def step(carry: Any, _: None) -> Any:
                arrays, state = carry
                change, state = adam.update(jax.grad(loss)(arrays), state)
                return (optax.apply_updates(arrays, change), state), None
            return jax.lax.scan(step, (arrays, adam.init(arrays)), None, steps)[0][0]

        self._answer, self._train = jax.jit(many), jax.jit(train, static_argnames="steps")

    def _seen(self, x: Numbers) -> Numbers:
        assert self._scale is not None
        f = np.asarray(features(self._task.angles, x))[..., self._task.seen]
        return (f - self._scale[0]) / self._scale[1]

    def raw(self, x: Numbers) -> Numbers:
        """Commands (n, nu) at states (n, nx), not cut."""
        share: Numbers = np.asarray(self._answer(self._arrays, self._seen(x)))
        return self._middle + self._half * share

    def command(self, x: Numbers, k: int = 0) -> Numbers:
        return np.clip(self.raw(x[None])[0], self._task.low, self._task.high)

    def fit(self, x: Numbers, wanted: Numbers, precision: Numbers, steps: int) -> None:
        """Adam from the present weights on, on all samples: (n, nx) states, (n, nu) commands, (n, nu, nu)."""
        if self._scale is None:
            f = np.asarray(features(self._task.angles, x))[..., self._task.seen]
            self._scale = f.mean(0), np.where(f.std(0) > 1e-9, f.std(0), 1.0)
        p = self._half[:, None] * precision * self._half
        size = np.trace(p, axis1=1, axis2=2)
        share = np.clip(size / np.median(size), 1 / CUT, CUT) / size
        y = (np.clip(wanted, self._task.low, self._task.high) - self._middle) / self._half
        self._arrays = self._train(self._arrays, self._seen(x), y, p * share[:, None, None], steps=steps)

    def network(self) -> dict[str, Any]:
        """As the policy file has it: scales are part of the weights."""
        assert self._scale is not None
        numbers: list[float] = []
        for i, layer in enumerate(self._arrays.layers):
            w, b = np.array(layer.weight, float), np.array(layer.bias, float)
            if i == 0:
                w = w / self._scale[1]
                b = b - w @ self._scale[0]
            numbers += np.column_stack([b, w]).ravel().tolist()
        return {"kind": "tanh", "hidden": (self._hidden + [0])[:2], "weights": numbers}
