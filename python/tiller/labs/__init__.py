"""Laboratories: what learns on the host, in Python on JAX. They reach a robot by files alone.

    python -m tiller.labs infer --help

Needs pip install 'tiller[labs]'; nothing in tiller itself imports this package.
"""
from __future__ import annotations

from .._errors import missing_extra

for _name in ("jax", "equinox", "optax"):
    try:
        __import__(_name)
    except ImportError as _problem:
        raise missing_extra(_name, "labs", "tiller.labs") from _problem

from .infer import METHODS, infer  # noqa: E402
from .problem import InferenceError, Prior, Problem  # noqa: E402
from .result import Inferred, Options  # noqa: E402

__all__ = ["METHODS", "InferenceError", "Inferred", "Options", "Prior", "Problem", "infer"]
