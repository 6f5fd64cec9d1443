"""What stands in front of a density's head: how numbers, or a sequence, become features."""
from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

HIDDEN, STATES, FREQUENCIES = 48, 16, 128
FURTHEST = 10.0  # deviations of what a recurrent unit reads


class Perceptron(eqx.Module):
    """Two hidden layers."""
    mlp: eqx.nn.MLP

    def __init__(self, inputs: int, outputs: int, key: Any) -> None:
        self.mlp = eqx.nn.MLP(inputs, outputs, HIDDEN, 2, jnp.tanh, key=key)

    def __call__(self, s: Any) -> Any:
        return self.mlp(s)


class Fourier(eqx.Module):
    """Random Fourier features of an RBF kernel, under one linear layer (Rahimi, Recht, NIPS 2007; BayesSim's MDRFF:
    Ramos, Possas, Fox, RSS 2019). Frequencies are drawn once, each network its own. The kernel's width begins at the
    median distance of two samples of uncorrelated features, sqrt(2 inputs), and is learnt from there on."""
    frequencies: Any
    log_width: Any
    linear: eqx.nn.Linear

    def __init__(self, inputs: int, outputs: int, key: Any) -> None:
        self.frequencies = jax.random.normal(jax.random.fold_in(key, 1), (FREQUENCIES, inputs))
        self.log_width = jnp.asarray(0.5 * np.log(2.0 * inputs))
        self.linear = eqx.nn.Linear(2 * FREQUENCIES, outputs, key=key)

    def __call__(self, s: Any) -> Any:
        z = jax.lax.stop_gradient(self.frequencies) @ s * jnp.exp(-self.log_width)
        return self.linear(jnp.concatenate([jnp.cos(z), jnp.sin(z)]) / FREQUENCIES**0.5)


class Recurrent(eqx.Module):
    """A gated recurrent unit that reads a sequence beside the inputs that drove it, under a perceptron: the summary is
    learnt with the density (Possas et al., IROS 2020)."""
    cell: eqx.nn.GRUCell
    head: Perceptron
    inputs: Any  # (steps, nu)

    def __init__(self, inputs: Any, rows: int, outputs: int, key: Any) -> None:
        cell, head = jax.random.split(key)
        self.inputs = jnp.asarray(inputs, jnp.float32)
        self.cell = eqx.nn.GRUCell(rows + self.inputs.shape[1], STATES, key=cell)
        self.head = Perceptron(STATES, outputs, head)

    def __call__(self, s: Any) -> Any:
        rows = jnp.clip(s.reshape(len(self.inputs), -1), -FURTHEST, FURTHEST)
        sequence = jnp.concatenate([rows, jax.lax.stop_gradient(self.inputs)], axis=1)
        last, _ = jax.lax.scan(lambda state, row: (self.cell(row, state), None), jnp.zeros(STATES), sequence)
        return self.head(last)
