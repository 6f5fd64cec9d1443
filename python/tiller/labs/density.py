"""q(v | s): mixture-density networks (Bishop 1994), which differ in first weights and in the tenth that each keeps
back."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

from .bodies import Fourier, Perceptron, Recurrent
from .mixture import Mixture
from .problem import Array

NETWORKS, EPOCHS, BATCH, RATE = 5, 200, 100, 3e-3


class _Net(eqx.Module):
    """Weights, means and lower roots R of the precisions R'R of a mixture of k normals over d numbers."""
    body: Any
    d: int = eqx.field(static=True)
    k: int = eqx.field(static=True)

    def __init__(self, d: int, k: int, body: Callable[[int], Any]) -> None:
        self.d, self.k = d, k
        self.body = body(k * (1 + d + d * (d + 1) // 2))

    def __call__(self, s: Any) -> tuple[Any, Any, Any]:
        d, k = self.d, self.k
        out = self.body(s)
        below = out[k + k * d:].reshape(k, -1)
        root = jnp.zeros((k, d, d)).at[:, *np.tril_indices(d)].set(below)
        diagonal = jnp.exp(jnp.diagonal(root, axis1=1, axis2=2))
        return jax.nn.log_softmax(out[:k]), out[k:k + k * d].reshape(k, d), jnp.where(
            jnp.eye(d, dtype=bool), diagonal[:, None, :], root)

    def log_density(self, s: Any, v: Any) -> Any:
        log_weight, mean, root = self(s)
        z = jnp.einsum("kij,kj->ki", root, v - mean)
        log_det = jnp.log(jnp.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        return jax.nn.logsumexp(log_weight + log_det - 0.5 * (z**2).sum(axis=1)) - 0.5 * self.d * jnp.log(2 * jnp.pi)


def _loss(net: _Net, s: Any, v: Any) -> Any:
    return -jnp.mean(jax.vmap(net.log_density)(s, v))


@eqx.filter_jit
def _train(nets: _Net, s: Any, v: Any, used: Any, kept: Any, key: Any) -> tuple[_Net, Any]:
    """Each network on its rows `used`; the weights of its least loss on its rows `kept`, and that loss."""
    batch = min(BATCH, used.shape[1])
    batches = used.shape[1] // batch
    # one draw in a tail must not undo an epoch
    rule = optax.chain(optax.clip_by_global_norm(5.0),
                       optax.adam(optax.cosine_decay_schedule(RATE, EPOCHS * batches, 0.01)))

    def one(net: _Net, used: Any, kept: Any, key: Any) -> tuple[_Net, Any]:
        free, fixed = eqx.partition(net, eqx.is_inexact_array)

        def step(carry: Any, rows: Any) -> tuple[Any, None]:
            free, state = carry
            slope = jax.grad(lambda f: _loss(eqx.combine(f, fixed), s[rows], v[rows]))(free)
            change, state = rule.update(slope, state)
            return (optax.apply_updates(free, change), state), None

        def epoch(carry: Any, key: Any) -> tuple[Any, None]:
            free, state, best, least = carry
            rows = jax.random.permutation(key, used)[:batches * batch].reshape(batches, batch)
            (free, state), _ = jax.lax.scan(step, (free, state), rows)
            loss = _loss(eqx.combine(free, fixed), s[kept], v[kept])
            best = jax.tree.map(lambda a, b: jnp.where(loss < least, a, b), free, best)
            return (free, state, best, jnp.fmin(loss, least)), None

        begin = (free, rule.init(free), free, jnp.inf)
        (_, _, best, least), _ = jax.lax.scan(epoch, begin, jax.random.split(key, EPOCHS))
        return eqx.combine(best, fixed), least

    return eqx.filter_vmap(one)(nets, used, kept, key)


class Ensemble:
    """The average of the networks' densities. Where draws are few they disagree, and it is as wide as that (Hermans et
    al., TMLR 2022)."""

    def __init__(self, s: Array, v: Array, components: int, seed: int, density: str = "mixture",
                 inputs: Array | None = None) -> None:
        """Trains on draws v (n, d) and their summaries s (n, size): sequences beside `inputs` (steps, nu) where there
        are any."""
        n, d = v.shape
        self.s_mean, self.s_sd = s.mean(axis=0), _no_zeros(s.std(axis=0))
        self.v_mean, self.v_sd = v.mean(axis=0), _no_zeros(v.std(axis=0))
        self.s, self.v = self._features(s), jnp.asarray((v - self.v_mean) / self.v_sd, jnp.float32)
        order, size = np.random.default_rng(seed).permutation(n), max(1, n // 10)
        self.kept = np.stack([order[k * size:(k + 1) * size] for k in range(NETWORKS)])
        used = np.stack([np.setdiff1d(order, kept) for kept in self.kept])
        keys = jax.random.split(jax.random.key(seed % 2**32), 2 * NETWORKS)
        nets = eqx.filter_vmap(_maker(density, s.shape[1], d, components, inputs))(keys[:NETWORKS])
        self.nets, losses = _train(nets, self.s, self.v, jnp.asarray(used), jnp.asarray(self.kept), keys[NETWORKS:])
        self.loss = float(jnp.mean(losses)) + float(np.log(self.v_sd).sum())  # nats of v, on draws kept back

    def _features(self, s: Array) -> Any:
        return jnp.asarray((s - self.s_mean) / self.s_sd, jnp.float32)

    def _mixtures(self, s: Any) -> Any:
        """Of each network at each row: s (networks, n, size)."""
        return eqx.filter_vmap(lambda net, rows: jax.vmap(net)(rows))(self.nets, s)

    def at(self, s: Array) -> Mixture:
        """The density at one summary: a mixture again, of as many normals as all networks have."""
        rows = jnp.broadcast_to(self._features(s), (NETWORKS, 1, len(s)))
        log_weight, mean, root = (np.asarray(a, float)[:, 0] for a in self._mixtures(rows))
        d = mean.shape[-1]
        inverse = np.linalg.inv(root.reshape(-1, d, d)) * self.v_sd[:, None]
        return Mixture(np.exp(log_weight).ravel() / NETWORKS, self.v_mean + self.v_sd * mean.reshape(-1, d),
                       inverse @ np.swapaxes(inverse, 1, 2))

    def ranks(self, seed: int, draws: int = 200) -> Array:
        """For the draws that each network kept back, the share of its density at their summaries that lies below them,
        (m, d): uniform where it is calibrated (Talts et al. 2018, simulation-based calibration)."""
        log_weight, mean, root = (np.asarray(a, float) for a in self._mixtures(self.s[self.kept]))
        rng = np.random.default_rng(seed)
        flat = log_weight.reshape(-1, log_weight.shape[-1])
        which = (flat[:, None] + rng.gumbel(size=(len(flat), draws, flat.shape[1]))).argmax(axis=2)
        rows, d = np.arange(len(flat))[:, None], mean.shape[-1]
        inverse = np.linalg.inv(root.reshape(-1, *root.shape[2:]))
        drawn = mean.reshape(len(flat), -1, d)[rows, which] + np.einsum(
            "nsij,nsj->nsi", inverse[rows, which], rng.normal(size=(len(flat), draws, d)))
        truth = np.asarray(self.v)[self.kept.ravel()]
        return np.asarray((drawn < truth[:, None]).mean(axis=1))


def _maker(density: str, size: int, d: int, components: int, inputs: Array | None) -> Callable[[Any], _Net]:
    """What makes a network of a key."""
    def body(outputs: int, key: Any) -> Any:
        if inputs is not None:
            return Recurrent(inputs, size // len(inputs), outputs, key)
        return (Fourier if density == "fourier" else Perceptron)(size, outputs, key)

    return lambda key: _Net(d, components, lambda outputs: body(outputs, key))


def _no_zeros(sd: Array) -> Array:
    return np.where(sd > 0, sd, 1.0)
