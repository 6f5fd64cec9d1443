"""A tanh perceptron that answers for the teacher: its fit, and the runtime's file of it."""
from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

from ... import _core
from .belief import Array
from .episode import Samples

BATCH, EPOCHS, PATIENCE, RATE, LAST_RATE = 256, 60, 15, 2e-3, 0.05
CORNER = 0.2  # of Huber's loss
JITTERS = (0.0, 0.3, 1.0)  # of what is believed, in its deviations: episodes are few draws of it to learn by heart
HELD_OUT_OF = 10  # one episode in so many is held out
READABLE = ("state", "goal", "belief_mean", "belief_spread", "last_command")


class Errors(NamedTuple):
    """Root mean square of answers cut to the limits, in shares of half the range; held_out: NaN without episodes."""
    trained: float
    held_out: float
    epochs: int  # of the weights that are kept


class Perceptron(eqx.Module):
    layers: list[eqx.nn.Linear]

    def __init__(self, widths: list[int], key: Any) -> None:
        keys = jax.random.split(key, len(widths) - 1)
        self.layers = [eqx.nn.Linear(a, b, key=k) for a, b, k in zip(widths, widths[1:], keys, strict=False)]

    def __call__(self, x: Any) -> Any:
        for layer in self.layers[:-1]:
            x = jnp.tanh(layer(x))
        return self.layers[-1](x)


def loss(network: Any, x: Any, y: Any, weight: Any) -> Any:
    """Huber's: where the teacher goes either way the answer is one way, not the mean of both. None beyond a limit that
    the teacher is at."""
    answer = jax.vmap(network)(x)
    beyond = (jnp.abs(y) >= 1) & (answer * y > 1)
    return (weight[:, None] * jnp.where(beyond, 0, optax.huber_loss(answer, y, delta=CORNER))).mean()


def _rms(network: Any, x: Any, y: Any) -> Any:
    return jnp.sqrt(((jnp.clip(jax.vmap(network)(x), -1, 1) - y) ** 2).mean())


class Student:
    def __init__(self, inputs: list[str], outputs: list[str], hidden: list[int], seed: int) -> None:
        self.inputs, self.outputs, self.hidden = inputs, outputs, hidden
        self._network = Perceptron([len(inputs), *hidden, len(outputs)], jax.random.key(seed))
        self._scale: tuple[Array, Array] | None = None
        self._low = self._high = np.zeros(0)

    def fit(self, samples: Samples, seed: int, epochs: int = EPOCHS, power: float = 0.0) -> Errors:
        """Adam on all samples from the present weights on, with each jitter of what is believed; the weights of the
        least held-out loss are kept. Noise on an input is a penalty on slopes by it (Bishop, Neural Computation 1995).
        A sample counts with its cost to go to this power."""
        read, y = np.array(samples.read), jnp.asarray(np.array(samples.share), jnp.float32)
        self._scale = self._scale or _scale(read)
        x = jnp.asarray((read - self._scale[0]) / self._scale[1], jnp.float32)
        self._low, self._high = read.min(0), read.max(0)
        self._low[[name.startswith("sd ") for name in self.inputs]] = 0  # a posterior may know better than any shown
        weight = np.maximum(np.array(samples.to_go), 1e-12) ** power
        weight = jnp.asarray(np.clip(weight / weight.mean(), 0.1, 10), jnp.float32)
        held = np.array(samples.episode) % HELD_OUT_OF == HELD_OUT_OF - 1
        rows, kept = np.flatnonzero(~held), np.flatnonzero(held)
        believed = jnp.array([name.startswith(("mean ", "sd ")) for name in self.inputs], jnp.float32)
        jitters = JITTERS if len(kept) and believed.any() else JITTERS[:1]
        tries = [_train(self._network, (x, y, weight), rows, kept, seed, epochs, j * believed) for j in jitters]
        _, self._network, errors = min(tries, key=lambda tried: tried[0])
        return errors

    def rms(self, samples: Samples) -> float:
        """Root mean square of the answers' errors, in shares of half the range."""
        assert self._scale is not None
        x = jnp.asarray((np.array(samples.read) - self._scale[0]) / self._scale[1], jnp.float32)
        return float(_rms(self._network, x, jnp.asarray(np.array(samples.share), jnp.float32)))

    def document(self, reads: int) -> dict[str, Any]:
        """The policy file: scales are part of the weights, and the ranges of training stand beside them."""
        assert self._scale is not None
        mean, sd = self._scale
        numbers: list[float] = []
        for i, layer in enumerate(self._network.layers):
            w, b = np.array(layer.weight, float), np.array(layer.bias, float)
            if i == 0:
                w = w / sd
                b = b - w @ mean
            numbers += np.column_stack([b, w]).ravel().tolist()
        network = {"kind": "tanh", "inputs": self.inputs, "outputs": self.outputs, "members": 1,
                   "hidden": (self.hidden + [0])[:2], "weights": _singles(numbers)}
        return {"format": "tiller policy", "version": 1,
                "reads": [name for i, name in enumerate(READABLE) if reads >> i & 1], "squash": "cut",
                "input_low": _singles(self._low), "input_high": _singles(self._high), "network": network}


