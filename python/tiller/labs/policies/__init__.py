"""tiller policy: feedback policies from few trials (docs/theory/policy_search.md)."""
import jax as _jax

_jax.config.update("jax_enable_x64", True)  # moments of a sharp process are differences of near numbers
