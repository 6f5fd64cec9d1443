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

RATE, LAST_RATE, BATCH = 1e-2, 0.02, 256
BUCKET = 8192  # samples are filled up to a multiple: few shapes to compile for
CUT = 10.0  # a sample counts at most so many times as much as the median one, and at least its inverse


class Student:
    """Answers middle + half range times its output; the runtime cuts the output to [-1, 1]."""

    def __init__(self, task: Task, hidden: list[int], seed: int) -> None:
        self._task, self._hidden, self._fits = task, hidden, seed
        self.arrays, static = eqx.partition(Perceptron([len(task.seen), *hidden, task.nu], jax.random.key(seed)),
                                            eqx.is_array)
        self.scale: tuple[Numbers, Numbers] | None = None
        self._middle, self._half = 0.5 * (task.low + task.high), 0.5 * (task.high - task.low)
        many = lambda arrays, z: jax.vmap(eqx.combine(arrays, static))(z)

        def train(arrays: Any, x: Any, y: Any, precision: Any, count: Any, key: Any, steps: int) -> Any:
            adam = optax.adam(optax.cosine_decay_schedule(RATE, steps, LAST_RATE))

            def loss(arrays: Any, at: Any) -> Any:
                answer = many(arrays, x[at])
                beyond = (jnp.abs(y[at]) >= 1) & (answer * y[at] > 1)  # of a limit that is wanted: no matter how far
                off = jnp.where(beyond, 0, answer - y[at])
                return jnp.einsum("ni,nij,nj->n", off, precision[at], off).mean()

            def step(carry: Any, key: Any) -> Any:
                arrays, state = carry
                at = jax.random.randint(key, (BATCH,), 0, count)
                change, state = adam.update(jax.grad(loss)(arrays, at), state)
                return (optax.apply_updates(arrays, change), state), None
            return jax.lax.scan(step, (arrays, adam.init(arrays)), jax.random.split(key, steps))[0][0]

        self._answer, self._train = many, jax.jit(train, static_argnames="steps")
        self._answered = jax.jit(self.answers)

    def answers(self, arrays: Any, scale: Any, x: Any) -> Any:
        """Commands (n, nu) at states (n, nx), not cut; for JAX, of any weights."""
        f = features(self._task.angles, x)[..., np.array(self._task.seen)]
        return self._middle + self._half * self._answer(arrays, (f - scale[0]) / scale[1])

    def raw(self, x: Numbers) -> Numbers:
        """Commands (n, nu) at states (n, nx), not cut."""
        return np.asarray(self._answered(self.arrays, self.scale, x))

    def command(self, x: Numbers, k: int = 0) -> Numbers:
        return np.clip(self.raw(x[None])[0], self._task.low, self._task.high)

    def fit(self, x: Numbers, wanted: Numbers, precision: Numbers, steps: int) -> None:
        """Adam from the present weights on: (n, nx) states, (n, nu) commands, (n, nu, nu)."""
        f = np.asarray(features(self._task.angles, x))[..., self._task.seen]
        if self.scale is None:
            self.scale = f.mean(0), np.where(f.std(0) > 1e-9, f.std(0), 1.0)
        p = self._half[:, None] * precision * self._half
        size = np.trace(p, axis1=1, axis2=2)
        share = np.clip(size / np.median(size), 1 / CUT, CUT) / size
        y = (np.clip(wanted, self._task.low, self._task.high) - self._middle) / self._half
        room = -(-len(x) // BUCKET) * BUCKET
        wide = lambda a: jnp.asarray(np.concatenate([a, np.zeros((room - len(a), *a.shape[1:]))]))
        self._fits += 1
        self.arrays = self._train(self.arrays, wide((f - self.scale[0]) / self.scale[1]), wide(y),
                                  wide(p * share[:, None, None]), len(x), jax.random.key(self._fits), steps=steps)

    def network(self) -> dict[str, Any]:
        """As the policy file has it: scales are part of the weights."""
        assert self.scale is not None
        numbers: list[float] = []
        for i, layer in enumerate(self.arrays.layers):
            w, b = np.array(layer.weight, float), np.array(layer.bias, float)
            if i == 0:
                w = w / self.scale[1]
                b = b - w @ self.scale[0]
            numbers += np.column_stack([b, w]).ravel().tolist()
        return {"kind": "tanh", "hidden": (self._hidden + [0])[:2], "weights": numbers}