def _scale(read: Array) -> tuple[Array, Array]:
    """Mean and deviation; of what never changed, 1."""
    mean, sd = read.mean(0), read.std(0)
    return mean, np.where(sd > 1e-9 * (1 + np.abs(mean)), sd, 1.0)


def _singles(values: Any) -> list[float]:
    """As the shortest text of a float."""
    return [float(str(v)) for v in np.asarray(values, np.float32)]


def _train(network: Any, data: Any, rows: Any, kept: Any, seed: int, epochs: int,
           jitter: Any) -> tuple[float, Any, Errors]:
    """The least held-out loss, the network that has it, and its errors."""
    x, y, weight = data
    batches = max(1, len(rows) // BATCH)
    size = min(BATCH, len(rows))
    schedule = optax.cosine_decay_schedule(RATE, epochs * batches, LAST_RATE)
    adam = optax.adam(schedule)
    arrays, static = eqx.partition(network, eqx.is_array)

    @jax.jit
    def epoch(arrays: Any, state: Any, order: Any, key: Any) -> Any:
        def step(carry: Any, given: Any) -> Any:
            (arrays, state), (at, key) = carry, given
            near = x[at] + jitter * jax.random.normal(key, (size, x.shape[1]), jnp.float32)
            slope = jax.grad(lambda a: loss(eqx.combine(a, static), near, y[at], weight[at]))(arrays)
            change, state = adam.update(slope, state)
            return (optax.apply_updates(arrays, change), state), None

        (arrays, state), _ = jax.lax.scan(step, (arrays, state), (order, jax.random.split(key, batches)))
        # by what is learnt: the root mean square is least where two answers are mixed
        now = eqx.combine(arrays, static)
        return arrays, state, loss(now, x[kept], y[kept], weight[kept]) if len(kept) else jnp.nan

    rng, state = np.random.default_rng(seed), adam.init(arrays)
    best, least, at = arrays, np.inf, 0
    for k in range(1, epochs + 1):
        order = rng.permutation(rows)[:batches * size].reshape(batches, size)
        arrays, state, error = epoch(arrays, state, order, jax.random.fold_in(jax.random.key(seed), k))
        if error < least or not len(kept):
            best, least, at = arrays, error, k
        if k - at >= PATIENCE:
            break
    network = eqx.combine(best, static)
    held_out = float(_rms(network, x[kept], y[kept])) if len(kept) else float("nan")
    return float(least), network, Errors(float(_rms(network, x[rows], y[rows])), held_out, at)


def names(robot: _core.Robot, reads: int) -> tuple[list[str], list[str]]:
    return _core.policy_inputs(robot, reads), list(robot.inputs)
