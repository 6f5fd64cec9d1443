"""Laboratories: what learns on the host, in Python on JAX. They reach a robot by files alone.

    tiller infer --help             or, where the command is not installed: python -m tiller.labs infer --help

Needs pip install 'tiller[labs]'; nothing in tiller itself imports this package, and it imports JAX where it learns.
"""
from __future__ import annotations

from typing import Any

_OF_INFER = {"METHODS": "options", "infer": "infer", "InferenceError": "problem", "Prior": "problem",
             "Problem": "problem", "Inferred": "result", "Options": "options"}

__all__ = ["METHODS", "InferenceError", "Inferred", "Options", "Prior", "Problem", "infer"]


def __getattr__(name: str) -> Any:
    """What infers, once it is asked for: --help and the other laboratories do not wait for it."""
    if name not in _OF_INFER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    from ._install import check

    check()
    found = globals()[name] = getattr(import_module(f".{_OF_INFER[name]}", __name__), name)  # not the module infer
    return found
