"""Costs and policies from demonstrations (docs/guide/imitate.md, docs/theory/imitation.md). Computes in double."""
import jax as _jax

_jax.config.update("jax_enable_x64", True)
