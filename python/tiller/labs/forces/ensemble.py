"""An ensemble of perceptrons, trained side by side in one compiled program."""
from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax

from .data import Array, Samples

HELD_OUT, EVERY = 0.2, 100  # share of the blocks that stop a member; steps between looks at them
RATE, LAST_RATE = 1e-2, 3e-4
PRIOR = 1e-2  # the prior counts as a hundredth of a squared standard error for each of the data's samples

Layers = Any  # a list of (bias (out), weight (out, in))


def fit(samples: Samples, members: int, hidden: list[int], steps: int, batch: int, seed: int) -> Array:
    """Weights (members x weights, in the file's order) on plain inputs and outputs. Each member minimises, over blocks
    drawn with replacement, the squared error by weight, and a pull towards its first weights, drawn from their prior,
    so that members differ where data are absent (anchored ensembles: Pearce et al., AISTATS 2020). A fifth of the
    blocks stops it: its weights of the least error there are kept. Cost: members x steps x batch passes there and
    back."""
    rng = np.random.default_rng(seed)
    widths = [samples.x.shape[1], *hidden, samples.y.shape[1]]
    drawn, count, stops = zip(*(_split(samples, rng) for _ in range(members)), strict=True)
    longest = max(map(len, drawn))
    rows = np.array([np.resize(one, longest) for one in drawn])
    layers = jax.vmap(lambda key: _first(widths, key))(jax.random.split(jax.random.key(seed), members))
    data = [jnp.asarray(a, jnp.float32) for a in (samples.x, samples.y, samples.weight)]
    best = _train(layers, *data, jnp.asarray(rows), jnp.asarray(count), jnp.asarray(np.array(stops), jnp.float32),
                  jax.random.key(seed + 1), steps // EVERY, batch)
    return _plain([(np.asarray(b, float), np.asarray(w, float)) for b, w in best], samples)


def _split(samples: Samples, rng: Any) -> tuple[Array, int, Array]:
    """Rows to train on, their number, and a weight for each row that stops."""
    counts = samples.weight.sum(1) > 0
    blocks = np.unique(samples.block[counts])
    held = rng.random(len(blocks)) < HELD_OUT
    if held.all():
        held[:] = False
    rest = blocks[~held]
    chosen = rng.choice(rest, len(rest))
    order = np.argsort(samples.block, kind="stable")
    begin, end = (np.searchsorted(samples.block, chosen, side) for side in ("left", "right"))
    rows = np.concatenate([order[b:e] for b, e in zip(begin, end, strict=True)])
    return rows[counts[rows]], int(counts[rows].sum()), np.isin(samples.block, blocks[held]) & counts


def _first(widths: list[int], key: Any) -> Layers:
    """Glorot's uniform weights."""
    keys = jax.random.split(key, len(widths) - 1)
    return [(jnp.zeros(n, jnp.float32), jax.random.uniform(k, (n, m), jnp.float32, -1, 1) * (6 / (m + n)) ** 0.5)
            for m, n, k in zip(widths, widths[1:], keys, strict=False)]


def _forces(layers: Layers, x: Any) -> Any:
    for bias, weight in layers[:-1]:
        x = jnp.tanh(x @ weight.T + bias)
    return x @ layers[-1][1].T + layers[-1][0]


def _pull(layers: Layers, anchor: Layers) -> Any:
    """Squared distance in deviations of the weights' prior, a layer's reach each."""
    return sum(sum(w.shape) / 2 * (((b - b0) ** 2).sum() + ((w - w0) ** 2).sum())
               for (b, w), (b0, w0) in zip(layers, anchor, strict=True))


@partial(jax.jit, static_argnums=(8, 9))
def _train(anchors: Layers, x: Any, y: Any, weight: Any, rows: Any, count: Any, stops: Any, key: Any, looks: int,
           batch: int) -> Layers:
    rule = optax.adam(optax.cosine_decay_schedule(RATE, looks * EVERY, LAST_RATE / RATE))

    def one(anchor: Layers, rows: Any, count: Any, stop: Any, key: Any) -> Layers:
        def loss(layers: Layers, at: Any) -> Any:
            error = ((_forces(layers, x[at]) - y[at]) ** 2 * weight[at]).sum(1).mean()
            return 0.5 * error + 0.5 * PRIOR / count * _pull(layers, anchor)

        def step(carry: Any, key: Any) -> Any:
            layers, state = carry
            at = rows[jax.random.randint(key, (batch,), 0, count)]
            change, state = rule.update(jax.grad(loss)(layers, at), state)
            return (optax.apply_updates(layers, change), state), None

        def look(carry: Any, key: Any) -> Any:
            layers, state, best, least = carry
            (layers, state), _ = jax.lax.scan(step, (layers, state), jax.random.split(key, EVERY))
            error = (((_forces(layers, x) - y) ** 2 * weight).sum(1) * stop).sum()
            nearer = (error < least) | (stop.sum() == 0)  # nothing stops it: the last ones
            best = jax.tree.map(lambda a, b: jnp.where(nearer, a, b), layers, best)
            return (layers, state, best, jnp.where(nearer, error, least)), None

        begin = (anchor, rule.init(anchor), anchor, jnp.asarray(jnp.inf, jnp.float32))
        return jax.lax.scan(look, begin, jax.random.split(key, looks))[0][2]

    return jax.vmap(one)(anchors, rows, count, stops, jax.random.split(key, len(count)))


def _plain(layers: list[tuple[Array, Array]], samples: Samples) -> Array:
    """The scales become part of first and last layer."""
    members = len(layers[0][0])
    out = []
    for m in range(members):
        own = [(b[m], w[m]) for b, w in layers]
        b, w = own[0]
        own[0] = (b - (w / samples.x_sd) @ samples.x_mean, w / samples.x_sd)
        b, w = own[-1]
        own[-1] = (b * samples.y_sd, w * samples.y_sd[:, None])
        out += [np.column_stack([b, w]).ravel() for b, w in own]
    return np.concatenate(out)
