"""The rollout kernel as a function of JAX: batched, differentiable, on the processor.

    import jax, tiller, tiller.jax
    robot = tiller.Robot.from_toml("pendulum")
    states = tiller.jax.rollout(robot, x0, u, {"mass_kg": 0.4})
    slope = jax.grad(lambda m: tiller.jax.cost(robot, x0, u, {"mass_kg": m}))(0.4)

Needs jax: pip install 'tiller[jax]'. The guide is docs/guide/jax.md.
"""
from __future__ import annotations

from .. import _core
from .._errors import Error, missing_extra

try:
    import jax as _jax
except ImportError as _problem:
    raise missing_extra("jax", "jax", "tiller.jax") from _problem
if not hasattr(_core, "jax_targets"):
    raise Error("tiller.jax: this tiller was built without XLA's headers; install a wheel, or install jaxlib "
                "where tiller is built", status="not_built", remedy="pip install 'tiller[jax]'")
del _jax

from ._functions import cost, rollout, step  # noqa: E402

__all__ = ["cost", "rollout", "step"]
