"""Network files (docs/reference/networks.md): written, and evaluated as the runtime does."""
from __future__ import annotations

from typing import Any

import numpy as np

from .data import Array, Ground


def document(ground: Ground, kind: str, members: int, hidden: list[int], weights: Array) -> dict[str, Any]:
    return {"format": "tiller network", "version": 1, "kind": kind, "inputs": ground.document["network_inputs"],
            "outputs": ground.document["network_outputs"], "members": members, "hidden": (hidden + [0])[:2],
            "weights": [float(str(w)) for w in np.asarray(weights, np.float32)]}


def evaluate(network: dict[str, Any], x: Array) -> Array:
    """Forces (members, outputs, n) at plain inputs x (inputs, n). The runtime's tanh is 2e-6 off this one."""
    weights = np.array(network["weights"])
    return _gaussian(network, weights, x) if network["kind"] == "gaussian" else _tanh(network, weights, x)


def _tanh(network: dict[str, Any], weights: Array, x: Array) -> Array:
    out = []
    for own in weights.reshape(network["members"], -1):
        value, at = x, 0
        widths = [width for width in network["hidden"] if width] + [len(network["outputs"])]
        for k, width in enumerate(widths):
            layer = own[at:at + width * (len(value) + 1)].reshape(width, -1)
            at += layer.size
            value = layer[:, :1] + layer[:, 1:] @ value
            value = np.tanh(value) if k + 1 < len(widths) else value
        out.append(value)
    return np.array(out)


def _gaussian(network: dict[str, Any], weights: Array, x: Array) -> Array:
    inputs, (centres, waves) = len(x), network["hidden"]
    inverse, rest = weights[:inputs], weights[inputs:]
    centre, rest = rest[:centres * inputs].reshape(centres, inputs), rest[centres * inputs:]
    wave, rest = rest[:waves * (1 + inputs)].reshape(waves, 1 + inputs), rest[waves * (1 + inputs):]
    squares = ((inverse[:, None] * (x - centre[:, :, None])) ** 2).sum(1)
    features = np.concatenate([np.ones((1, x.shape[1])), np.exp(-0.5 * np.minimum(squares, 120)),
                               np.cos(wave[:, :1] + wave[:, 1:] @ x)])
    return rest.reshape(network["members"], len(network["outputs"]), -1) @ features
